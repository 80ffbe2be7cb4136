"""`pose=bitangent`: the dissertation's automated pose from bitangent points of fitted conics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from sldvexp.config.registry import register
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.bitangent_bounds import bitangent_errors
from sldvexp.pose.correlated_errors import with_errors
from sldvexp.pose.from_points import estimate
from sldvexp.pose.from_scans import FromScans
from sldvexp.pose.images import circles_of, registration_table
from sldvexp.pose.single_view import PoseSolution
from sldvexp.targets.base import Target
from sldvexp.typing import Array

#: Probability of residuals below which they are noted.
UNLIKELY = 1e-4


@register("pose", "bitangent")
@dataclass
class Bitangent(FromScans):
    """Conics through the edges, their bitangent points, and the pose from these (4.4.4.2).

    Parameters
    ----------
    pinhole : bool
        Fit the conics in coordinates in which the image of a circle is an ellipse but for the
        mirror offset. With false they are fitted in DAC steps, as the dissertation does.
    """

    name: ClassVar[str] = "bitangent"

    pinhole: bool = True

    def estimate(
        self, laser: TwoMirror, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> dict[str, xr.Dataset]:
        """Groups ``registration`` and ``pose`` of all scanned views."""
        circles = circles_of(target, self.name)
        images = self.images(circles, laser, tree, self.pinhole)
        tables = [registration_table(i, circles) for i in images]

        def judge(
            solutions: Sequence[PoseSolution],
        ) -> tuple[list[PoseSolution], Array, list[str]]:
            errors = [bitangent_errors(i.view, i.bitangents, circles) for i in images]
            judged, joint, probability = with_errors(
                solutions, errors, laser, self.adjust, self.shared
            )
            unlikely = [e.view for e, p in zip(errors, probability, strict=True) if p < UNLIKELY]
            notes = [
                f"view {view}: the residuals are larger than the edges' noise and the circles' "
                "accuracy explain, so that the bounds are too small; a mirror offset or "
                "calibration that is not the true one, or pinhole: false, looks like this"
                for view in unlikely
            ]
            return judged, joint, notes

        groups = estimate(self, tables, laser, None, judge=judge)
        kept = str(groups["pose"].attrs["notes"]).splitlines()
        groups["pose"].attrs["notes"] = "\n".join([*self.notes(images), *kept])
        return groups
