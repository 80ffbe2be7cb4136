"""Ellipses from edge points: exact, efficient, robust, and refused where not determined."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sldvexp.errors import UserError
from sldvexp.geometry import ConicFit, conic, conic_fit, fit_ellipse

METHODS = ("likelihood", "algebraic")
#: Semi-axes of about 67 and 56 steps, far from the origin.
ELLIPSE = np.array([-900.0, 1100.0, 65.0**2, 58.0**2, 300.0])
#: 2.5 times as long as wide: an oblique view.
SLENDER = np.array([2500.0, 300.0, 90.0**2, 36.0**2, 0.0])
STD = 0.3
SHAPES = {"slender": SLENDER, "round": ELLIPSE}
#: Repeats of a statistical test; its bounds are 4.5 standard errors, of a standard deviation
#: 1 / sqrt(2 n) and of a mean 1 / sqrt(n).
COUNT = 80
#: The dissertation's fine lines.
LINES = 44


def edge(ellipse: np.ndarray, n: int, arc: float = 2 * np.pi) -> tuple[np.ndarray, np.ndarray]:
    return conic.boundary(ellipse, np.arange(n) / n * arc + 0.2)


@functools.cache
def trials(shape: str, method: str, outliers: int = 0) -> list[ConicFit]:
    rng = np.random.default_rng(3 + outliers)
    ellipse = SHAPES[shape]
    points, normals = edge(ellipse, LINES)
    fits = []
    for _ in range(COUNT):
        error = rng.normal(0.0, STD, LINES)
        wrong = rng.choice(LINES, outliers, replace=False)
        error[wrong] += rng.uniform(2.0, 12.0, outliers) * rng.choice([-1, 1], outliers)
        fits.append(fit_ellipse(points + error[:, None] * normals, STD, normals, method=method))
    return fits


def bound(ellipse: np.ndarray) -> np.ndarray:
    """Cramer-Rao bound of the five numbers' standard deviations."""
    _, normals = edge(ellipse, LINES)
    jacobian = conic.distance_jacobian(normals, ellipse) / STD
    return np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))


@pytest.mark.parametrize("method", METHODS)
@given(
    x=st.floats(-4000, 4000),
    y=st.floats(-4000, 4000),
    a=st.floats(20, 200),
    ratio=st.floats(0.3, 1.0),
    turn=st.floats(0, 3.1),
    n=st.integers(6, 60),
)
@settings(max_examples=30, deadline=None)
def test_exact_edges_give_the_ellipse_back(
    method: str, x: float, y: float, a: float, ratio: float, turn: float, n: int
) -> None:
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    shape = rotation @ np.diag([a**2, (a * ratio) ** 2]) @ rotation.T
    ellipse = np.array([x, y, shape[0, 0], shape[1, 1], shape[0, 1]])
    fit = fit_ellipse(edge(ellipse, n)[0], 0.1, method=method)
    assert fit.ellipse.centre == pytest.approx(ellipse[:2], abs=1e-7)
    assert fit.ellipse.semi_axes == pytest.approx([a, a * ratio], abs=1e-7)
    assert np.abs(fit.residual).max() < 1e-7
    assert fit.outliers == 0


@pytest.mark.parametrize("method", METHODS)
def test_five_points_with_known_errors_are_enough(method: str) -> None:
    fit = fit_ellipse(edge(ELLIPSE, 5)[0], 0.1, method=method)
    assert fit.ellipse.parameters == pytest.approx(ELLIPSE, rel=1e-9)
    assert (fit.dof, fit.outliers) == (0, 0)


def test_algebraic_fit_is_least_squares_of_equation_4_19() -> None:
    """Its solution about the points' mean, moved back, fulfils the normal equations there."""
    rng = np.random.default_rng(1)
    points = edge(ELLIPSE, LINES)[0] + rng.normal(0.0, STD, (LINES, 2))
    fit = fit_ellipse(points, method="algebraic")
    x, y = (points - points.mean(axis=0)).T
    data = np.column_stack([x**2, y**2, x * y, x, y])
    solution = np.linalg.lstsq(data, -np.ones(LINES), rcond=None)[0]
    moved = fit.ellipse.parameters - np.array([*points.mean(axis=0), 0.0, 0.0, 0.0])
    assert conic.coefficients(moved) == pytest.approx(solution, rel=1e-9)


def test_origin_of_the_coordinates_does_not_matter() -> None:
    """Also where F = 1 is impossible: an ellipse through the origin."""
    rng = np.random.default_rng(2)
    points = edge(ELLIPSE, LINES)[0] + rng.normal(0.0, STD, (LINES, 2))
    for method in METHODS:
        far = fit_ellipse(points, STD, method=method).ellipse.parameters
        near = fit_ellipse(points - points[0], STD, method=method).ellipse.parameters
        assert near[2:] == pytest.approx(far[2:], rel=1e-9)
        assert near[:2] + points[0] == pytest.approx(far[:2], abs=1e-8)


