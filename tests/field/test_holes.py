"""Nodes in a hole are found by patches at rest that most views see there; they have no values."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp import field, reconstruction
from sldvexp.field.visibility.holes import by_hole, nodes_in_holes
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.signal import Flag
from sldvexp.volume import Grid

LASER, PLATE = TwoMirror(), Grid(size=[0.2, 0.2], shape=[9, 9], layers=2, thickness=0.004)
ORIGINS = {"left": (-0.4, -0.3), "right": (0.4, -0.3), "top": (0.0, 0.4), "low": (0.1, -0.35)}


def views(holes, blind=()):
    """Give views of a plate that moves as a whole, with holes of 5 cm around some places."""
    rng, rotation = np.random.default_rng(1), np.diag([1.0, -1.0, -1.0])
    step = np.linspace(-0.15, 0.15, 51)
    x, y = np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2).T
    made = []
    for name, (a, b) in ORIGINS.items():
        place = np.stack([x, y, np.zeros_like(x)], axis=1)
        dark = field.View.from_arrays(
            name, rotation, [a, b, 1.5], 0 * x, 1e-6, dac=np.zeros((len(x), 2))
        )
        seen = field.visibility.projection.sight(dark, LASER, place)
        velocity = seen.directions @ [1e-3, 2e-3, 3e-3] + 1e-6 * rng.normal(size=len(x))
        hole = np.zeros(len(x), bool)
        for p, q in holes:
            hole |= (np.abs(x - p) < 0.025) & (np.abs(y - q) < 0.025)
        flags = np.where(hole & (name not in blind), int(Flag.resting), 0)
        view = field.View.from_arrays(
            name, rotation, [a, b, 1.5], velocity, 1e-6, dac=seen.dac, flags=flags, shape=(51, 51)
        )
        made.append(view)
    return made


def place():
    return PLATE.prisms().position.reshape(-1, 3)


def around(p, q, half):
    return np.all(np.abs(place()[:, :2] - [p, q]) < half, axis=1)


@pytest.mark.parametrize("shape", [(51, 51), None])
def test_nodes_in_a_hole_are_found(shape):
    seen = [replace(view, shape=shape) for view in views([(0.05, 0.0)])]
    found = nodes_in_holes(seen, LASER, PLATE.prisms())
    assert found[around(0.05, 0.0, 0.0249)].all()
    assert not found[~around(0.05, 0.0, 0.04)].any()


def test_patch_that_most_views_do_not_see_is_no_hole():
    found = nodes_in_holes(views([(0.05, 0.0)], ("left", "right", "top")), LASER, PLATE.prisms())
    assert not found.any()


def test_two_holes_are_told_apart():
    prisms = PLATE.prisms()
    found = nodes_in_holes(views([(0.05, 0.0), (-0.05, 0.05)]), LASER, prisms)
    first, second = by_hole(found, prisms)
    centers = {tuple(np.round(place()[one, :2].mean(axis=0), 2)) for one in (first, second)}
    assert centers == {(0.05, 0.0), (-0.05, 0.05)}
    assert sorted([*first, *second]) == np.flatnonzero(found).tolist()


def test_field_has_no_values_in_a_hole():
    """Elements larger than the hole would carry into it what moves around it."""
    coarse = replace(PLATE, shape=[5, 5])
    seen = views([(0.05, 0.0)])
    result = field.estimate_field(seen, LASER, coarse, reconstruction.Absolute())
    inside = np.all(
        np.abs(coarse.prisms().position.reshape(-1, 3)[:, :2] - [0.05, 0]) < 0.025, axis=1
    )
    assert inside.sum() == 2
    assert np.isnan(result.velocity[inside]).all()
    assert np.isnan(result.confidence[inside]).all()
    assert not result.observable[inside].any()
    assert np.isfinite(result.velocity[~inside]).all()
    assert set(np.flatnonzero(inside)) == set(result.flagged_node)
