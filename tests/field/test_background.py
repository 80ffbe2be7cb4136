"""Pixels at rest beside a structure have no part in fields, and views that lack them are named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp import field
from sldvexp.field.visibility.background import background_findings, beside, without_background
from sldvexp.field.visibility.view import View
from sldvexp.laser import project, rays
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.reconstruction import Contravariant
from sldvexp.signal import Flag
from sldvexp.volume import Grid

LASER, NOISE = TwoMirror(), 1e-6
#: Ends 15 mm before the plate of 0.32 x 0.24 m does.
SURFACE = Grid(size=[0.29, 0.21], shape=[15, 11], layers=2, thickness=1e-5)
#: Four stands, two of which look flat along the plate.
STANDS = [[-0.5, -0.75, 0.35], [0.6, -0.7, 0.35], [0.1, 0.3, 0.9], [-0.2, -0.2, 1.0]]


def moves(x, y, waves):
    """Give the velocity of a plate that is held at its edges, with half waves along x."""
    return 1e-3 * np.sin(waves * np.pi * (x + 0.16) / 0.32) * np.sin(np.pi * (y + 0.12) / 0.24)


def views(shape=(17, 25), goes_on=False, seed=1, waves=1, stands=STANDS, beyond=0.0):
    """Give images of rectangles in steps around the plate; beside it nothing moves.

    They go on beyond its corners by a part of the pixels' distance.
    """
    rng, made = np.random.default_rng(seed), []
    for name, origin in zip("abcd", np.array(stands), strict=False):
        z = -origin / np.linalg.norm(origin)
        x = np.cross([0.0, 1.0, 0.0], z) / np.linalg.norm(np.cross([0.0, 1.0, 0.0], z))
        rotation = np.stack([x, np.cross(z, x), z])
        corner = np.array([[i, j, 0.0] for i in (-0.16, 0.16) for j in (-0.12, 0.12)])
        dac = LASER.dac_from_angle(project((corner - origin) @ rotation.T, LASER.mirror_offset))
        more = beyond * np.ptp(dac, axis=0) / (np.array(shape) - 1 - 2 * beyond)
        low, high = dac.min(0) - more, dac.max(0) + more
        axes = [np.linspace(a, b, n) for a, b, n in zip(low, high, shape, strict=True)]
        dac = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        start, along = rays(LASER.angle_from_dac(dac), LASER.mirror_offset)
        begin, way = origin + start @ rotation, along @ rotation
        place = begin - way * (begin[:, 2] / way[:, 2])[:, None]
        on_it = (np.abs(place[:, 0]) < 0.16) & (np.abs(place[:, 1]) < 0.12)
        seen = np.where(on_it | goes_on, moves(*place.T[:2], waves), 0.0) * -way[:, 2]
        seen = seen + NOISE * (rng.normal(size=(len(dac), 2)) @ [1, 1j])
        made.append(View.from_arrays(name, rotation, origin, seen, NOISE, dac=dac, shape=shape))
    return made


def estimated(seen):
    return field.estimate_field(seen, LASER, SURFACE, Contravariant(rows="all"))


def largest_error(seed):
    """Give the largest error of x over its bound: nothing moves along x."""
    found = estimated(views(seed=seed))
    return float(np.nanmax(np.abs(found.velocity[:, 0]) / found.confidence[:, 0]))


SEEDS = [pytest.param([2], id="one"), pytest.param([1, 2, 3], marks=pytest.mark.whole, id="three")]


@pytest.mark.whole
@pytest.mark.parametrize("seeds", SEEDS)
def test_bounds_hold_beside_a_background_at_rest(seeds):
    assert np.median([largest_error(seed) for seed in seeds]) < 3.0


@pytest.mark.whole
@pytest.mark.parametrize("seeds", SEEDS)
def test_cells_that_reach_into_the_background_would_spoil_the_rim(monkeypatch, seeds):
    monkeypatch.setattr(
        field.visibility.visibility, "without_background", lambda views, laser, prisms: views
    )
    assert np.median([largest_error(seed) for seed in seeds]) > 4.0


@pytest.mark.parametrize("shape", [(17, 25), None])
def test_only_pixels_beside_the_plate_are_left_out(shape):
    """Whether in rows and columns or anywhere; a flat look has nearly all of it found."""
    prisms, still, bare = SURFACE.prisms(), 0, 0
    for view, clean in zip(views()[:2], views(goes_on=True)[:2], strict=True):
        away = np.abs(view.velocity - clean.velocity)[:, 0] > 1e-9
        found = beside(replace(view, shape=shape), LASER, prisms)
        assert not found[~away & (np.abs(view.velocity[:, 0]) > 10 * NOISE)].any()
        still, bare = still + (found & away).sum(), bare + away.sum()
    assert still > 0.9 * bare


def test_a_single_line_of_pixels_around_the_plate_is_left_out():
    """Without it the cells at the rim would bend to rest."""
    (view,) = views(stands=[[0.0, 0.0, 1.0]], beyond=0.6)
    found = beside(view, LASER, SURFACE.prisms()).reshape(view.shape)
    for line in (found[0], found[-1], found[:, 0], found[:, -1]):
        assert line[3:-3].all()  # next to the corners hardly anything moves
    moving = np.abs(view.velocity[:, 0]).reshape(view.shape) > 10 * NOISE
    assert not found[moving].any()


@pytest.mark.parametrize("line", [0, 1])
def test_nodal_line_along_the_border_is_no_background_next_to_lost_pixels(line):
    """A pixel without a velocity does not break the image off."""
    (view,) = views(stands=[[0.0, 0.0, 1.0]], beyond=0.01, goes_on=True)
    prisms = SURFACE.prisms()
    assert not beside(view, LASER, prisms).any()
    lost = np.zeros(view.shape, int)
    some = slice(5, -4, 6)  # not beside a corner, where two nodal lines meet
    lost[line, some] = lost[-1 - line, some] = lost[some, line] = lost[some, -1 - line] = 1
    flags = lost.ravel() * int(Flag.dropped_out)
    assert not beside(replace(view, flags=flags), LASER, prisms).any()


def test_structure_that_goes_on_is_not_taken_for_background():
    """Neither is the nodal line that leaves the surface."""
    seen = views(goes_on=True, waves=2)
    assert not any(beside(view, LASER, SURFACE.prisms()).any() for view in seen)


def test_noise_alone_has_no_background():
    seen = [replace(view, velocity=0.001 * view.velocity) for view in views()]
    assert not any(beside(view, LASER, SURFACE.prisms()).any() for view in seen)


def test_views_that_lose_the_rim_are_named():
    prisms = SURFACE.prisms()
    found = background_findings(without_background(views(), LASER, prisms), LASER, prisms)
    assert {"view a", "view b"} <= {f.subject for f in found}
    dense = without_background(views((81, 101)), LASER, prisms)
    fewer = background_findings(dense, LASER, prisms)
    assert sum(f.size for f in fewer) < 0.1 * sum(f.size for f in found)


def test_nodes_of_few_samples_have_no_value_instead_of_a_bound_of_zero():
    """A fifth of the pixels is lost: some prisms keep fewer samples than they have corners."""
    rng = np.random.default_rng(3)
    lost = (rng.random((4, 425)) < 0.2) * int(Flag.dropped_out)
    seen = [replace(view, flags=of) for view, of in zip(views(goes_on=True), lost, strict=True)]
    noise = estimated(seen).to_dataset()["velocity_std_noise"].values
    known = np.isfinite(noise)
    assert 0.1 < known.mean() < 0.9
    assert noise[known].min() > 0.1 * NOISE
