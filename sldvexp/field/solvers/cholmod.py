"""Right-hand sides for cholespy's factors."""

from __future__ import annotations

from typing import Any

import numpy as np

from sldvexp.field.equations.system import Solve
from sldvexp.typing import Array

#: Right-hand sides that cholespy takes at once.
COLUMNS_AT_ONCE = 128


def solve_with(factor: Any) -> Solve:
    """Solve with factors of a system's matrix."""

    def solve(right: Array) -> Array:
        flat = right.reshape(-1, right.shape[-1])
        solution = np.empty_like(flat)
        for first in range(0, flat.shape[1], COLUMNS_AT_ONCE):
            part = slice(first, first + COLUMNS_AT_ONCE)
            columns = np.ascontiguousarray(flat[:, part])
            found = np.zeros_like(columns)
            factor.solve(columns, found)
            solution[:, part] = found
        return solution.reshape(right.shape)

    return solve
