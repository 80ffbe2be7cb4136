"""Pixels that dropped out without a flag are found, and good ones are kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from sldvexp.field import View
from sldvexp.field.bounds.pose_uncertainty import pose_covariance
from sldvexp.verdict.beams import PixelBeams
from sldvexp.verdict.comparison import bench_of
from sldvexp.verdict.drop_outs import (
    disagree,
    disagreeing,
    drop_outs,
    outliers,
    resting,
    used_pixels,
)
from sldvexp.verdict.joint_fit import JointFit

from .simulated_views import clean, session


def seen(made, view):
    return PixelBeams.trace(view, made.surface, np.flatnonzero(view.usable)).pixel


def spoil(rng, view, pixels, size=0.02):
    velocity = view.velocity.copy()
    shape = (len(pixels), velocity.shape[1])
    velocity[pixels] = size * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
    return replace(view, velocity=velocity)


@pytest.mark.whole
def test_hardly_a_good_pixel_is_lost():
    lost = total = 0
    for seed in range(6):
        made = session(np.random.default_rng(seed))
        for view in made.views:
            among = seen(made, view)
            lost += int((drop_outs(view, among) | resting(view, among)).sum())
            total += len(among)
    assert lost <= 1e-3 * total


@pytest.mark.whole
@pytest.mark.parametrize("share", [0.002, 0.01, 0.05, 0.1])
def test_drop_outs_are_found(share):
    found = missed = wrong = total = 0
    for seed in range(3):
        rng = np.random.default_rng(seed)
        made = session(rng)
        for view in made.views:
            among = seen(made, view)
            bad = rng.choice(among, max(1, round(share * len(among))), replace=False)
            marked = drop_outs(spoil(rng, view, bad), among)
            found += int(marked[bad].sum())
            missed += int((~marked[bad]).sum())
            wrong += int(np.delete(marked, bad).sum())
            total += len(among)
    assert found >= 0.99 * (found + missed)
    assert wrong <= 1e-3 * total


def test_pixels_around_the_surface_are_judged_as_samples_use_them():
    """Cells at the rim have corners beyond it, the corners neighbours, and these stand-ins."""
    made = session(np.random.default_rng(0))
    view = made.views[0]
    flags = np.zeros_like(view.flags)
    beyond = replace(view, flags=flags, velocity=np.nan_to_num(view.velocity))
    met, used = seen(made, beyond), used_pixels(beyond, made.surface)
    row, column = np.divmod(np.arange(len(flags)), view.shape[1])
    rows, columns = np.abs(row[:, None] - row[met]), np.abs(column[:, None] - column[met])
    away = np.maximum(rows, columns).min(axis=1)
    assert set(np.flatnonzero(away <= 4)) <= set(used)
    assert away[used].max() <= 8  # at the image's border neighbours are further


def plate_on_a_wall(rng):
    """Give an image of a plate, the wall beside it at rest, and which pixels are well inside."""
    at = np.arange(-12.0, 13.0)
    x, y = np.stack(np.meshgrid(at, at, indexing="ij"), axis=-1).reshape(-1, 2).T
    moves = (np.abs(x) < 9.5) & (np.abs(y) < 9.5)
    values = 0.02 * np.cos(0.1 * x) * np.cos(0.08 * y) * moves
    values = values[:, None] * [1.0, 1j]
    values += 1e-4 * (rng.standard_normal(values.shape) + 1j * rng.standard_normal(values.shape))
    dac = 50 * np.stack([x, y], axis=1)
    view = View.from_arrays("a", np.eye(3), [0, 0, 0], values, 1e-4, dac=dac, shape=(25, 25))
    return view, np.flatnonzero((np.abs(x) < 7.5) & (np.abs(y) < 7.5))


#: Of the plate on the wall, which no line of others confirms.
CORNERS = {25 * row + column for row in (3, 21) for column in (3, 21)}


def test_edge_of_the_structure_beside_the_surface_is_no_drop_out():
    every = np.arange(625)
    for seed in range(5):
        view, inside = plate_on_a_wall(np.random.default_rng(seed))
        assert set(np.flatnonzero(drop_outs(view, every, inside))) <= CORNERS
    assert not set(np.flatnonzero(drop_outs(view, every))) <= CORNERS


#: An image of a plate's rim that lies askew to its lines, 0.01 mm/s.
ASKEW = [
    [-7, 1, 1, -2, 0, 1, 3, -1, -2, -5],
    [-4, 1, -1, 1, -2, 4, 1, 33, 104, 175],
    [-1, -2, -5, 1, 25, 89, 154, 227, 305, 365],
    [4, 22, 72, 135, 200, 272, 343, 417, 489, 562],
    [107, 164, 230, 301, 382, 451, 524, 600, 670, 736],
    [227, 306, 378, 453, 531, 612, 688, 761, 828, 897],
]


def test_a_pixel_between_both_sides_of_a_rim_is_no_drop_out():
    """It is no mean of two opposite ones, as the rim passes nearer to one of them."""
    dac = np.stack(np.meshgrid(65 * np.arange(6), 46 * np.arange(10), indexing="ij"), axis=-1)
    values = 1e-5 * np.array(ASKEW, complex).reshape(-1, 1)
    view = View.from_arrays(
        "a", np.eye(3), [0, 0, 0], values, 3e-5, dac=dac.reshape(-1, 2), shape=(6, 10)
    )
    inside = np.flatnonzero(np.ravel(ASKEW) > 500)
    assert not drop_outs(view, np.arange(60), inside).any()
    values[24] = 2e-3j
    spoiled = replace(view, velocity=values)  # in another phase it is on neither side
    assert np.flatnonzero(drop_outs(spoiled, np.arange(60), inside)).tolist() == [24]


def test_drop_outs_beside_the_surface_are_found():
    rng, every = np.random.default_rng(1), np.arange(625)
    view, inside = plate_on_a_wall(rng)
    bad = rng.choice(np.setdiff1d(every, inside), 10, replace=False)
    marked = drop_outs(spoil(rng, view, bad), every, inside)
    assert set(bad) <= set(np.flatnonzero(marked)) <= set(bad) | CORNERS


def test_hole_is_found_as_a_patch_at_rest():
    rng = np.random.default_rng(1)
    made = session(rng)
    view = made.views[0]
    beams = PixelBeams.trace(view, made.surface, np.flatnonzero(view.usable))
    x, y, _ = beams.point.T
    hole = beams.pixel[(np.abs(x + 0.03) < 0.02) & (np.abs(y) < 0.02)]
    marked = resting(spoil(rng, view, hole, 1e-4), beams.pixel)
    assert marked[hole].all()
    assert not np.delete(marked, hole).any()


@pytest.mark.whole
def test_field_of_all_views_finds_them_too_but_at_the_rim():
    """At the rim a pixel may carry a spline of its own; neighbours have judged it before."""
    rng = np.random.default_rng(2)
    made = session(rng)
    bad = rng.choice(seen(made, made.views[1]), 12, replace=False)
    views = [*made.views]
    views[1] = spoil(rng, views[1], bad)
    bench = bench_of(views, made.surface, pose_covariance(views, None))
    fit = bench.fit()
    marked = [
        set(outliers(data, design, out).tolist())
        for data, design, out in zip(
            bench.data, fit.designs, disagreeing(fit, [0.0] * 5), strict=True
        )
    ]
    assert len(set(bad.tolist()) & marked[1]) >= 10
    assert sum(map(len, marked)) - len(bad) <= 5e-3 * sum(len(d.pixel) for d in bench.data)


def with_velocities(fit: JointFit, added: Sequence[np.ndarray]) -> JointFit:
    """Fit anew with velocities added to those of every view, at the pixels that are present."""
    data = []
    for of, design, more in zip(fit.data, fit.designs, added, strict=True):
        velocity = of.velocity.copy()
        velocity[design.present] += more
        data.append(replace(of, velocity=velocity))
    return JointFit(data, fit.designs, fit.prior, fit.standard)


def test_group_of_pixels_that_one_view_has_spoiled_does_not_hide_itself():
    """More than half of the pixels around in its image are spoiled as well."""
    rng = np.random.default_rng(1)
    _, _, fit = clean()
    added = [np.zeros((len(d.weight), fit.channels // 2), complex) for d in fit.designs]
    point = fit.designs[1].beams.point
    bad = np.argsort(np.linalg.norm(point - np.median(point, axis=0), axis=1))[:40]
    added[1][bad] = 20 * rng.normal(size=(*added[1][bad].shape, 2)) @ [1, 1j]
    marked = disagreeing(with_velocities(fit, added), [0.0] * 5)
    assert marked[1][bad].mean() > 0.9
    assert sum(m.sum() for m in marked) - marked[1][bad].sum() <= 2


@pytest.mark.whole
def test_motion_that_the_smooth_field_does_not_follow_spoils_no_pixels():
    """All views see it: ripples around one place, twenty times the noise."""
    _, _, fit = clean()
    added, middle = [], np.median(fit.designs[0].beams.point, axis=0)
    extent = np.ptp(fit.designs[0].beams.point[:, 0])
    for design in fit.designs:
        away = np.linalg.norm(design.beams.point - middle, axis=1) / (0.1 * extent)
        ripples = 20 * np.exp(-(away**2) / 2) * np.cos(6 * away)
        added.append((ripples * design.beams.direction[:, 2])[:, None])
    rippled = with_velocities(fit, added)
    assert rippled.squares > 2 * rippled.dof
    assert not disagree(rippled, [0.0] * 5)
    assert np.concatenate(disagreeing(rippled, [0.0] * 5)).mean() < 2e-3
