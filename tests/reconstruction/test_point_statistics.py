"""Monte Carlo: scatter against the Cramer-Rao bound, and how often the bounds hold."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.reconstruction import Absolute, Combined, Model, Reconstruction, Relative, Weights

TRIALS = 4000
SIGMA = 0.03
VELOCITY = np.array([-0.07, -0.08, -0.57])
INTERCEPT = 0.6
DIRECTIONS = np.array(  # Table 5.4
    [
        [-0.0095, 0.2203, 0.9754],
        [0.3488, 0.2398, 0.9060],
        [0.1771, 0.1265, 0.9760],
        [-0.1378, -0.0837, 0.9869],
        [0.3337, -0.0712, 0.9400],
    ]
)
#: Four standard deviations of a share of 95 % among the trials.
COVERAGE = 4 * np.sqrt(0.95 * 0.05 / TRIALS)
#: Four standard deviations of a standard deviation over its expectation.
SCATTER = 4 / np.sqrt(2 * TRIALS)


def repeats(
    seed: int, real: bool, intercept: float = 0.0, scale: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The same five views at as many points as there are trials, each with its own noise."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(5, TRIALS)) + (0 if real else 1j) * rng.normal(size=(5, TRIALS))
    noise = SIGMA * noise * (1.0 if scale is None else scale[:, None])
    seen = (DIRECTIONS @ VELOCITY + intercept)[:, None] + (noise.real if real else noise)
    return np.repeat(DIRECTIONS[:, None], TRIALS, axis=1), seen


def coverage(errors: np.ndarray, half_width: np.ndarray) -> np.ndarray:
    """Share of trials within the bounds, by component; of real and imaginary part if complex."""
    parts = [errors.real, errors.imag] if np.iscomplexobj(errors) else [errors]
    return np.array([np.mean(np.abs(part) < half_width, axis=0) for part in parts])


def test_the_bounds_of_this_file_are_within_those_asked_for() -> None:
    assert COVERAGE < 0.015
    assert SCATTER < 0.05


@pytest.mark.parametrize("real", [True, False])
@pytest.mark.parametrize("model", Model)
def test_scatter_and_coverage_of_absolute(model: Model, real: bool) -> None:
    full = model is Model.full
    directions, seen = repeats(11, real, INTERCEPT if full else 0.0)
    result = Absolute(model=model).reconstruct(directions, seen)
    design = np.column_stack([DIRECTIONS, np.ones(5)]) if full else DIRECTIONS
    bound = SIGMA * np.sqrt(np.diag(np.linalg.inv(design.T @ design)))
    errors, half_width = result.velocity[..., 0] - VELOCITY, result.confidence[..., 0]
    if full:
        assert result.intercept is not None
        assert result.intercept_std is not None
        errors = np.column_stack([errors, result.intercept[:, 0] - INTERCEPT])
        width = result.intercept_std * result.factor[:, None]
        half_width = np.column_stack([half_width, width])
    np.testing.assert_allclose(np.std(errors.real, axis=0) / bound, 1, atol=SCATTER)
    np.testing.assert_allclose(coverage(errors, half_width), 0.95, atol=COVERAGE)
    if not real:
        np.testing.assert_allclose(np.std(errors.imag, axis=0) / bound, 1, atol=SCATTER)
    per_point = (1 if real else 2) * (5 - design.shape[1])
    assert np.all(result.dof == per_point)
    spread = 4 * np.sqrt(2 / (TRIALS * per_point))
    assert np.mean(result.s**2) / SIGMA**2 == pytest.approx(1, abs=spread)


@pytest.mark.parametrize("real", [True, False])
@pytest.mark.parametrize("weights", Weights)
def test_coverage_with_given_std(weights: Weights, real: bool) -> None:
    scale = np.array([1, 3, 0.5, 2, 1.0])
    directions, seen = repeats(12, real, scale=scale)
    result = Absolute(weights=weights).reconstruct(directions, seen, SIGMA * scale)
    errors = result.velocity[..., 0] - VELOCITY
    np.testing.assert_allclose(coverage(errors, result.confidence[..., 0]), 0.95, atol=COVERAGE)
    p_value = result.chi_square_p_value
    assert p_value is not None
    # Uniform if the chi-square has the right degrees of freedom.
    for level in (0.05, 0.5, 0.95):
        share = np.mean(p_value < level)
        assert share == pytest.approx(level, abs=4 * np.sqrt(level * (1 - level) / TRIALS))


@pytest.mark.parametrize("real", [True, False])
def test_coverage_of_equally_weighted_differences(real: bool) -> None:
    """Satterthwaite's degrees of freedom: an approximation, within 1.5 % of the level here."""
    directions, seen = repeats(13, real)
    result = Relative(weights=Weights.equal).reconstruct(directions, seen)
    errors = result.velocity[..., 0] - VELOCITY
    np.testing.assert_allclose(
        coverage(errors, result.confidence[..., 0]), 0.95, atol=COVERAGE + 0.015
    )
    mean = np.mean(result.s**2) / SIGMA**2
    assert mean == pytest.approx(1, abs=4 * np.sqrt(2 / (TRIALS * result.dof[0])))


@pytest.mark.parametrize("real", [True, False])
@pytest.mark.parametrize("method", [Absolute(rows="1,2,3"), Relative(rows="best"), Combined()])
def test_bounds_with_the_noise_of_all_views_are_on_the_safe_side(
    method: Reconstruction, real: bool
) -> None:
    directions, seen = repeats(14, real)
    result = method.reconstruct(directions, seen)
    assert result.noise_from == "views"
    errors = result.velocity[..., 0] - VELOCITY
    assert np.all(coverage(errors, result.confidence[..., 0]) > 0.95 - COVERAGE)
    v = result.std[..., 0] ** 2
    ratio = np.std(errors.real, axis=0) / np.sqrt(np.mean(v, axis=0))
    spread = 4 * np.sqrt(2 / (TRIALS * result.dof[0])) / 2
    np.testing.assert_allclose(ratio, 1, atol=SCATTER + spread)


@pytest.mark.parametrize("real", [True, False])
def test_f_test_of_an_absent_intercept_rejects_one_in_twenty(real: bool) -> None:
    directions, seen = repeats(15, real)
    test = Absolute(model=Model.full).reconstruct(directions, seen).intercept_test
    assert test is not None
    assert np.mean(test.reject) == pytest.approx(0.05, abs=COVERAGE)
    assert test.dof[0].flat[0] == (1 if real else 2)
    assert test.dof[1].flat[0] == (1 if real else 2)


def test_f_test_sees_a_large_intercept() -> None:
    directions, seen = repeats(16, False, intercept=20.0)
    test = Absolute(model=Model.full).reconstruct(directions, seen).intercept_test
    assert test is not None
    assert np.mean(test.reject) > 0.95
