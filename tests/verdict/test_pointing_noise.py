"""Pointing noise is told from other noise that is not stated, with its size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.dataset import Severity
from sldvexp.field.bounds.pose_uncertainty import pose_covariance
from sldvexp.field.visibility.projection import angle_slope
from sldvexp.verdict.comparison import (
    _truncation,
    bench_of,
    compare_views,
    pixels_for,
    pixels_to_follow,
)
from sldvexp.verdict.drop_outs import disagree, disagreeing
from sldvexp.verdict.field_around import FieldAround
from sldvexp.verdict.joint_fit import JointFit
from sldvexp.verdict.pointing_noise import pointing_noise
from sldvexp.verdict.wording import noise_finding, pointing_finding

from .simulated_views import LASER, clean, session

#: Angle that spoils steep pixels as much as the stated noise does, rad.
ANGLE = 8e-4


def fitted(angle=0.0, white=0.0, seed=1) -> JointFit:
    """Fit views whose mirrors rest beside their steps, or whose noise is larger everywhere."""
    rng = np.random.default_rng(seed)
    made = session(rng)
    bench = bench_of(made.views, made.surface, pose_covariance(made.views, None))
    fit, data = bench.fit(), []
    for of, design in zip(bench.data, fit.designs, strict=True):
        turns = design.pose_columns(fit.m)[:, :2]
        drawn = angle * rng.standard_normal(turns.shape[:2])
        off = np.einsum("pi,pic->pc", drawn, turns) + white * rng.standard_normal(turns[:, 0].shape)
        real, imaginary = np.split(off, 2, axis=1)
        velocity = of.velocity.copy()
        velocity[design.present] += real + 1j * imaginary
        data.append(replace(of, velocity=velocity))
    return replace(bench, data=data).fit()


def step() -> float:
    """Give the angle of a DAC step about the middle, rad."""
    return float(np.abs(angle_slope(LASER, np.zeros(2))).mean())


@pytest.mark.one_in(2)
@pytest.mark.parametrize("seed", [1, 2])
def test_pointing_noise_is_found_with_its_size(seed):
    found = pointing_noise(fitted(angle=ANGLE, seed=seed), LASER)
    assert found == pytest.approx(ANGLE / step(), rel=0.1)


@pytest.mark.whole
@pytest.mark.parametrize("seed", [1, 2])
def test_noise_that_is_larger_everywhere_is_not_named_pointing(seed):
    assert pointing_noise(fitted(white=2.0, seed=seed), LASER) is None


@pytest.mark.whole
@pytest.mark.parametrize("seed", [1, 2])
def test_pixels_beside_which_mirrors_came_to_rest_are_no_drop_outs(seed):
    """Mirrors three times as bad as the noise."""
    fit = fitted(angle=3 * ANGLE, seed=seed)
    known = [3 * ANGLE] * len(fit.data)
    assert not disagree(fit, known)
    assert np.concatenate(disagreeing(fit, known)).mean() < 2e-3
    assert np.concatenate(disagreeing(fit, [0.0] * len(known))).mean() > 0.02


@pytest.mark.whole
@pytest.mark.parametrize("seed", [1, 2])
def test_drop_outs_among_pixels_beside_which_mirrors_came_to_rest_are_found(seed):
    fit = fitted(angle=3 * ANGLE, seed=seed)
    known = [3 * ANGLE] * len(fit.data)
    rng, data, bad = np.random.default_rng(seed), [], []
    for of, design in zip(fit.data, fit.designs, strict=True):
        bad.append(rng.random(int(design.present.sum())) < 0.02)
        velocity = of.velocity.copy()
        drawn = rng.standard_normal((2, bad[-1].sum(), velocity.shape[1]))
        velocity[np.flatnonzero(design.present)[bad[-1]]] = 1000 * (drawn[0] + 1j * drawn[1])
        data.append(replace(of, velocity=velocity))
    spoiled = JointFit(data, fit.designs, fit.prior, fit.standard)
    assert disagree(spoiled, known)
    marked, bad = np.concatenate(disagreeing(spoiled, known)), np.concatenate(bad)
    assert marked[bad].mean() > 0.95
    assert marked[~bad].mean() < 2e-3


def test_pointing_that_bounds_count_is_a_note_and_otherwise_has_a_remedy():
    _, bench, fit = clean()
    tests = compare_views(bench, fit)
    assert pointing_finding(tests, 1.0, 0.9).severity is Severity.note
    missing = pointing_finding(tests, 1.0, 0.4)
    assert missing.severity is Severity.doubtful
    assert missing.remedy == "laser.pointing_std=1"


def test_what_finer_knots_would_take_away_is_extrapolated():
    """Of errors as the fourth power of the knots' distance, a variance of 1 beside them."""

    def misfit(intervals: int) -> float:
        return 1.0 + 1e9 / intervals**8

    found = _truncation(misfit(7), misfit(10), 0.7)
    assert found == pytest.approx((misfit(10) - 1.0) / misfit(10))


def test_pixels_that_let_the_test_follow_a_field_are_counted():
    made, bench, fit = clean()
    few = replace(bench, truncation=0.02, intervals=10, few_pixels=True)
    # 0.02 * 20 is 0.4 times the noise, and 14 intervals have it below a tenth of that.
    assert pixels_to_follow(few, 20.0) == pixels_for(FieldAround.on(made.surface.nodes, 14))
    assert pixels_to_follow(few, 10.0) is None  # of what is left the noise hides 0.2
    assert pixels_to_follow(replace(few, few_pixels=False), 20.0) is None
    assert pixels_to_follow(replace(few, truncation=0.9, intervals=18), 1e6) is None
    tests = replace(compare_views(bench, fit), misfit=20.0)
    assert "with 473 pixels of each view on the surface, instead of 306" in (
        noise_finding(tests, pixels=(306, 473)).text
    )
    assert "pixels of each view" not in noise_finding(tests).text


def test_a_bench_knows_whether_its_pixels_are_few():
    made, bench, _ = clean()
    covariance = pose_covariance(made.views, None)
    assert not bench.few_pixels
    thinned = []
    for view in made.views:
        flags = np.ones_like(view.flags)
        flags[np.flatnonzero(view.usable)[::12]] = 0
        thinned.append(replace(view, flags=flags))
    assert bench_of(thinned, made.surface, covariance).few_pixels