@pytest.mark.whole
@pytest.mark.parametrize("shape", SHAPES)
def test_likelihood_reaches_the_cramer_rao_bound(shape: str) -> None:
    found, ellipse = trials(shape, "likelihood"), SHAPES[shape]
    error = np.array([f.ellipse.parameters - ellipse for f in found]) / bound(ellipse)
    assert np.all(np.abs(error.std(axis=0) - 1.0) < 4.5 / np.sqrt(2 * COUNT))
    assert np.all(np.abs(error.mean(axis=0)) < 4.5 / np.sqrt(COUNT))
    assert np.mean([f.outliers for f in found]) < 0.05
    chi_square = np.mean([f.chi_square for f in found])
    assert chi_square == pytest.approx(LINES - 5, abs=4.5 * np.sqrt(2 * (LINES - 5) / COUNT))


@pytest.mark.whole
def test_algebraic_fit_of_a_slender_ellipse_is_worse() -> None:
    """Eq 4.19 weighs a point by its gradient: more at the flat sides than at the ends.

    Both see the same noise, so that their ratio is known better than either.
    """
    spread = [
        np.std([f.ellipse.parameters for f in trials("slender", method)], axis=0)
        for method in ("algebraic", "likelihood")
    ]
    assert spread[0][0] > 1.1 * spread[1][0]


@pytest.mark.one_in(2)
@pytest.mark.parametrize("method", METHODS)
def test_stated_covariance_is_that_of_repeats(method: str) -> None:
    found = trials("slender", method)
    spread = np.std([f.ellipse.parameters for f in found], axis=0)
    stated = np.sqrt(np.diag(np.mean([f.ellipse.covariance for f in found], axis=0)))
    assert np.all(np.abs(spread / stated - 1.0) < 4.5 / np.sqrt(2 * COUNT))
    coefficients = np.std([f.ellipse.coefficients for f in found], axis=0)
    stated = np.sqrt(np.diag(found[0].ellipse.coefficients_covariance))
    assert np.all(np.abs(coefficients / stated - 1.0) < 4.5 / np.sqrt(2 * COUNT) + 0.05)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("method", METHODS)
def test_one_edge_in_ten_may_be_wrong(method: str) -> None:
    """The bound is that of the 40 good edges, at most a tenth above that of all 44."""
    wrong = 4
    found = trials("round", method, wrong)
    # an outlier of 2 steps is beyond 4 standard errors unless noise of -2.7 of them hides it
    assert np.mean([f.outliers for f in found]) == pytest.approx(wrong, abs=0.05)
    error = np.array([f.ellipse.parameters - ELLIPSE for f in found]) / bound(ELLIPSE)
    expected = np.sqrt(LINES / (LINES - wrong))
    assert np.all(np.abs(error.std(axis=0) / expected - 1.0) < 4.5 / np.sqrt(2 * COUNT))
    assert np.all(np.abs(error.mean(axis=0)) < 4.5 * expected / np.sqrt(COUNT))


def test_edges_far_off_do_not_pull_the_start() -> None:
    """A fifth of the edges a whole radius out, all on one side: where least squares is lost."""
    points, normals = edge(ELLIPSE, LINES)
    points[:9] += 60.0 * normals[:9]
    fit = fit_ellipse(points, 0.1)
    assert np.flatnonzero(~fit.used).tolist() == list(range(9))
    assert fit.ellipse.parameters == pytest.approx(ELLIPSE, rel=1e-9)


