"""Many lines fitted together: bounds hold what the few combinations of them do not."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.shell import WeightedFit, estimate_surface
from sldvexp.shell.columns import SignalColumns
from tests.shell import simulated_shell as lab
from tests.shell.sessions import LEVEL, ORIGIN, ROTATION

#: Lines over one resonance, Hz.
RESONANCE = tuple(np.arange(180.0, 221.0, 5.0))
TRUTH = lab.plate()


def held_and_squares(seed, pixels=(20, 21)):
    """Shares of intervals that hold, and mean squares of errors over standard errors, by axis."""
    rng = np.random.default_rng(5000 + seed)
    std = np.tile([ROTATION] * 3 + [ORIGIN] * 3, len(lab.PLACES))
    errors = (std * rng.normal(size=len(std))).reshape(-1, 6)
    views = lab.views(TRUTH, rng, pixels, noise=1e-5, frequency=RESONANCE, errors=errors)
    found = estimate_surface(
        views,
        lab.LASER,
        lab.volume(shape=(12, 10)),
        lab.method(),
        lab.SHEET,
        frequency=list(RESONANCE),
        covariance=np.diag(std**2),
    )
    fit, place = found.fit, found.fit.outline.corners
    frames, points = fit.outline.chart.frames(place), fit.outline.chart.points(place, fit.face)
    true = [np.einsum("pij,pj->pi", frames, TRUTH.velocity(points, f)) for f in RESONANCE]
    held, squares = [], []
    for i, rows in enumerate(fit.shell.velocity(place, fit.face)):
        value, own, others = fit.evaluate(rows)
        error = value - np.stack([t[:, i] for t in true], axis=-1)
        ratio = np.abs([error.real, error.imag]) / np.sqrt(own + others)
        held.append((ratio <= LEVEL).mean())
        squares.append((ratio**2).mean())
    return held, squares


@pytest.mark.parametrize(
    "sessions",
    [pytest.param(4, marks=pytest.mark.whole), pytest.param(30, marks=pytest.mark.long)],
)
def test_bounds_hold_signal_that_no_combination_of_lines_holds(sessions):
    """All lines of a resonance are in error together: a session is one draw.

    The stretch of the sheet depends on the frequency nearly as the other bending does, and what is
    left of it is seven standard errors and below what stands out.
    """
    found = np.array([held_and_squares(seed) for seed in range(sessions)])
    held, squares = found[:, 0].mean(axis=0), found[:, 1].mean(axis=0)
    # Over sessions they have standard deviations of 0.020 and 0.17, along the first axis.
    assert np.all(held > 0.95 - 3 * 0.020 / np.sqrt(sessions))
    assert np.all(squares < 1 + 3 * 0.17 / np.sqrt(sessions))


def test_signal_below_what_stands_out_is_found_by_its_energy():
    """Columns of noise alone, and with signal of twice the noise in the second block."""
    rng = np.random.default_rng(1)
    pixels, half, count, trials = 200, 12, 30, 40
    design = np.linalg.qr(rng.normal(size=(pixels, 2 * half)))[0]
    priors = [np.diag(np.repeat(first, half).astype(float)) for first in ([1, 0], [0, 1])]
    grids = (np.array([-2.0, 0.0]), np.array([-2.0, 0.0]))
    last = rng.normal(size=(pixels, 1))
    normal = design.T @ design
    fit = WeightedFit.of(normal, design.T @ last, (last**2).sum(axis=0), priors, grids)
    found = []
    for size in (0.0, 2.0):
        over = []
        for _ in range(trials):
            signal = np.zeros((2 * half, count))
            signal[half:] = size * rng.normal(size=(half, count))
            own = design.T @ (design @ signal + rng.normal(size=(pixels, count)))
            over.append(fit.overlooked(normal, own @ own.T, count))
        found.append(np.mean(over, axis=0))
    # Standard error of an energy over the energy; the mean of max(x + 1.645, 0) is 1.666 of it.
    error = np.sqrt(2 / count / half)
    none = np.array([found[0][0], found[0][1], found[1][0]])
    assert np.all(np.abs(none - 1.666 * error) < 4 * error / np.sqrt(trials))
    assert abs(found[1][1] - (4 + 1.645 * error)) < 4 * (1 + 4) * error / np.sqrt(trials)


def test_lines_are_left_out_as_far_as_no_column_holds_them():
    """All lines' shares together are the columns that are not fitted, and none if all are."""
    rng = np.random.default_rng(2)
    lines, scale = 9, np.ones(9)
    strong = 100 * rng.normal(size=(300, 1)) @ rng.normal(size=(1, 2 * lines))
    white = strong + rng.normal(size=(300, 2 * lines))
    columns = SignalColumns.of(lambda: [white], scale)
    assert columns.left_out.sum() == pytest.approx(2 * lines - 1)
    assert columns.of_left_out(np.array([2.0])).shape == (2, 1, lines)
    assert columns.of_left_out(np.array([2.0])).sum() == pytest.approx(2 * (2 * lines - 1))
    alone = SignalColumns.of(lambda: [white[:, [0, lines]]], scale[:1])
    assert not alone.left_out.any()
