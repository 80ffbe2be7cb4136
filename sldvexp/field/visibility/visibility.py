"""Visibility of a volume's samples from all views, for some of its triangles at a time.

The visibility of the whole of a volume that is not large is remembered, so that several methods,
and fields without one of the views, do not project its samples again.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from sldvexp.dataset import Finding
from sldvexp.field.threads import side_by_side
from sldvexp.field.visibility.background import background_findings, without_background
from sldvexp.field.visibility.projection import GRAZING, Occlusion, ViewSamples, project_samples
from sldvexp.field.visibility.view import View, require_usable
from sldvexp.image import Interpolation, Interpolator
from sldvexp.laser import TwoMirror
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IndexArray
from sldvexp.volume import Prisms, SampleRule, Volume, sample_positions
from sldvexp.volume.samples import sample_frames

#: Samples of a volume up to which what the views see of them is remembered.
CACHE_SAMPLES = 200_000
#: Bytes of matrices of the interpolation's errors up to which they are remembered.
CACHE_ERRORS = 2**26


@dataclass(frozen=True, eq=False)
class SampleVisibility:
    """Samples in the prisms over some triangles, and what each view sees of them.

    Attributes
    ----------
    triangles : ndarray of int, shape (triangle,)
    by_view : tuple of ViewSamples
        One a view; ``sample = (gap * triangles + triangle) * points + point``.
    position : ndarray, shape (sample, 3), m
    frame : ndarray, shape (sample, 3, 3)
        Unit rows t1, t2, n.
    points : int
        Samples of a prism.
    """

    triangles: IndexArray
    by_view: tuple[ViewSamples, ...]
    position: Array
    frame: Array
    points: int

    @cached_property
    def valid(self) -> BoolArray:
        """Samples that a view has a velocity of, shape (sample, view)."""
        return np.stack([s.valid for s in self.by_view]).T

    @cached_property
    def directions(self) -> Array:
        """Direction cosines in world axes, shape (sample, view, 3); the samples are contiguous."""
        return np.moveaxis(np.stack([s.directions.T for s in self.by_view]), -1, 0)

    def over(self, triangles: IndexArray) -> SampleVisibility:
        """Take the samples over some of the triangles."""
        place = np.searchsorted(self.triangles, triangles)
        number = np.arange(len(self.position)).reshape(-1, len(self.triangles), self.points)
        some = number[:, place].ravel()
        views = tuple(seen.of(some) for seen in self.by_view)
        return replace(
            self,
            triangles=triangles,
            by_view=views,
            position=self.position[some],
            frame=self.frame[some],
        )


@dataclass(eq=False)
class VolumeVisibility:
    """Samples of a volume as all views see them.

    Parameters
    ----------
    laser : TwoMirror
        As configured; see `View.laser`.
    interpolation : Interpolation
        The chosen one where `Interpolation.auto` was given.
    grazing : float, rad
        Points seen under a larger angle from their normal are left out.
    one_sided : bool
        Only the side that the normals point to is measured; otherwise both.
    clearance : float, m, optional
        With it, what the surface itself hides is left out; see `Occlusion`.
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
    _errors: list[scipy.sparse.csr_array] | None = field(init=False, repr=False, default=None)
    #: What fits of these views by several methods and solvers have in common; None to keep nothing.
    common: dict[tuple[Hashable, ...], Any] | None = field(init=False, repr=False, default=None)

    @classmethod
    def from_volume(
        cls,
        views: Sequence[View],
        laser: TwoMirror,
        volume: Volume,
        prisms: Prisms | None = None,
    ) -> Self:
        """Find what views see of a configured volume, as `VisibilitySettings` say.

        Parameters
        ----------
        prisms : Prisms, optional
            Those of the volume, where they are made already.
        """
        prisms = volume.prisms() if prisms is None else prisms
        sight, grazing = volume.sight, np.radians(volume.sight.grazing)
        thickness = float(np.ptp(prisms.depth))
        own = views if sight.background else without_background(views, laser, prisms)
        return cls(
            own,
            laser,
            prisms,
            volume.rule(),
            sight.interpolation,
            grazing,
            one_sided=not sight.both_sides,
            clearance=thickness / 2 / np.cos(grazing) if sight.occlusion else None,
        )

    def __post_init__(self) -> None:
        require_usable(self.views)
        self.interpolation = self.interpolation.chosen(self.views)
        self._interpolators = [self.interpolation.prepare(v) for v in self.views]
        self._occlusions = [self._occlusion(v) for v in self.views]

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what is remembered: a copy and another process remember their own."""
        return {**self.__dict__, "_whole": None, "_errors": None, "common": None}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the views."""
        return tuple(v.name for v in self.views)

    @property
    def findings(self) -> list[Finding]:
        """Views that lose places of the surface next to a background at rest."""
        key = ("findings",)
        if self.common is not None and key in self.common:
            return list(self.common[key])
        found = background_findings(self.views, self.laser, self.prisms)
        if self.common is not None:
            self.common[key] = tuple(found)
        return found

    @property
    def interpolation_errors(self) -> list[scipy.sparse.csr_array]:
        """Matrices of every view, from velocities of pixels to errors of interpolation there."""
        if self._errors is not None:
            return self._errors
        found = [self.interpolation.mean_error(view) for view in self.views]
        if sum(matrix.data.nbytes for matrix in found) <= CACHE_ERRORS:
            self._errors = found
        return found

    def of_columns(
        self,
        what: str,
        data: Sequence[Array],
        work: Callable[[Sequence[Array]], list[Array]],
    ) -> list[Array]:
        """Compute something of every view's columns, or recall it if they were the last ones.

        Parameters
        ----------
        what : str
            Name of what is computed.
        data : sequence of ndarray, shape (pixel, column)
        work : callable
            From the columns of all views to what is wanted of each.
        """
        if self.common is None:
            return work(data)
        told = hashlib.sha256()
        for columns in data:
            told.update(b"%d %d " % columns.shape + columns.tobytes())
        last, found = self.common.get((what,), ("", []))
        if last != told.hexdigest():
            found = work(data)
            self.common[(what,)] = told.hexdigest(), found
        return list(found)

    def slopes(self, data: Sequence[Array]) -> list[Array]:
        """Differentiate columns of every view's image at its pixels, shape (2, pixel, column)."""
        return self.of_columns("slopes", data, self._slopes)

    def _slopes(self, data: Sequence[Array]) -> list[Array]:
        found = []
        for interpolator, view, values in zip(self._interpolators, self.views, data, strict=True):
            at = interpolator.at(view.dac).located
            of_view = np.zeros((2, *values.shape))
            of_view[:, at.place] = interpolator.slopes(at, view.dac[at.place], values)
            found.append(of_view)
        return found

    @property
    def triangles(self) -> IndexArray:
        """Indices of all triangles of the surface."""
        return np.arange(len(self.prisms.triangles))

    @property
    def fits_in_cache(self) -> bool:
        """Whether what is seen of all of it is remembered."""
        return self.prisms.gaps * len(self.prisms.triangles) * self.rule.points <= CACHE_SAMPLES

    def at(self, triangles: IndexArray) -> SampleVisibility:
        """Project the samples of some triangles' prisms, in all gaps."""
        if not self.fits_in_cache:
            return self._project(triangles)
        if self._whole is None:  # some samples are asked for first, and all of them afterwards
            self._whole = self._project(self.triangles)
        whole = self._whole
        return whole if np.array_equal(triangles, whole.triangles) else whole.over(triangles)

    def without(self, k: int) -> Self:
        """Leave one view out, keeping all that is prepared and remembered of the others."""
        others = [i for i in range(len(self.views)) if i != k]
        left = copy(self)
        left.views = [self.views[i] for i in others]
        left._interpolators = [self._interpolators[i] for i in others]
        left._occlusions = [self._occlusions[i] for i in others]
        left._errors = None if self._errors is None else [self._errors[i] for i in others]
        if self._whole is not None:
            left._whole = replace(
                self._whole, by_view=tuple(self._whole.by_view[i] for i in others)
            )
        return left

    def seen_by(self, views: Sequence[View]) -> Self:
        """Give the same images other poses."""
        moved = copy(self)
        moved.views = views
        moved._occlusions = [moved._occlusion(v) for v in views]
        return moved

    def seen_with(self, laser: TwoMirror) -> Self:
        """Give the same images and poses another laser."""
        other = copy(self)
        other.laser = laser
        other._occlusions = [other._occlusion(v) for v in self.views]
        return other

    def _project(self, triangles: IndexArray) -> SampleVisibility:
        position = sample_positions(self.prisms, self.rule, triangles).reshape(-1, 3)
        position = np.ascontiguousarray(position.T).T  # as every view turns them
        frame = sample_frames(self.prisms, self.rule, triangles).reshape(-1, 3, 3)

        def project(k: int) -> ViewSamples:
            return project_samples(
                self.views[k],
                self.laser,
                position,
                frame[:, 2] if self.one_sided else None,
                self._interpolators[k],
                grazing=self.grazing,
                occlusion=self._occlusions[k],
            )

        by_view = tuple(side_by_side(project, range(len(self.views))))
        return SampleVisibility(triangles, by_view, position, frame, self.rule.points)

    def _occlusion(self, view: View) -> Occlusion | None:
        if self.clearance is None:
            return None
        middle = np.abs(self.prisms.depth).argmin()
        surface = self.prisms.position.reshape(self.prisms.layers, -1, 3)[middle]
        laser = view.laser(self.laser)
        return Occlusion.prepare(view, laser, surface, self.prisms.triangles, self.clearance)
