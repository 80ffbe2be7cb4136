"""What one view sees of points in space: where in its image, from where, and with which weights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.field.visibility.occlusion import Occlusion
from sldvexp.field.visibility.two_mirror_projection import pose_derivative, sight
from sldvexp.field.visibility.view import View
from sldvexp.image.interpolation.base import Interpolator
from sldvexp.image.interpolation.methods import Interpolation
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, ComplexArray, IndexArray

#: Steepest accepted angle between the surface's normal and the direction to the instrument, rad.
GRAZING = np.radians(75.0)

BEHIND = "behind the instrument"
OFF_BOARD = "off the board"
FACING_AWAY = "occluded or facing away"
OUTSIDE = "outside the image"
FLAGGED = "flagged"


@dataclass(frozen=True, eq=False)
class Seen:
    """What one view sees of the sample points.

    Parameters
    ----------
    valid : ndarray of bool, shape (sample,)
        Where the view has a velocity.
    directions : ndarray, shape (sample, 3)
        Unit vectors from the surface to the instrument, ``v = V . D``, in world axes.
    weights : csr_array, shape (sample, pixel)
        Of the pixels' velocities; rows are empty where not `valid`.
    gradient : pair of csr_array, shape (sample, pixel), 1/step
        Derivatives of `weights` by the up_down and by the left_right step.
    dac : ndarray, shape (sample, 2), steps
        Where the samples are in the image, not rounded; NaN behind the instrument and off the
        board.
    lost : dict of str to int
        How many samples have no velocity, by the reason.
    """

    valid: BoolArray
    directions: Array
    weights: scipy.sparse.csr_array
    gradient: tuple[scipy.sparse.csr_array, scipy.sparse.csr_array]
    dac: Array
    lost: dict[str, int]

    def velocity(self, view: View) -> ComplexArray:
        """Interpolated velocities, shape (sample, frequency), m/s; 0 where not `valid`."""
        return np.asarray(self.weights @ view.velocity)

    def std(self, view: View) -> Array:
        """Standard errors of `velocity`, shape (sample,), m/s; 0 where not `valid`.

        ``sqrt(sum w^2 std^2)``, the errors of different pixels being independent; the root mean
        square over the frequencies where the pixels' errors change with them.
        """
        square = np.square(view.std).reshape(len(view.std), -1).mean(axis=1)
        return np.sqrt(self.weights.power(2) @ square)

    def pose_derivative(self, view: View, laser: TwoMirror, points: Array) -> tuple[Array, Array]:
        """How the samples' image points and directions change with the pose.

        Parameters
        ----------
        view : View
        laser : TwoMirror
        points : ndarray, shape (sample, 3), m
            Those that were looked at.

        Returns
        -------
        dac : ndarray, shape (sample, 2, 6), steps/rad and steps/m
        directions : ndarray, shape (sample, 3, 6), 1/rad and 1/m
            By the rotation vector w of ``R -> exp([w]) R`` and by the origin, the order of
            `View.covariance`; 0 where `dac` is NaN.
        """
        return pose_derivative(view, laser, points, self.dac)


def look(
    view: View,
    laser: TwoMirror,
    points: Array,
    normals: Array | None,
    method: Interpolation | Interpolator,
    *,
    grazing: float = GRAZING,
    occlusion: Occlusion | None = None,
) -> Seen:
    """Find sample points in a view's image (Section 5.3.5). Any number at once, or block by block.

    Parameters
    ----------
    view : View
    laser : TwoMirror
    points : ndarray, shape (sample, 3), m
        In the world.
    normals : ndarray, shape (sample, 3), optional
        Unit normals of the surface on the side that is measured; without them every point is
        taken to face the instrument.
    method : Interpolation or Interpolator
        ``method.prepare(view)`` makes the latter once for all blocks.
    grazing : float, rad
        Points seen under a larger angle from their normal are left out.
    occlusion : Occlusion, optional
        What stands in the way.

    Raises
    ------
    UserError
        If the image cannot be interpolated; see `Interpolation.prepare`.
    """
    interpolator = method.prepare(view) if isinstance(method, Interpolation) else method
    found = sight(view, laser, points)
    before = ~(found.behind | found.off_board)
    away = np.zeros(len(points), bool)
    if normals is not None:
        away = before & (np.einsum("si,si->s", normals, found.directions) < np.cos(grazing))
    if occlusion is not None:
        candidates = np.flatnonzero(before & ~away)
        away[candidates] = occlusion.hides(points[candidates])
    kept = np.flatnonzero(before & ~away)
    weights = interpolator.at(found.dac[kept])
    valid = np.zeros(len(points), bool)
    valid[kept] = ~(weights.outside | weights.flagged)
    reasons = {
        BEHIND: found.behind,
        OFF_BOARD: found.off_board,
        FACING_AWAY: away,
        OUTSIDE: weights.outside,
        FLAGGED: weights.flagged,
    }
    value, up_down, left_right = (
        _spread(w, kept, len(points)) for w in (weights.value, *weights.gradient)
    )
    lost = {reason: int(np.count_nonzero(where)) for reason, where in reasons.items()}
    return Seen(valid, found.directions, value, (up_down, left_right), found.dac, lost)


def _spread(
    weights: scipy.sparse.csr_array, rows: IndexArray, count: int
) -> scipy.sparse.csr_array:
    """The rows of a matrix as these rows of one with `count` rows, the others empty."""
    length = np.zeros(count + 1, weights.indptr.dtype)
    length[rows + 1] = np.diff(weights.indptr)
    start = np.cumsum(length, dtype=weights.indptr.dtype)
    # Of its own: some of scipy's methods sort a matrix in place, which others would share.
    indices = weights.indices.copy()
    return scipy.sparse.csr_array((weights.data, indices, start), shape=(count, weights.shape[1]))
