"""What one view sees of points in space: where in its image, from where, and with which weights.

What all views see of the samples of a volume, some of its triangles at a time.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np

from sldvexp.field.threads import side_by_side
from sldvexp.field.visibility.occlusion import Occlusion
from sldvexp.field.visibility.two_mirror_projection import pose_derivative, sight
from sldvexp.field.visibility.view import View, require_usable
from sldvexp.image.interpolation.base import Interpolator
from sldvexp.image.interpolation.methods import Interpolation
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, ComplexArray, IndexArray
from sldvexp.volume.prisms import Prisms
from sldvexp.volume.samples import SampleRule, sample_frames, sample_positions

#: Steepest accepted angle between the surface's normal and the direction to the instrument, rad.
GRAZING = np.radians(75.0)

BEHIND = "behind the instrument"
OFF_BOARD = "off the board"
FACING_AWAY = "occluded or facing away"
OUTSIDE = "outside the image"
FLAGGED = "flagged"


@dataclass(frozen=True, eq=False)
class ViewSamples:
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


def project_samples(
    view: View,
    laser: TwoMirror,
    points: Array,
    normals: Array | None,
    method: Interpolation | Interpolator,
    *,
    grazing: float = GRAZING,
    occlusion: Occlusion | None = None,
) -> ViewSamples:
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
    return ViewSamples(valid, found.directions, value, (up_down, left_right), found.dac, lost)


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


#: Samples of a volume up to which what the views see of them is remembered.
CACHE_SAMPLES = 200_000


@dataclass(frozen=True, eq=False)
class SampleVisibility:
    """The samples in the prisms over some triangles, and what each view sees of them.

    Attributes
    ----------
    triangles : ndarray of int, shape (triangle,)
    seen : tuple of ViewSamples
        One a view; ``sample = (gap * triangles + triangle) * points + point``.
    position : ndarray, shape (sample, 3), m
    frame : ndarray, shape (sample, 3, 3)
        Unit rows t1, t2, n.
    """

    triangles: IndexArray
    seen: tuple[ViewSamples, ...]
    position: Array
    frame: Array

    @property
    def valid(self) -> BoolArray:
        """Which view has a velocity of which sample, shape (sample, view)."""
        return np.stack([s.valid for s in self.seen], axis=1)

    @property
    def directions(self) -> Array:
        """Direction cosines in world axes, shape (sample, view, 3)."""
        return np.stack([s.directions for s in self.seen], axis=1)


@dataclass(eq=False)
class VolumeVisibility:
    """Looks at a volume from all views.

    Parameters
    ----------
    views : sequence of View
    laser : TwoMirror
        As configured; see `View.laser`.
    prisms : Prisms
    rule : SampleRule
    interpolation : Interpolation
    grazing : float, rad
        Points seen under a larger angle from their normal are left out.
    one_sided : bool
        Only the side that the normals point to is measured; otherwise both.
    clearance : float, m, optional
        With it, what the surface itself hides is left out; see `Occlusion`.

    A look at the whole of a volume that is not large is remembered, so that several methods, and
    fields without one view, do not look again.
    """

    views: Sequence[View]
    laser: TwoMirror
    prisms: Prisms
    rule: SampleRule
    interpolation: Interpolation = Interpolation.linear
    grazing: float = GRAZING
    one_sided: bool = True
    clearance: float | None = None
    _interpolators: list[Interpolator] = field(init=False, repr=False)
    _occlusions: list[Occlusion | None] = field(init=False, repr=False)
    _whole: SampleVisibility | None = field(init=False, repr=False, default=None)

    def __post_init__(self) -> None:
        require_usable(self.views)
        self._interpolators = [self.interpolation.prepare(v) for v in self.views]
        self._occlusions = [self._occlusion(v) for v in self.views]

    def __getstate__(self) -> dict[str, Any]:
        """What another process needs; it remembers its own look."""
        return {**self.__dict__, "_whole": None}

    @property
    def names(self) -> tuple[str, ...]:
        """The views' names."""
        return tuple(v.name for v in self.views)

    @property
    def triangles(self) -> IndexArray:
        """All of them."""
        return np.arange(len(self.prisms.triangles))

    @property
    def fits_in_cache(self) -> bool:
        """Whether a look at all of it is remembered."""
        return self.prisms.gaps * len(self.prisms.triangles) * self.rule.points <= CACHE_SAMPLES

    def at(self, triangles: IndexArray) -> SampleVisibility:
        """Look at the samples of some triangles' prisms, in all gaps."""
        if self._whole is not None and np.array_equal(triangles, self._whole.triangles):
            return self._whole
        found = self._look(triangles)
        if self.fits_in_cache and np.array_equal(triangles, self.triangles):
            self._whole = found
        return found

    def without(self, k: int) -> Self:
        """The looks of all other views, with all that is prepared and remembered of them."""
        others = [i for i in range(len(self.views)) if i != k]
        left = copy(self)
        left.views = [self.views[i] for i in others]
        left._interpolators = [self._interpolators[i] for i in others]
        left._occlusions = [self._occlusions[i] for i in others]
        if self._whole is not None:
            left._whole = replace(self._whole, seen=tuple(self._whole.seen[i] for i in others))
        return left

    def seen_by(self, views: Sequence[View]) -> Self:
        """The looks of the same images from poses that are other ones."""
        moved = copy(self)
        moved.views, moved._whole = views, None
        moved._occlusions = [moved._occlusion(v) for v in views]
        return moved

    def _look(self, triangles: IndexArray) -> SampleVisibility:
        position = sample_positions(self.prisms, self.rule, triangles).reshape(-1, 3)
        frame = sample_frames(self.prisms, self.rule, triangles).reshape(-1, 3, 3)

        def seen_by(k: int) -> ViewSamples:
            return project_samples(
                self.views[k],
                self.laser,
                position,
                frame[:, 2] if self.one_sided else None,
                self._interpolators[k],
                grazing=self.grazing,
                occlusion=self._occlusions[k],
            )

        seen = tuple(side_by_side(seen_by, range(len(self.views))))
        return SampleVisibility(triangles, seen, position, frame)

    def _occlusion(self, view: View) -> Occlusion | None:
        if self.clearance is None:
            return None
        middle = np.abs(self.prisms.depth).argmin()
        surface = self.prisms.position.reshape(self.prisms.layers, -1, 3)[middle]
        laser = view.laser(self.laser)
        return Occlusion.prepare(view, laser, surface, self.prisms.triangles, self.clearance)
