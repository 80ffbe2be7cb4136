"""Coverage of the samples: how many each view sees, and why not the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from sldvexp.errors import UserError
from sldvexp.field.visibility.projection import (
    BEHIND,
    FACING_AWAY,
    FLAGGED,
    OFF_BOARD,
    OUTSIDE,
    ViewSamples,
)
from sldvexp.field.visibility.view import NOTABLE, View, why
from sldvexp.laser import MIRRORS
from sldvexp.typing import Array

#: What may be wrong if a view sees nothing, by the reason of most samples.
REMEDIES = {
    OUTSIDE: "is the volume placed in the world of the poses, is volume.unit the unit of its "
    "lengths, and was this view's image scanned where the structure is?",
    FACING_AWAY: "do the surface's normals point to the side that is measured?",
    BEHIND: "is the pose right, is volume.unit the unit of its lengths, and is the volume "
    "placed in the world of the poses?",
    OFF_BOARD: "is the pose right, is volume.unit the unit of its lengths, and is the volume "
    "placed in the world of the poses?",
}


@dataclass(frozen=True, eq=False)
class Coverage:
    """Samples that a view sees and loses; add up those of blocks with ``+``.

    Parameters
    ----------
    lost : dict of str to int
        Samples without a velocity by the reason.
    low, high : ndarray, shape (2,), steps
        Range of the samples' image points; NaN if there is none.
    """

    view: View
    samples: int
    seen: int
    lost: dict[str, int]
    low: Array
    high: Array

    @classmethod
    def from_view(cls, view: View, found: ViewSamples) -> Self:
        """Count what is seen and lost of one block."""
        low, high = (
            np.array([extreme.reduce(steps, initial=np.nan) for steps in found.dac.T])
            for extreme in (np.fmin, np.fmax)
        )
        return cls(view, len(found.valid), int(found.valid.sum()), dict(found.lost), low, high)

    def __add__(self, other: Coverage) -> Coverage:
        return Coverage(
            self.view,
            self.samples + other.samples,
            self.seen + other.seen,
            {reason: count + other.lost[reason] for reason, count in self.lost.items()},
            np.fmin(self.low, other.low),
            np.fmax(self.high, other.high),
        )

    def summary(self) -> str:
        """Describe as ``view 1: sees 800 of 1000 samples (outside the image 150, flagged 50)``."""
        lost = [f"{why} {n}" for why, n in sorted(self.lost.items(), key=lambda x: -x[1]) if n]
        told = f"view {self.view.name}: sees {self.seen} of {self.samples} samples"
        return f"{told} ({', '.join(lost)})" if lost else told

    def where(self) -> str:
        """Describe where the samples are in the image, against the image's own range."""
        if np.isnan(self.low).any():
            return "no sample has an image point"
        image = self.view.dac.min(axis=0), self.view.dac.max(axis=0)
        samples, pixels = _ranges(self.low, self.high), _ranges(*image)
        return f"its image has {pixels} and the samples are at {samples}"


def require_coverage(coverage: Sequence[Coverage]) -> None:
    """Refuse a volume of which a view sees nothing.

    Raises
    ------
    UserError
        If one sees nothing; it says where the volume is in its image.
    """
    blind = [c for c in coverage if not c.seen]
    if not blind:
        return
    worst = blind[0]
    if len(blind) < len(coverage):
        names = ", ".join(c.view.name for c in blind)
        which = f"view{'s' if len(blind) > 1 else ''} {names}: none of the samples is seen"
    else:
        which = "the volume is seen by none of the views"
    reason = max(worst.lost, key=lambda why: worst.lost[why])
    raise UserError(
        f"{which}; view {worst.view.name}: {worst.lost[reason]} of {worst.samples} samples are "
        f"{reason}, {worst.where()}; "
        + (why(worst.view) if reason == FLAGGED else REMEDIES[reason])
    )


def flagged(coverage: Sequence[Coverage]) -> str:
    """Say which views lose many samples to flagged pixels, and why; empty if none does."""
    some = [c for c in coverage if c.lost[FLAGGED] > NOTABLE * c.samples]
    if not some:
        return ""
    views = ", ".join(f"{c.lost[FLAGGED]} of {c.samples} in view {c.view.name}" for c in some)
    return f"samples are at flagged pixels, {views}: {why(*(c.view for c in some))}"


def _ranges(low: Array, high: Array) -> str:
    """Describe ranges of both mirrors' steps for a message."""
    each = zip(MIRRORS, low, high, strict=True)
    return " and ".join(f"{mirror} {a:.0f} to {b:.0f}" for mirror, a, b in each)
