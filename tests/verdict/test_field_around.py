"""Smooth fields around closed surfaces: which surfaces get one, slopes, what it can follow."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from sldvexp.geometry import rotation_from_euler
from sldvexp.verdict.field_around import FieldAround
from sldvexp.verdict.smooth_field import SmoothField, _knots, splines_on
from sldvexp.volume import Grid, Revolution

TURNED = {"center": [0.3, -0.2, 1.0], "euler": [0.3, 1.1, -0.7]}


def nodes(profile=((0.1, -0.12), (0.08, 0.12)), **settings):
    profile = [list(p) for p in profile]
    return Revolution(profile=profile, shape=[60, 25], **TURNED, **settings).prisms().surface


def test_closed_surfaces_alone_get_a_field_around():
    assert isinstance(FieldAround.on(nodes(), 3), FieldAround)
    assert isinstance(FieldAround.on(nodes(((0.1, -0.02), (0.1, 0.02))), 10), FieldAround)
    as_long_as_wide = FieldAround.on(nodes(((0.1, -0.1), (0.1, 0.1))), 3)
    axis = rotation_from_euler(TURNED["euler"])[1]
    assert isinstance(as_long_as_wide, FieldAround)
    assert abs(as_long_as_wide.axes[2] @ axis) == pytest.approx(1.0)
    for radius in (None, 0.1):
        sheet = Grid(size=[0.3, 0.25], shape=[30, 25], radius=radius).prisms().surface
        assert type(FieldAround.on(sheet, 3)) is SmoothField


@pytest.mark.whole
def test_slopes_are_those_of_differences_in_space():
    places = nodes()
    field = FieldAround.on(places, 4)
    basis, slopes = field.evaluate(places)
    assert basis.shape == (len(places), field.count)
    assert basis.sum(axis=1) == pytest.approx(1.0)
    step = 1e-7
    for axis in np.eye(3):
        ahead, behind = (field.evaluate(places + sign * step * axis)[0] for sign in (1, -1))
        wanted = (ahead - behind) / (2 * step)
        found = sum((axis @ way) * slope for way, slope in slopes)
        assert found == pytest.approx(wanted, abs=1e-4 * np.abs(wanted).max())


def test_it_follows_waves_around_where_it_comes_back():
    places = nodes()
    basis, _ = FieldAround.on(places, 7).evaluate(places)
    x, y, z = ((places - TURNED["center"]) @ rotation_from_euler(TURNED["euler"]).T).T
    wave = np.cos(3 * np.arctan2(x, z) + 0.3) * (1 + 2 * y)
    left = wave - basis @ np.linalg.lstsq(basis, wave, rcond=None)[0]
    assert np.abs(left).max() < 0.02


@pytest.mark.parametrize("intervals", [1, 5])
def test_splines_and_their_slopes_are_those_of_scipy(intervals):
    knots = _knots(-0.2, 0.7, intervals)
    x = np.r_[np.linspace(knots[0], knots[-1], 40, endpoint=False), knots[4], -3.0]
    value, slope = splines_on(x, knots)
    inside = np.maximum(x, knots[0])
    for one, of_value, of_slope in zip(np.eye(len(knots) - 4), value.T, slope.T, strict=True):
        spline = BSpline(knots, one, 3)
        np.testing.assert_allclose(of_value, spline(inside), atol=1e-14)
        np.testing.assert_allclose(of_slope, spline(inside, 1), atol=1e-12)


def test_values_alone_are_those_with_slopes():
    flat = Grid(size=[0.3, 0.2], shape=[7, 7]).prisms().position
    for surface in (flat, nodes()):
        field = FieldAround.on(surface, 5)
        np.testing.assert_array_equal(field.values(surface), field.evaluate(surface)[0])
