"""What the reconstruction of a field gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.field.visibility.coverage import Coverage
from sldvexp.reconstruction.rows import RowSet
from sldvexp.statistics import FTest
from sldvexp.typing import Array, BoolArray, ComplexArray

#: Components of velocities, and parts of complex numbers.
WORLD, LOCAL = ("x", "y", "z"), ("t1", "t2", "n")
PARTS = ("real", "imaginary")


@dataclass(frozen=True, eq=False)
class FieldResult:
    """Nodal velocities with bounds; what is not determined is NaN and has a flag.

    Attributes
    ----------
    components : tuple of str
        x, y, z, or t1, t2, n of each node's own frame.
    velocity : ndarray of complex, shape (node, component, frequency), m/s
    std_noise : ndarray, shape (node, component, frequency), m/s, optional
        Standard error from the velocities' noise, of real and imaginary part each.
    std_pose : ndarray, shape (part, node, component, frequency), m/s, optional
        From the poses' covariance, of the real and of the imaginary part: an error of a pose moves
        all velocities together, and shows in the part where the velocity is.
    std_by_part, confidence_by_part : ndarray, shape (part, node, component, frequency), optional
        Standard error of both together, and half-width of the interval.
    intercept, intercept_std : ndarray, shape (node, frequency), optional, m/s
        Of the full model; the latter of the larger part.
    observable : ndarray of bool, shape (node, component)
    flagged_node : ndarray of int, shape (flagged,)
        Nodes where not all components are determined.
    flagged_rank : ndarray of int, shape (flagged,)
        How many directions are.
    flagged_direction : ndarray, shape (flagged, 3, 3)
        Orthonormal, in the components' axes; the first `rank` are determined.
    rows : RowSet
    unknowns : int
        Of one equation: of all components together, or of one for the contravariant method.
    samples : int
        Scalar rows as Table 5.7 counts them: rows of samples, twice the samples (real and
        imaginary) for the contravariant method.
    sse : ndarray, shape (equation, frequency), m2/s2
        Sum of squares that is minimised; an equation for each component, or one.
    residual_std : ndarray, shape (equation, frequency), m/s
        ``sqrt(sse / samples)``, as Table 5.7 prints it.
    s : ndarray, shape (equation, frequency), m/s
        Of a real component, with the degrees of freedom that are left.
    residual_std_by_view : ndarray, shape (view, frequency), m/s
    residual_std_by_row : ndarray, shape (row, frequency), m/s
    chi2_ratio : ndarray, shape (equation, frequency), optional
        `sse` over its expectation from the pixels' noise.
    cond, rcond : float
        Of the normal equations' matrix: largest over smallest eigenvalue, and the reciprocal
        condition number in the 1-norm.
    intercept_test : FTest, optional
        Full against partial model, as if samples were independent.
    efficiency : ndarray, shape (node, component), optional
        Gauss-Markov bound of all views over this method's variance, at a node's samples.
    bounds_error : float
        Largest relative error of `std_noise` found where it was computed exactly.
    coverage : tuple of Coverage
        What each view sees.
    messages : tuple of str
    """

    components: tuple[str, ...]
    velocity: ComplexArray
    std_noise: Array | None
    std_pose: Array | None
    std_by_part: Array | None
    confidence_by_part: Array | None
    intercept: ComplexArray | None
    intercept_std: Array | None
    observable: BoolArray
    flagged_node: NDArray[np.int_]
    flagged_rank: NDArray[np.int_]
    flagged_direction: Array
    rows: RowSet
    unknowns: int
    samples: int
    sse: Array
    residual_std: Array
    s: Array
    residual_std_by_view: Array
    residual_std_by_row: Array
    chi2_ratio: Array | None
    cond: float
    rcond: float
    intercept_test: FTest | None
    efficiency: Array | None
    bounds_error: float
    coverage: tuple[Coverage, ...]
    messages: tuple[str, ...]

    @property
    def std(self) -> Array | None:
        """Standard error of the larger of both parts, shape (node, component, frequency)."""
        return None if self.std_by_part is None else self.std_by_part.max(axis=0)

    @property
    def confidence(self) -> Array | None:
        """Half-width that holds for both parts, shape (node, component, frequency)."""
        return None if self.confidence_by_part is None else self.confidence_by_part.max(axis=0)
