"""Views of one field: clean ones are believed, a wrong one is named with its kind."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom, chi2, ncx2

from sldvexp.field.bounds.pose_uncertainty import pose_covariance
from sldvexp.verdict import comparison
from sldvexp.verdict.comparison import TESTS, Bench, bench_of, compare_views
from sldvexp.verdict.diagnosis import _of_view, diagnose
from sldvexp.verdict.explanation import FAMILY, tells_views_apart
from sldvexp.verdict.joint_fit import JointFit

from .simulated_views import LOOSE, NOISE, TIGHT, Session, session

#: Mistakes with their sizes and the kinds that they are to be named.
GROSS = (
    ("sign", 0.0, "sign"),
    ("conjugate", 0.0, "conjugate"),
    ("rms", 0.0, "rms"),
    ("other", 0.0, "other_field"),
    ("gain", 0.03, "gain"),
    ("phase", np.radians(3.0), "phase"),
    ("rotation", np.radians(1.0), "pose"),
    ("offset", 3 * NOISE, "offset"),
)


def bench(made: Session) -> Bench:
    found = bench_of(made.views, made.surface, pose_covariance(made.views, None))
    assert found is not None
    return found


def rejected(sessions: int, first: int, views: int, std=LOOSE, noise=NOISE) -> int:
    """Count clean sessions with a rejected view."""
    count = 0
    for seed in range(first, first + sessions):
        on = bench(session(np.random.default_rng(seed), views, std, noise))
        count += compare_views(on, on.fit()).rejects
    return count


@pytest.mark.whole
def test_clean_views_are_believed():
    """At 1 % of 20 sessions three rejections have a probability of 0.001."""
    assert rejected(20, 0, 5) <= binom.isf(1e-3, 20, FAMILY)


@pytest.mark.long
@pytest.mark.parametrize("views", [4, 5, 6])
@pytest.mark.parametrize("noise", [NOISE, NOISE / 1.05], ids=["noise", "noise_5_percent_low"])
@pytest.mark.parametrize("std", [LOOSE, TIGHT], ids=["loose", "tight"])
def test_clean_views_are_rejected_once_in_a_hundred(views, noise, std):
    assert rejected(200, 1000, views, std, noise) / 200 <= 0.03


@pytest.mark.parametrize(("mistake", "size", "kind"), GROSS, ids=[m for m, *_ in GROSS])
def test_kind_of_a_mistake_explains_its_view_best(mistake, size, kind):
    """Of the view that is wrong; whether another one is wrong instead is not asked."""
    rng = np.random.default_rng(7)
    wrong, made = int(rng.integers(5)), {"pixels": 13, "frequencies": 1, "size": size}
    on = bench(session(rng, 5, mistakes={wrong: mistake}, **made))
    fit = on.fit()
    assert compare_views(on, fit).rejects
    tried = [t.ranked(on, fit.channels, 1.0) for t in _of_view(on, wrong, on.without(wrong))]
    assert min(tried, key=lambda t: t.criterion).kind == kind


@pytest.mark.whole
@pytest.mark.parametrize(("mistake", "size", "kind"), GROSS, ids=[m for m, *_ in GROSS])
def test_wrong_view_is_named_with_its_kind(mistake, size, kind):
    rng = np.random.default_rng(7)
    wrong = int(rng.integers(5))
    on = bench(session(rng, 5, mistakes={wrong: mistake}, size=size, pixels=21))
    fit = on.fit()
    assert compare_views(on, fit).rejects
    best, other = tells_views_apart(diagnose(on, fit))
    assert (best.view, best.kind, other) == ((wrong,), kind, None)


@pytest.mark.long
@pytest.mark.parametrize("views", [5, 6])
@pytest.mark.parametrize(
    ("mistake", "size", "kind", "detected", "right"),
    [
        *((m, s, k, 1.0, 0.95) for m, s, k in GROSS if k not in ("pose", "offset")),
        ("gain", 0.01, "gain", 0.95, 0.80),
        ("phase", np.radians(1.0), "phase", 0.95, 0.80),
        ("rotation", np.radians(1.0), "pose", 0.95, 0.95),
    ],
)
def test_mistakes_are_detected_and_named_as_often_as_promised(
    views, mistake, size, kind, detected, right
):
    seen, named = [], []
    for seed in range(50):
        rng = np.random.default_rng([views, seed])
        wrong = int(rng.integers(views))
        on = bench(session(rng, views, mistakes={wrong: mistake}, size=size))
        fit = on.fit()
        seen.append(compare_views(on, fit).rejects)
        if seen[-1]:
            best, _ = tells_views_apart(diagnose(on, fit))
            named.append(best.view == (wrong,) and best.kind == kind)
    assert np.mean(seen) >= detected
    assert np.mean(named) >= right


def seen_moved(seeds: range, std, size: float, pixels: int, lines: int, mistake="origin") -> float:
    """Count sessions that a test rejects as a view was moved, in any direction."""
    seen = []
    for seed in seeds:
        rng = np.random.default_rng([seed, 9])
        mistakes = {int(rng.integers(5)): mistake}
        made = session(rng, 5, std, pixels=pixels, frequencies=lines, mistakes=mistakes, size=size)
        on = bench(made)
        seen.append(compare_views(on, on.fit()).rejects)
    return float(np.mean(seen))


@pytest.mark.long
@pytest.mark.parametrize(
    ("std", "mistake", "size", "pixels", "lines", "power"),
    [
        (TIGHT, "rotation", np.radians(0.3), 31, 2, 0.997),
        (TIGHT, "origin", 2e-3, 31, 2, 0.88),
        (TIGHT, "origin", 2e-3, 40, 4, 0.97),
        (LOOSE, "origin", 10e-3, 31, 2, 0.76),
        (LOOSE, "origin", 10e-3, 40, 4, 0.90),
        (LOOSE, "origin", 20e-3, 31, 2, 0.99),
    ],
)
def test_wrong_poses_are_detected_as_often_as_the_information_allows(
    std, mistake, size, pixels, lines, power
):
    """Within three standard errors of the power of a chi-square with that information."""
    seen = seen_moved(range(50), std, size, pixels, lines, mistake)
    assert abs(seen - power) <= 3 * np.sqrt(power * (1 - power) / 50) + 0.02


def power_of(on: Bench, size: float, numbers: int) -> float:
    """Compute how often a move of a view is detected, over all views and directions.

    The score has the noncentrality ``d' I d`` of a move d.
    """
    fit, rng = on.fit(), np.random.default_rng(0)
    along = rng.standard_normal((500, 3))
    along *= size / np.linalg.norm(along, axis=1, keepdims=True)
    threshold = chi2.isf(FAMILY / (len(TESTS) * len(on.data)), numbers)
    found = []
    for k in range(len(on.data)):
        information = fit.score(k, fit.own_pose_columns(k)).information[3:, 3:]
        off = np.einsum("ni,ij,nj->n", along, information, along)
        found.append(ncx2.sf(threshold, numbers, off).mean())
    return float(np.mean(found))


@pytest.mark.whole
@pytest.mark.parametrize(
    ("std", "size", "pixels", "lines", "powers"),
    [
        (LOOSE, 10e-3, 31, 2, (0.69, 0.76, 0.84)),
        (LOOSE, 10e-3, 40, 4, (0.86, 0.90, 0.94)),
        (LOOSE, 10e-3, 60, 10, (0.97, 0.98, 0.99)),
        (LOOSE, 20e-3, 31, 2, (0.98, 0.99, 0.99)),
        (TIGHT, 2e-3, 31, 2, (0.86, 0.88, 0.91)),
        (TIGHT, 2e-3, 40, 4, (0.955, 0.965, 0.976)),
    ],
)
def test_no_test_detects_a_move_much_better_than_that_of_the_origin(
    std, size, pixels, lines, powers
):
    """Of six numbers, of three, and of the one that a test has that knows the direction."""
    on = bench(session(np.random.default_rng(0), 5, std, pixels=pixels, frequencies=lines))
    found = [power_of(on, size, numbers) for numbers in (6, 3, 1)]
    assert found == pytest.approx(powers, abs=0.01)


def test_noise_stated_too_low_rejects_no_view_and_is_told():
    on = bench(session(np.random.default_rng(3), noise=NOISE / 1.3))
    found = compare_views(on, on.fit())
    assert not found.rejects
    assert np.sqrt(found.misfit) == pytest.approx(1.3, abs=0.03)


def test_estimated_poses_are_nearer_to_the_true_ones_where_beams_hit():
    made = session(np.random.default_rng(11))
    on = bench(made)
    fit = on.again(on.fit())
    before, after = [], []
    for k, design in enumerate(fit.designs):
        moves = design.beams.point_by_pose
        truth = made.truth[k]
        before.append(np.sqrt(np.mean((moves @ truth) ** 2)))
        after.append(np.sqrt(np.mean((moves @ (truth - fit.poses[6 * k : 6 * k + 6])) ** 2)))
    assert np.linalg.norm(after) < np.linalg.norm(before)


def test_columns_of_a_pose_are_the_derivatives_of_what_is_predicted():
    """But for facets, which are flat where the normals turn: of small ones less than 1e-3."""
    on = bench(session(np.random.default_rng(5), 3, pixels=13, elements=32))
    m = np.random.default_rng(6).normal(size=(3 * on.smooth.count, 2))
    columns = on.as_stated[0].pose_columns(m)
    assert on.as_stated[0].present.all()
    for number in range(7):
        off = np.zeros(len(on.prior))
        off[number if number < 6 else -1] = 1e-6
        more, less = (on.design(0, sign * off) for sign in (1, -1))
        both = more.present & less.present
        there = [np.flatnonzero(both[d.present]) for d in (more, less)]
        one, other = (d.field[k] @ m for d, k in zip((more, less), there, strict=True))
        found = (one - other) / 2e-6
        np.testing.assert_allclose(columns[both, number], found, atol=1e-3 * np.abs(found).max())


def test_fit_at_the_stated_poses_is_made_once_for_data_that_stay(monkeypatch):
    """With other noise it is another one."""
    made = session(np.random.default_rng(3))
    bench = bench_of(made.views, made.surface, pose_covariance(made.views, None))
    anew = replace(bench, at_stated=None).fit()
    np.testing.assert_array_equal(bench.fit().poses, anew.poses)
    noisy = bench.with_noise(0, 2.0)
    np.testing.assert_array_equal(noisy.fit().poses, replace(noisy, at_stated=None).fit().poses)
    assert noisy.fit().squares != anew.squares
    fits = []

    def counted(*args):
        fits.append(JointFit(*args))
        return fits[-1]

    monkeypatch.setattr(comparison, "JointFit", counted)
    bench.fit()
    assert len(fits) == 1
    noisy.fit()
    assert len(fits) == 3
