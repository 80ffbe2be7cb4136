"""LINPACK's condition estimator: a bound, sharp for simple matrices."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.check.printed import linpack_rcond


def test_estimate_is_never_below_the_truth_and_rarely_far_above() -> None:
    rng = np.random.default_rng(9)
    ratio = []
    for _ in range(300):
        matrix = rng.normal(size=(n := rng.integers(2, 6), n))
        ratio.append(linpack_rcond(matrix) * np.linalg.cond(matrix, 1))
    assert min(ratio) >= 1 - 1e-9
    assert np.median(ratio) < 1.5
    assert max(ratio) < 10


@pytest.mark.parametrize(
    ("diagonal", "estimate"),
    # By hand: y = 1 / d, z = y / d, so the estimate is (1.75 / 1.3125) / 4 for the second.
    [([5, 5, 5], 1.0), ([1, 2, -4], 1 / 3), ([3.0], 1.0)],
)
def test_diagonal_matrices_by_hand(diagonal: list[float], estimate: float) -> None:
    assert linpack_rcond(np.diag(diagonal)) == pytest.approx(estimate)


def test_singular() -> None:
    assert linpack_rcond([[1, 2], [2, 4]]) == 0