def test_start_of_the_same_edges_is_found_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever their errors are; changing what was given changes nothing for the next fit."""
    asked = []
    once = conic_fit.algebraic_conic
    monkeypatch.setattr(
        conic_fit, "algebraic_conic", lambda *args: [asked.append(1), once(*args)][1]
    )
    place = edge(np.array([0.1, 0.2, 0.6, 0.5, 0.1]), 24)[0]
    start = conic_fit.least_quantile(place)
    kept, count = start.copy(), len(asked)
    start += 1.0
    assert np.array_equal(conic_fit.least_quantile(place), kept)
    assert len(asked) == count > 0


@pytest.mark.whole
def test_unknown_standard_errors_are_estimated_from_the_residuals() -> None:
    rng = np.random.default_rng(6)
    points, normals = edge(ELLIPSE, LINES)
    estimates, fits = [], []
    for _ in range(COUNT):
        noisy = points + rng.normal(0.0, STD, (LINES, 1)) * normals
        fits.append(fit_ellipse(noisy))
        estimates.append(fits[-1].residual_std[0] ** 2)
    spread = STD**2 * np.sqrt(2.0 / (LINES - 5) / COUNT)
    assert np.mean(estimates) == pytest.approx(STD**2, abs=4.5 * spread)
    seen = np.std([f.ellipse.parameters for f in fits], axis=0)
    stated = np.sqrt(np.diag(np.mean([f.ellipse.covariance for f in fits], axis=0)))
    assert np.all(np.abs(seen / stated - 1.0) < 4.5 / np.sqrt(2 * COUNT))


@pytest.mark.whole
def test_errors_along_oblique_scan_lines_count_by_their_part_across_the_edge() -> None:
    """Horizontal lines: an edge that runs along them is known far better than its position."""
    rng = np.random.default_rng(7)
    points, normals = edge(ELLIPSE, LINES)
    along = np.tile([1.0, 0.0], (LINES, 1))
    steep = np.abs(normals[:, 0]) > 0.3
    points, normals, along = points[steep], normals[steep], along[steep]
    std = STD / np.abs(normals[:, 0])  # a blurred edge is as much longer along the line
    found = [
        fit_ellipse(points + rng.normal(0.0, std)[:, None] * along, std, along)
        for _ in range(COUNT)
    ]
    spread = np.std([f.ellipse.parameters for f in found], axis=0)
    stated = np.sqrt(np.diag(np.mean([f.ellipse.covariance for f in found], axis=0)))
    assert np.all(np.abs(spread / stated - 1.0) < 4.5 / np.sqrt(2 * COUNT))
    assert np.median(found[0].residual_std) == pytest.approx(STD, rel=0.01)


def hyperbola() -> np.ndarray:
    t = np.linspace(-1.5, 1.5, 20)
    branches = [np.stack([s * np.cosh(t), np.sinh(t)], axis=1) for s in (-1.0, 1.0)]
    return 100.0 * np.concatenate(branches) + 500.0


def bands() -> np.ndarray:
    """Edges near the two ends of a diameter only, with errors of a step."""
    turn = np.concatenate([np.linspace(-0.12, 0.12, 8), np.pi + np.linspace(-0.12, 0.12, 8)])
    points, normals = conic.boundary(ELLIPSE, turn)
    sign = np.where(np.arange(16) % 2, 0.2, -0.2)
    return points + sign[:, None] * normals


def with_nan() -> np.ndarray:
    points = edge(ELLIPSE, 10)[0]
    points[3, 1] = np.nan
    return points


@pytest.mark.parametrize(
    ("points", "std", "says"),
    [
        (np.empty((0, 2)), 0.1, "circle 3: an ellipse needs 5 edge points or more, not 0"),
        (edge(ELLIPSE, 4)[0], 0.1, "circle 3: an ellipse needs 5 edge points or more, not 4"),
        (edge(ELLIPSE, 5)[0], None, "circle 3: an ellipse needs 6 edge points or more, not 5"),
        (
            edge(ELLIPSE, 30, arc=1.0)[0],
            0.1,
            r"circle 3: its 30 edge points, over 60 deg of arc and between steps \(-874, 1116\) "
            r"and \(-836, 1155\), go round too little of it, an ellipse needs 120 deg or more; "
            r"scan lines that cross the rest of its edge",
        ),
        (
            hyperbola(),
            0.1,
            r"circle 3: its 40 edge points, .*, fit a hyperbola, not an ellipse; look whether they "
            r"belong to one circle and go around it",
        ),
        (
            bands(),
            1.0,
            r"circle 3: its 16 edge points, .*, leave a semi-axis uncertain by \d+ %, more than "
            r"10 %; scan more lines across its edge",
        ),
        (np.ones((9, 2)), 0.1, "circle 3: its 9 edge points, .*, lie on one line"),
        (np.arange(20.0).reshape(10, 2), 0.1, "circle 3: its 10 edge points, .*, lie on one line"),
        (with_nan(), 0.1, "circle 3: the position of edge point 3 must be finite"),
        (
            edge(ELLIPSE, 10)[0],
            np.array([0.1] * 7 + [0.0] * 3),
            "circle 3: the standard error of edge point 7 must be a positive number of steps, not",
        ),
    ],
    ids=["none", "four", "five", "arc", "hyperbola", "bands", "point", "line", "nan", "std"],
)
@pytest.mark.parametrize("method", METHODS)
def test_what_is_no_ellipse_is_refused_in_one_sentence(
    points: np.ndarray, std: float | None, says: str, method: str
) -> None:
    with pytest.raises(UserError, match=says):
        fit_ellipse(points, std, method=method, name="circle 3")


def test_unknown_method_names_the_valid_ones() -> None:
    with pytest.raises(UserError, match="algebra; did you mean algebraic\\? Valid: algebraic, lik"):
        fit_ellipse(edge(ELLIPSE, 10)[0], method="algebra")


def test_a_fit_goes_on_where_another_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the same points a little elsewhere: with the same outliers, and not from the beginning."""
    rng = np.random.default_rng(3)
    points, normals = edge(ELLIPSE, 44)
    points = points + rng.normal(0.0, STD, (44, 1)) * normals
    points[[5, 17]] += 30.0
    before = fit_ellipse(points, STD)
    assert np.flatnonzero(~before.used).tolist() == [5, 17]
    points = points + 2.0 * STD * normals
    anew = fit_ellipse(points, STD)

    def refused(position: np.ndarray) -> np.ndarray:
        raise AssertionError("begins anew")

    monkeypatch.setattr("sldvexp.geometry.conic_fit.least_quantile", refused)
    again = fit_ellipse(points, STD, start=before)
    np.testing.assert_array_equal(again.used, anew.used)
    np.testing.assert_allclose(again.ellipse.parameters, anew.ellipse.parameters, rtol=1e-9)
