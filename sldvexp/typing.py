"""Arrays by what they hold, for annotations; shapes and units stand in docstrings."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

#: Real numbers.
Array: TypeAlias = NDArray[np.float64]
#: Complex amplitudes and the like.
ComplexArray: TypeAlias = NDArray[np.complex128]
#: Truth values, one an entry.
BoolArray: TypeAlias = NDArray[np.bool_]
#: Whole numbers: counts, DAC steps, labels.
IntArray: TypeAlias = NDArray[np.int64]
#: Places in other arrays.
IndexArray: TypeAlias = NDArray[np.intp]
