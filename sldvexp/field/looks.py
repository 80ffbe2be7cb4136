"""What all views see of the samples of a volume, some of its triangles at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sldvexp.field.occlusion import Occlusion
from sldvexp.field.seen import GRAZING, Seen, look
from sldvexp.field.threads import side_by_side
from sldvexp.field.view import View
from sldvexp.image.interpolation.base import Interpolator
from sldvexp.image.interpolation.method import Interpolation
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.volume.prisms import Prisms
from sldvexp.volume.samples import SampleRule, sample_frames, sample_positions

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Look:
    """The samples in the prisms over some triangles, and what each view sees of them.

    Attributes
    ----------
    triangles : ndarray of int, shape (triangle,)
    seen : tuple of Seen
        One a view; ``sample = (gap * triangles + triangle) * points + point``.
    position : ndarray, shape (sample, 3), m
    frame : ndarray, shape (sample, 3, 3)
        Unit rows t1, t2, n.
    """

    triangles: Indices
    seen: tuple[Seen, ...]
    position: Array
    frame: Array

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Which view has a velocity of which sample, shape (sample, view)."""
        return np.stack([s.valid for s in self.seen], axis=1)

    @property
    def directions(self) -> Array:
        """Direction cosines in world axes, shape (sample, view, 3)."""
        return np.stack([s.directions for s in self.seen], axis=1)


@dataclass(eq=False)
class Looks:
    """Looks at a volume from all views.

    Parameters
    ----------
    views : sequence of View
    laser : TwoMirror
    prisms : Prisms
    rule : SampleRule
    interpolation : Interpolation
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

    def __post_init__(self) -> None:
        self._interpolators = [self.interpolation.prepare(v) for v in self.views]
        self._occlusions = [self._occlusion(v) for v in self.views]

    @property
    def names(self) -> tuple[str, ...]:
        """The views' names."""
        return tuple(v.name for v in self.views)

    def at(self, triangles: Indices) -> Look:
        """Look at the samples of some triangles' prisms, in all gaps."""
        position = sample_positions(self.prisms, self.rule, triangles).reshape(-1, 3)
        frame = sample_frames(self.prisms, self.rule, triangles).reshape(-1, 3, 3)

        def seen_by(k: int) -> Seen:
            return look(
                self.views[k],
                self.laser,
                position,
                frame[:, 2] if self.one_sided else None,
                self._interpolators[k],
                grazing=self.grazing,
                occlusion=self._occlusions[k],
            )

        seen = tuple(side_by_side(seen_by, range(len(self.views))))
        return Look(triangles, seen, position, frame)

    def _occlusion(self, view: View) -> Occlusion | None:
        if self.clearance is None:
            return None
        middle = np.abs(self.prisms.depth).argmin()
        surface = self.prisms.position.reshape(self.prisms.layers, -1, 3)[middle]
        return Occlusion.prepare(view, self.laser, surface, self.prisms.triangles, self.clearance)
