"""Stacks of small factorisations against numpy's, one by one."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.reconstruction import hadamard_condition, reciprocal_condition
from sldvexp.reconstruction.least_squares import factorise, rank_of


def stack(rows: int, parameters: int, rank: int, count: int = 20) -> np.ndarray:
    rng = np.random.default_rng(rows + 10 * parameters + 100 * rank)
    return rng.normal(size=(count, rows, rank)) @ rng.normal(size=(count, rank, parameters))


@pytest.mark.parametrize(
    ("rows", "parameters", "rank"),
    [(3, 3, 3), (5, 3, 3), (9, 4, 4), (4, 4, 4), (5, 3, 2), (5, 4, 3), (2, 3, 2), (1, 3, 1)],
)
def test_factor(rows: int, parameters: int, rank: int) -> None:
    matrices = stack(rows, parameters, rank)
    found = rank_of(matrices, 1e-6)
    np.testing.assert_array_equal(found, rank)
    factor = factorise(matrices, found)
    for k, matrix in enumerate(matrices):
        expected = np.linalg.pinv(matrix, rcond=1e-6)
        np.testing.assert_allclose(factor.inverse[k], expected, rtol=1e-7, atol=1e-7)
        residual = factor.residual[k]
        assert len(residual) == rows - rank
        np.testing.assert_allclose(residual @ residual.T, np.eye(rows - rank), atol=1e-12)
        np.testing.assert_allclose(residual @ matrix, 0, atol=1e-12)
        if rank == parameters:
            assert factor.null is None
        else:
            assert factor.null is not None
            null = factor.null[k]
            np.testing.assert_allclose(matrix @ null.T, 0, atol=1e-12)
            assert np.trace(null @ null.T) == pytest.approx(parameters - rank)


def test_different_ranks_in_one_stack() -> None:
    matrices = np.concatenate([stack(5, 3, 3), stack(5, 3, 2), stack(5, 3, 1)])
    rank = rank_of(matrices, 1e-6)
    np.testing.assert_array_equal(rank, np.repeat([3, 2, 1], 20))
    factor = factorise(matrices, rank)
    squares = np.einsum("kij,kij->k", factor.residual, factor.residual)
    np.testing.assert_allclose(squares, 5 - rank)


def test_nearly_dependent_columns_keep_their_digits() -> None:
    """Condition 1e4: an inverse by normal equations would be off by 1e-8."""
    matrices = stack(6, 3, 3)
    matrices[:, :, 2] = matrices[:, :, 0] + 1e-4 * matrices[:, :, 1]
    matrices[:, 0, 2] += 1e-4
    factor = factorise(matrices, rank_of(matrices, 1e-7))
    assert factor.null is None
    np.testing.assert_allclose(
        factor.inverse @ matrices, np.eye(3) + np.zeros((20, 1, 1)), atol=1e-10
    )


def test_condition_numbers() -> None:
    matrix = np.array([[3.0, 0, 0], [0, 2, 0], [0, 0, 1]])
    assert reciprocal_condition(matrix) == pytest.approx(1 / 3)
    assert hadamard_condition(matrix) == pytest.approx(1)
    sheared = np.array([[1.0, 2], [0, 3]])
    assert hadamard_condition(sheared) == pytest.approx(1 / np.sqrt(5))
    assert reciprocal_condition(sheared) == pytest.approx(1 / (5 * 1))  # inverse: 1, -2/3; 0, 1/3
    assert hadamard_condition(np.zeros((3, 3))) == 0
    assert reciprocal_condition(np.zeros((2, 3, 3))) == pytest.approx([0, 0])
    several = np.random.default_rng(6).normal(size=(4, 5, 3, 3))
    several[0, 0, 2] = several[0, 0, 1]
    expected = 1 / np.linalg.cond(several, 1)
    np.testing.assert_allclose(reciprocal_condition(several), expected, rtol=1e-12, atol=1e-15)
