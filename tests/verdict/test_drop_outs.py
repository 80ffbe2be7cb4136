"""Pixels that dropped out without a flag are found, and good ones are kept."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.field.bounds.pose_uncertainty import pose_covariance
from sldvexp.verdict.beams import PixelBeams
from sldvexp.verdict.comparison import bench_of
from sldvexp.verdict.drop_outs import disagreeing, drop_outs, outliers, resting

from .simulated_views import session


def seen(made, view):
    return PixelBeams.trace(view, made.surface, np.flatnonzero(view.usable)).pixel


def spoil(rng, view, pixels, size=0.02):
    velocity = view.velocity.copy()
    shape = (len(pixels), velocity.shape[1])
    velocity[pixels] = size * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
    return replace(view, velocity=velocity)


def test_hardly_a_good_pixel_is_lost():
    lost = total = 0
    for seed in range(6):
        made = session(np.random.default_rng(seed))
        for view in made.views:
            among = seen(made, view)
            lost += int((drop_outs(view, among) | resting(view, among)).sum())
            total += len(among)
    assert lost <= 1e-3 * total


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


def test_hole_is_found_as_a_patch_at_rest():
    rng = np.random.default_rng(1)
    made = session(rng)
    view = made.views[0]
    beams = PixelBeams.trace(view, made.surface, np.flatnonzero(view.usable))
    x, y, _ = beams.point.T
    hole = beams.pixel[(np.abs(x + 0.03) < 0.02) & (np.abs(y) < 0.02)]
    marked = resting(spoil(rng, view, hole, 1e-4), beams.pixel)
    assert marked[hole].mean() >= 0.8
    far = beams.pixel[(np.abs(x + 0.03) > 0.035) | (np.abs(y) > 0.035)]
    assert not marked[far].any()


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
        for data, design, out in zip(bench.data, fit.designs, disagreeing(fit), strict=True)
    ]
    assert len(set(bad.tolist()) & marked[1]) >= 10
    assert sum(map(len, marked)) - len(bad) <= 5e-3 * sum(len(d.pixel) for d in bench.data)
