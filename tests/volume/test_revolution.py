"""Volumes of closed shells of revolution: nodes and tangents all around, bad meridians."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import ConfigError
from sldvexp.geometry import Meridian, rotation_from_euler
from sldvexp.units import LengthUnit
from sldvexp.volume import Revolution, VisibilitySettings

CUP = [[0.05, 0.0], [0.068, 0.008], [0.08, 0.022], [0.09, 0.05], [0.097, 0.075], [0.1, 0.1]]


def area(surface):
    a, b, c = np.moveaxis(surface.position[surface.triangles], 1, 0)
    return np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2


def test_a_tube_closes_in_itself():
    made = Revolution(profile=[[0.1, -0.1], [0.1, 0.1]], shape=[60, 7])
    surface = made.surface()
    side = 2 * 0.1 * np.sin(np.pi / 60)
    assert area(surface) == pytest.approx(60 * side * 0.2)
    x, _, z = surface.position.T
    assert np.hypot(x, z) == pytest.approx(0.1)
    edges = np.sort(np.concatenate([surface.triangles[:, [i, i - 1]] for i in range(3)]), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert (count == 1).sum() == 2 * 60  # the rims at both ends alone


def test_it_stands_where_it_is_put_with_tangents_around():
    euler, center = [0.3, 0.7, -0.2], [10.0, 20.0, -30.0]
    profile = [[100.0 * r, 100.0 * y] for r, y in CUP]
    made = Revolution(
        profile=profile,
        unit=LengthUnit.cm,
        center=center,
        euler=euler,
        thickness=0.4,
        shape=[40, 9],
    )
    prisms, rotation = made.prisms(), rotation_from_euler(euler)
    own = (prisms.surface - 1e-2 * np.array(center)) @ rotation.T
    t1, t2, n = np.moveaxis(prisms.frame @ rotation.T, 1, 0)
    r = np.hypot(own[:, 0], own[:, 2])
    around = np.column_stack([own[:, 2], 0 * r, -own[:, 0]]) / r[:, None]
    assert t1 == pytest.approx(around, abs=1e-12)
    assert np.all(t2[:, 1] > 0)
    assert np.all((n[:, [0, 2]] * own[:, [0, 2]]).sum(axis=1) > 0)  # upwards: outwards
    assert r.min() == pytest.approx(0.05)


def test_a_tangent_may_be_given():
    made = Revolution(tangent=[0.0, 1.0, 0.0]).prisms()
    assert made.frame[:, 0] == pytest.approx(np.broadcast_to([0.0, 1.0, 0.0], (324, 3)), abs=1e-12)


def test_a_meridian_runs_smoothly_through_its_points_and_beyond():
    curve = Meridian(np.array(CUP))
    assert curve(curve.knots) == pytest.approx(np.array(CUP), abs=1e-15)
    for order in range(3):
        inside, beyond = (curve(np.array([curve.half + d]), order) for d in (-1e-9, 1e-9))
        assert inside == pytest.approx(beyond, rel=1e-6, abs=1e-6)
    off = curve(np.array([0.01])) + 0.003 * curve.normals(np.array([0.01]))
    assert curve.nearest(off) == pytest.approx([0.01])


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"profile": [[0.1, 0.0]]}, "needs 2 points or more"),
        ({"profile": [[0.1, 0.0], [0.1, 0.0]]}, r"profile\[1\].* is the point 0 again"),
        ({"profile": [[0.1, 0.0], 3.0]}, r"profile\[1\].* must be two numbers"),
        ({"profile": [[0.1, 0.0], [0.0, 0.1]]}, "must stay away from the axis"),
        ({"profile": [[0.05, 0.0], [0.1, 0.0], [0.1, 0.2]]}, r"profile\[1\].* is a corner"),
        ({"shape": [7, 9]}, r"shape\[0\]"),
        ({"tangent": [0.0, 0.0, 0.0]}, "must be a direction"),
        ({"sight": VisibilitySettings(both_sides=True)}, "seen from outside alone"),
    ],
)
def test_meridians_that_cannot_be(settings, told):
    with pytest.raises(ConfigError, match=told):
        Revolution(**settings)
