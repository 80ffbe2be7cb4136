"""Ordinary and generalised least squares against their formulas, written out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sldvexp.reconstruction import Absolute, Combined, Model, Relative, Weights
from sldvexp.reconstruction.rows import parse

SEEDS = st.integers(0, 2**32 - 1)
FEW = settings(max_examples=25, deadline=None, derandomize=True)
ROWS = "2-1,3-1,4,5-4,6"


def scene(seed: int, views: int = 6) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(views, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    return (
        directions,
        rng.normal(size=views) + 1j * rng.normal(size=views),
        rng.uniform(1, 5, views),
    )


@given(seed=SEEDS)
@FEW
def test_generalised_least_squares(seed: int) -> None:
    directions, v, std = scene(seed)
    a = parse(ROWS, "123456").matrix
    weight = np.linalg.inv(a @ np.diag(std**2) @ a.T)
    g = a @ directions
    covariance = np.linalg.inv(g.T @ weight @ g)
    result = Combined(rows=ROWS).reconstruct(directions, v, std)
    np.testing.assert_allclose(result.covariance[0, :, :, 0], covariance, rtol=1e-6, atol=1e-8)
    expected = covariance @ g.T @ weight @ a @ v
    np.testing.assert_allclose(result.velocity[0, :, 0], expected, rtol=1e-6, atol=1e-7)
    left = a @ v - g @ expected
    assert result.chi_square is not None
    np.testing.assert_allclose(
        result.chi_square[0, 0], np.real(left.conj() @ weight @ left), rtol=1e-6
    )
    np.testing.assert_allclose(result.residuals()[:, 0, 0], left, rtol=1e-6, atol=1e-7)


@given(seed=SEEDS)
@FEW
def test_equal_weights_have_an_honest_covariance(seed: int) -> None:
    directions, v, std = scene(seed)
    a = parse(ROWS, "123456").matrix
    h = np.linalg.pinv(a @ directions) @ a
    result = Combined(rows=ROWS, weights=Weights.equal).reconstruct(directions, v, std)
    np.testing.assert_allclose(result.velocity[0, :, 0], h @ v, rtol=1e-7, atol=1e-8)
    np.testing.assert_allclose(
        result.covariance[0, :, :, 0], h @ np.diag(std**2) @ h.T, rtol=1e-6, atol=1e-8
    )


@given(seed=SEEDS)
@FEW
def test_weighted_differences_are_the_full_model(seed: int) -> None:
    """The dissertation's two ways round a common error are one, once differences are weighted."""
    directions, v, std = scene(seed)
    for noise in (None, std):
        relative = Relative().reconstruct(directions, v, noise)
        full = Absolute(model=Model.full).reconstruct(directions, v, noise)
        for field in ("velocity", "std", "confidence", "sse", "dof"):
            np.testing.assert_allclose(
                getattr(relative, field), getattr(full, field), rtol=1e-6, atol=1e-9
            )


@given(seed=SEEDS)
@FEW
def test_dependent_rows_add_nothing_when_weighted(seed: int) -> None:
    directions, v, std = scene(seed)
    every = ",".join(f"{j}-{i}" for i in range(1, 7) for j in range(i + 1, 7))
    one = Relative(rows=every).reconstruct(directions, v, std)
    other = Relative().reconstruct(directions, v, std)
    for field in ("velocity", "std", "dof", "chi_square"):
        np.testing.assert_allclose(getattr(one, field), getattr(other, field), rtol=1e-6, atol=1e-9)


def test_all_differences_weighted_equally_count_their_true_dof() -> None:
    """15 differences of 6 views carry 5 values; weighted equally they are the full model."""
    directions, v, _ = scene(7)
    every = ",".join(f"{j}-{i}" for i in range(1, 7) for j in range(i + 1, 7))
    one = Relative(rows=every, weights=Weights.equal).reconstruct(directions, v)
    other = Absolute(model=Model.full).reconstruct(directions, v)
    assert one.dof[0] == pytest.approx(2 * (6 - 4))
    np.testing.assert_allclose(one.velocity, other.velocity, rtol=1e-9)
    np.testing.assert_allclose(one.std, other.std, rtol=1e-9)


def test_scale_of_given_std_is_kept() -> None:
    """Known noise gives normal bounds whatever the residuals; their chi-square judges it."""
    directions, v, std = scene(8)
    one = Absolute().reconstruct(directions, v, std)
    ten = Absolute().reconstruct(directions, v, 10 * std)
    np.testing.assert_allclose(ten.std, 10 * one.std, rtol=1e-12)
    assert one.noise_from == "given"
    assert one.factor[0] == pytest.approx(1.959964, abs=1e-6)
    assert one.chi_square is not None
    assert ten.chi_square is not None
    np.testing.assert_allclose(ten.chi_square, one.chi_square / 100, rtol=1e-12)
    np.testing.assert_allclose(ten.sse, one.sse, rtol=1e-12)
    mean_weight_one = 1 / std**2 / np.mean(1 / std**2)
    left = np.abs(one.residuals()[:, 0, 0]) ** 2
    assert one.sse[0, 0] == pytest.approx(np.sum(mean_weight_one * left))
    assert one.s[0, 0] == pytest.approx(np.sqrt(one.sse[0, 0] / (2 * (6 - 3))))
    assert one.chi_square_p_value is not None
    assert ten.chi_square_p_value is not None
    assert ten.chi_square_p_value[0, 0] > one.chi_square_p_value[0, 0]


def test_equal_std_change_nothing_but_the_scale_of_the_noise() -> None:
    directions, v, _ = scene(9)
    plain = Absolute().reconstruct(directions, v)
    given_std = Absolute().reconstruct(directions, v, np.full(6, 0.3))
    np.testing.assert_allclose(given_std.velocity, plain.velocity, rtol=1e-12)
    np.testing.assert_allclose(given_std.sse, plain.sse, rtol=1e-12)
    np.testing.assert_allclose(given_std.s, plain.s, rtol=1e-12)
    np.testing.assert_allclose(given_std.std / 0.3, plain.std / plain.s[:, None], rtol=1e-12)


@pytest.mark.parametrize("method", [Absolute(), Relative(), Absolute(model=Model.full)])
def test_std_may_change_with_point_and_frequency(method: Absolute | Relative) -> None:
    rng = np.random.default_rng(10)
    directions = rng.normal(size=(6, 4, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    v = rng.normal(size=(6, 4, 5)) + 1j * rng.normal(size=(6, 4, 5))
    std = rng.uniform(1, 3, (6, 4, 5))
    together = method.reconstruct(directions, v, std)
    fields = ("velocity", "std", "confidence", "sse", "chi_square", "covariance", "efficiency")
    for f in range(5):
        alone = method.reconstruct(directions, v[..., f], std[..., f])
        for field in fields:
            np.testing.assert_allclose(
                getattr(together, field)[..., f], getattr(alone, field)[..., 0], rtol=1e-9
            )
        np.testing.assert_allclose(
            together.residuals()[..., f], alone.residuals()[..., 0], rtol=1e-9, atol=1e-12
        )
    one_point = method.reconstruct(directions[:, 2], v[:, 2], std[:, 2])
    np.testing.assert_allclose(one_point.std[0], together.std[2], rtol=1e-9)
    by_point = method.reconstruct(directions, v, std[..., :1])
    for p in range(4):
        alone = method.reconstruct(directions[:, p], v[:, p], std[:, p, 0])
        np.testing.assert_allclose(by_point.std[p], alone.std[0], rtol=1e-9)
        np.testing.assert_allclose(by_point.velocity[p], alone.velocity[0], rtol=1e-9)
