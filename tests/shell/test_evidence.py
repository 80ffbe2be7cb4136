"""Averages over weights: the posterior by direct means, exact data, coverage."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.shell import WeightedFit
from sldvexp.shell.columns import SignalColumns
from sldvexp.shell.evidence import Level
from sldvexp.shell.functionals import Rows
from sldvexp.shell.nuisances import ErrorEquations

ROWS, COEFFICIENTS = 60, 12


def problem(seed=0):
    rng = np.random.default_rng(seed)
    design = rng.normal(size=(ROWS, COEFFICIENTS))
    smooth, proper = np.zeros((2, COEFFICIENTS, COEFFICIENTS))
    smooth[2:6, 2:6] = np.diag([1.0, 2, 3, 4])
    proper[6:, 6:] = np.eye(6)
    return rng, design, [smooth, proper]


def fitted(design, data, penalties, grids):
    return WeightedFit.of(
        design.T @ design, design.T @ data, (data**2).sum(axis=0), penalties, grids
    )


def evaluated(found, rows):
    """Give mean and variance of linear functionals, shape (functional, column) each."""
    columns = range(found.mean().shape[1])
    return Rows(rows).evaluate(found.mean(), [found.covariance(c) for c in columns])


def test_one_point_of_the_grid_is_the_ridge_regression():
    rng, design, penalties = problem()
    data = rng.normal(size=(ROWS, 2))
    found = fitted(design, data, penalties, [np.array([1.0]), np.array([2.0])])
    inverse = np.linalg.inv(design.T @ design + np.e * penalties[0] + np.e**2 * penalties[1])
    functional = rng.normal(size=(3, COEFFICIENTS))
    mean, variance = evaluated(found, functional)
    assert mean == pytest.approx(functional @ inverse @ design.T @ data)
    wanted = np.einsum("ij,jk,ik->i", functional, inverse, functional)
    assert variance == pytest.approx(np.tile(wanted[:, None], 2))
    assert found.mean() == pytest.approx(inverse @ design.T @ data)
    assert found.solve(design.T @ data, 0) == pytest.approx(found.mean())


def test_the_average_is_that_of_its_points():
    """Shares, means and the spread of the means, written down directly."""
    rng, design, penalties = problem(1)
    data = rng.normal(size=(ROWS, 1)) + design[:, 7:8]
    grids = [np.array([-1.0, 2.0]), np.array([0.0, 1.0, 3.0])]
    found = fitted(design, data, penalties, grids)
    functional = np.eye(COEFFICIENTS)[7:8]
    logs, means, variances = [], [], []
    for a in grids[0]:
        for b in grids[1]:
            precision = design.T @ design + np.exp(a) * penalties[0] + np.exp(b) * penalties[1]
            inverse = np.linalg.inv(precision)
            theta = inverse @ design.T @ data
            minus_twice = (
                (data**2).sum()
                - (data.T @ design @ theta).item()
                + np.linalg.slogdet(precision)[1]
                - 4 * a
                - 6 * b
                - np.log(24)
            )
            logs.append(-minus_twice / 2 - b / 2)
            means.append(theta[7, 0])
            variances.append(inverse[7, 7])
    share = np.exp(logs - np.max(logs))
    share /= share.sum()
    mean, variance = evaluated(found, functional)
    average = share @ means
    assert mean.item() == pytest.approx(average, rel=1e-2)
    spread = share @ (np.array(variances) + np.array(means) ** 2) - average**2
    assert variance.item() == pytest.approx(spread, rel=1e-2)


@pytest.mark.whole
def test_intervals_hold_as_often_as_they_say():
    """Coefficients drawn from the priors with weights from the grid; 400 draws, 12 coefficients."""
    rng, design, penalties = problem(2)
    grids = [np.arange(-2.0, 5.0, 1.0), np.arange(-2.0, 9.0, 1.0)]
    inside = []
    for _ in range(400):
        theta = 10 * rng.normal(size=COEFFICIENTS)
        theta[2:6] = rng.normal(size=4) / np.sqrt(np.exp(1.0) * np.diag(penalties[0])[2:6])
        theta[6:] = rng.normal(size=6) * np.exp(-rng.uniform(-2, 8) / 2)
        data = (design @ theta + rng.normal(size=ROWS))[:, None]
        mean, variance = evaluated(fitted(design, data, penalties, grids), np.eye(COEFFICIENTS))
        inside.append(np.abs(mean[:, 0] - theta) <= 1.96 * np.sqrt(variance[:, 0]))
    share = np.mean(inside)
    error = np.std(np.mean(inside, axis=1), ddof=1) / np.sqrt(400)
    assert abs(share - 0.95) < 0.005 + 3 * error
    assert error < 0.01


def columns_of(velocity, std, scale):
    """In two parts."""
    white = velocity / std[:, None] / scale
    whole = np.concatenate([white.real, white.imag], axis=1)
    return SignalColumns.of(lambda: np.array_split(whole, 2), scale)


def test_lines_are_put_together_from_their_columns():
    rng = np.random.default_rng(4)
    shapes, spectrum = rng.normal(size=(500, 2)), rng.normal(size=(2, 40)) @ np.eye(40)
    noise = rng.normal(size=(2, 500, 40))
    clean = 30 * shapes @ (spectrum * np.exp(0.3j))
    std, scale = rng.uniform(0.5, 2, 500), rng.uniform(0.5, 2, 40)
    velocity = clean + (noise[0] + 1j * noise[1]) * std[:, None] * scale
    columns = columns_of(velocity, std, scale)
    assert 2 <= columns.data.shape[1] <= 3
    lines = columns.combined(columns.data) * std[:, None]
    left = np.abs(lines - clean) / std[:, None] / scale
    assert np.sqrt(np.mean(left**2)) < 0.5  # of sqrt(2) that the noise has
    mean, variance = columns.lines(columns.data, np.ones_like(columns.data))
    assert mean == pytest.approx(columns.combined(columns.data))
    assert variance.shape == (2, 500, 40)


def test_a_single_line_keeps_both_of_its_parts():
    velocity = np.array([[1 + 2j], [3 - 1j], [0.5j]])
    columns = columns_of(velocity, np.ones(3), np.ones(1))
    assert columns.combined(columns.data) == pytest.approx(velocity)
    _, variance = columns.lines(columns.data, np.ones((3, 2)))
    assert variance == pytest.approx(1.0)


def test_errors_beside_the_field_by_one_regression():
    """The posterior of coefficients and errors together, of two columns."""
    rng, design, penalties = problem(5)
    jacobian, prior = rng.normal(size=(2, ROWS, 3)), np.diag([0.5, 1.0, 2.0])
    error = np.array([0.3, -1.0, 1.5])
    theta = rng.normal(size=(COEFFICIENTS, 2))
    data = np.stack([design @ theta[:, c] + jacobian[c] @ error for c in (0, 1)], axis=1)
    data += 0.1 * rng.normal(size=data.shape)
    found = fitted(design, data, penalties, [np.array([0.0]), np.array([0.0])])
    crossed = [design.T @ j for j in jacobian]
    products = np.stack([j.T @ y for j, y in zip(jacobian, data.T, strict=True)], axis=1)
    squares = np.stack([j.T @ j for j in jacobian])
    equations = ErrorEquations(prior, np.zeros(3), np.stack(crossed, axis=-1), products, squares)
    got = equations.known(found, equations.solved(found))
    size = 2 * COEFFICIENTS
    whole = np.zeros((size + 3, size + 3))
    right = np.zeros(size + 3)
    for c in (0, 1):
        own = slice(c * COEFFICIENTS, (c + 1) * COEFFICIENTS)
        whole[own, own] = design.T @ design + sum(penalties)
        whole[own, size:] = crossed[c]
        whole[size:, own] = crossed[c].T
        whole[size:, size:] += jacobian[c].T @ jacobian[c]
        right[own], right[size:] = design.T @ data[:, c], right[size:] + products[:, c]
    whole[size:, size:] += np.linalg.inv(prior @ prior.T)
    inverse = np.linalg.inv(whole)
    assert got.mean == pytest.approx((inverse @ right)[size:])
    assert got.factor @ got.factor.T == pytest.approx(inverse[size:, size:])


def test_likelihood_of_weights_with_the_errors_integrated_over():
    """Differences of it between weights are those of the data's own normal distribution."""
    rng, design, penalties = problem(6)
    proper = 1e-2 * np.diag([1.0, 1.0, *np.zeros(COEFFICIENTS - 2)])
    jacobian, prior, at = rng.normal(size=(ROWS, 3)), rng.normal(size=(3, 3)), rng.normal(size=3)
    data = (design @ rng.normal(size=COEFFICIENTS) + rng.normal(size=ROWS))[:, None]
    grids = [np.array([-1.0, 0.5]), np.array([0.0, 1.0, 3.0])]
    normal = design.T @ design + proper
    found = WeightedFit.of(normal, design.T @ data, (data**2).sum(axis=0), penalties, grids)
    crossed = (design.T @ jacobian)[:, :, None]
    square = (jacobian.T @ jacobian)[None]
    equations = ErrorEquations(prior, at, crossed, jacobian.T @ data, square)
    got = np.array(found.density) + np.array(equations.gained(found))
    # Data from everything: y + J d0 = A theta + J L x + e.
    moved, spread = data[:, 0] + jacobian @ at, jacobian @ prior
    wanted = np.empty((2, 3))
    for i, a in enumerate(grids[0]):
        for k, b in enumerate(grids[1]):
            inverse = np.linalg.inv(proper + np.exp(a) * penalties[0] + np.exp(b) * penalties[1])
            covariance = np.eye(ROWS) + spread @ spread.T + design @ inverse @ design.T
            chi2 = moved @ np.linalg.solve(covariance, moved)
            wanted[i, k] = -(chi2 + np.linalg.slogdet(covariance)[1]) / 2 - b / 2
    assert got[:, :, 0] - got[0, 0, 0] == pytest.approx(wanted - wanted[0, 0], rel=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_levels_that_are_not_looked_at_do_not_count(seed):
    """Shares, means and covariances are those of a grid of which every level is looked at."""
    rng, design, penalties = problem(seed)
    theta = np.r_[rng.normal(size=2), 10.0 ** rng.uniform(-3, 1) * rng.normal(size=10)]
    data = 100 * (design @ theta)[:, None] + rng.normal(size=(ROWS, 2))
    grids = [np.arange(-20.0, 30.0, 1.5), np.arange(-12.0, 21.0, 1.5)]
    found = fitted(design, data, penalties, grids)
    each = [
        fitted(design, data, penalties, [grids[0][[k]], grids[1]]) for k in range(len(grids[0]))
    ]
    density = np.array([one.density[0] for one in each])
    share = np.exp(density - density.max(axis=(0, 1)))
    share /= share.sum(axis=(0, 1))
    share[share < 1e-3] = 0
    share /= share.sum(axis=(0, 1))
    used = share.any(axis=(1, 2))
    assert np.array(found.share) == pytest.approx(share[used], rel=1e-9, abs=1e-12)
    assert np.array(found.density) == pytest.approx(density[used])


def test_few_levels_are_looked_at(monkeypatch):
    """Those that count, the ends of the grid, and what lies halfway to them."""
    rng, design, penalties = problem(3)
    data = 100 * design @ rng.normal(size=(COEFFICIENTS, 2)) + rng.normal(size=(ROWS, 2))
    looked_at, of = [], Level.of
    monkeypatch.setattr(Level, "of", lambda *a: looked_at.append(a) or of(*a))
    fitted(design, data, penalties, [np.arange(-40.0, 60.0, 0.5), np.arange(-12.0, 21.0, 1.5)])
    assert len(looked_at) < 60


def test_round_off_at_all_weights_is_told():
    """Only the strongest prior makes the precision positive, by no more than round-off may be."""
    _, design, penalties = problem(8)
    outer = penalties[1].any(axis=1)
    normal = design.T @ design
    normal[outer] = normal[:, outer] = 0.0
    normal[outer, outer] = -1.0
    grids = [np.array([0.0]), np.array([-20.0, -10.0, 10.0])]
    right, squares = np.ones((COEFFICIENTS, 1)), np.array([1.0])
    with pytest.raises(np.linalg.LinAlgError):
        WeightedFit.of(normal, right, squares, penalties, grids)


def test_the_largest_that_data_allow_are_kept():
    """Of each column, a part of all shares from the smallest weight on."""
    rng, design, penalties = problem(7)
    data = rng.normal(size=(ROWS, 2)) + design[:, 6:8]
    grids = [np.array([0.0, 2.0]), np.arange(-2.0, 9.0)]
    found = fitted(design, data, penalties, grids)
    nothing = [np.zeros_like(own) for own in found.density]
    whole = np.exp(np.array(found.density) - np.max(found.density, axis=(0, 1)))
    whole /= whole.sum(axis=(0, 1))
    assert np.array(found.with_most(nothing, 1.0).share) == pytest.approx(np.array(found.share))
    for part in (0.1, 0.002):
        kept = np.array(found.with_most(nothing, part).share)
        assert kept.sum(axis=(0, 1)) == pytest.approx(1.0)
        for c in range(2):
            by_weight = whole[:, :, c].sum(axis=0)
            cut = int(np.searchsorted(np.cumsum(by_weight), part))
            wanted = whole[:, : cut + 1, c] / part
            wanted[:, cut] *= (part - by_weight[:cut].sum()) / by_weight[cut]
            # but for what is left out as negligible
            assert kept[:, : cut + 1, c] == pytest.approx(wanted, abs=3e-3)
            assert not kept[:, cut + 1 :, c].any()
