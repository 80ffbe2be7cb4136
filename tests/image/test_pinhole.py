"""Pinhole coordinates, in which the conic model of the bitangents is (nearly) exact."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.geometry import Ellipse, bitangents, conic, fit_ellipse
from sldvexp.geometry.bitangent import bitangent_points
from sldvexp.image import (
    dac_from_pinhole,
    fit_circle,
    pinhole_edges,
    pinhole_from_dac,
    profile_edges,
)
from sldvexp.image.edge_detection import FINE_WINDOW
from sldvexp.image.matching import bitangent_images, match_circles
from sldvexp.image.pinhole import dac_bitangents, pinhole_jacobian
from sldvexp.laser import Board, Mirror, TwoMirror
from sldvexp.targets import Circles

Make = Callable[..., Any]
CURVED = TwoMirror(
    board=Board.bits_16,
    up_down=Mirror(gain=-20.0, zero=1.0, polynomial=[0.3, 0.1]),
    left_right=Mirror(gain=22.0, polynomial=[-0.2]),
)
STEPS = np.random.default_rng(0).uniform(-30000, 30000, (50, 2))


def test_there_and_back() -> None:
    back = dac_from_pinhole(CURVED, pinhole_from_dac(CURVED, STEPS))
    assert back == pytest.approx(STEPS, abs=1e-6)


def test_derivative() -> None:
    jacobian = pinhole_jacobian(CURVED, STEPS)
    for i in range(2):
        step = 0.5 * np.eye(2)[i]
        change = pinhole_from_dac(CURVED, STEPS + step) - pinhole_from_dac(CURVED, STEPS - step)
        assert jacobian[..., i] == pytest.approx(change, abs=1e-8)


def test_a_step_at_the_middle_keeps_its_length() -> None:
    laser = TwoMirror()
    assert pinhole_jacobian(laser, np.zeros(2)) == pytest.approx(np.eye(2))


@pytest.mark.parametrize(
    ("mirror_offset", "least", "most"),
    [(0.0, 0.0, 1e-6), (0.045, 0.002, 0.05)],
    ids=["no offset", "45 mm offset"],
)
def test_bitangents_of_the_two_mirror_model(
    mirror_offset: float, least: float, most: float, view: Make, figure_4_1: Circles
) -> None:
    """Exact without a mirror offset; with one of 45 mm a tenth of the error of DAC steps."""
    where = view(mirror_offset)
    found = [
        fit_ellipse(pinhole_from_dac(where.laser, where.edge(figure_4_1, n)), 0.1).ellipse
        for n in (2, 4, 1, 3)
    ]
    match = match_circles(figure_4_1, found)
    pairs = figure_4_1.selected_pairs()
    points, _ = dac_bitangents(where.laser, bitangent_images(found, match, pairs))
    sixteen = points[:, :2].swapaxes(1, 2).reshape(16, 2)
    error = np.linalg.norm(sixteen - where.dac(figure_4_1.points().position), axis=1).max()
    assert least <= error < most
    in_steps = [fit_ellipse(where.edge(figure_4_1, n), 0.1).ellipse for n in (2, 4, 1, 3)]
    direct, _ = bitangent_images(in_steps, match, pairs)
    sixteen = direct[:, :2].swapaxes(1, 2).reshape(16, 2)
    worse = np.linalg.norm(sixteen - where.dac(figure_4_1.points().position), axis=1).max()
    assert worse > 8 * error


def test_edges_keep_their_significance(spot: Make) -> None:
    """The same fit in both coordinates: the same chi square and outliers."""
    scene = spot(noise=0.02)
    edges = profile_edges(scene.scan(scene.fine()), 1, FINE_WINDOW)
    laser = TwoMirror()
    direct, _ = fit_circle(edges)
    pinhole, _ = fit_circle(pinhole_edges(laser, edges))
    assert pinhole.chi_square == pytest.approx(direct.chi_square, rel=0.03)
    points, _ = conic.boundary(direct.ellipse.parameters, np.linspace(0, 6, 30))
    there = pinhole_from_dac(laser, points)
    distance, _ = conic.signed_distance(there, pinhole.ellipse.parameters)
    assert np.abs(distance).max() < 0.01


def test_covariance_follows_the_points() -> None:
    laser = TwoMirror()
    a = np.array([1500.0, 1100.0, 60.0**2, 55.0**2, 100.0])
    b = np.array([-700.0, 900.0, 50.0**2, 65.0**2, -100.0])
    spread = np.diag([0.01, 0.01, 100.0, 100.0, 50.0])
    found = bitangents([Ellipse(a, spread), Ellipse(b, spread)], [(0, 1)], ["1", "2"])
    stated = dac_bitangents(laser, found).covariance.reshape(16, 16)
    rng = np.random.default_rng(5)
    count = 2000
    noisy = [e + rng.normal(size=(count, 5)) * np.sqrt(np.diag(spread)) for e in (a, b)]
    drawn = dac_from_pinhole(laser, bitangent_points(*noisy)).reshape(count, 16)
    ratio = drawn.std(axis=0) / np.sqrt(np.diag(stated))
    assert np.all(np.abs(ratio - 1.0) < 4.5 / np.sqrt(2 * count))


def test_a_place_beyond_the_board_is_refused() -> None:
    with pytest.raises(UserError, match="up_down"):
        dac_from_pinhole(TwoMirror(), [[9000.0, 0.0]])
