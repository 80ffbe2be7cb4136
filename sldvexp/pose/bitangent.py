"""`pose=bitangent`: the dissertation's automated pose from bitangent points of fitted conics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from sldvexp.config.registry import register
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import JointCovariance, PoseResult
from sldvexp.pose.circle_images import (
    UNLIKELY,
    CircleImages,
    bitangent_errors,
    registration_table,
)
from sldvexp.pose.conics import conics_to_dataset
from sldvexp.pose.correlated_errors import with_errors
from sldvexp.pose.from_points import CovarianceModel, require_laser
from sldvexp.pose.from_scans import FromScans, circles_of
from sldvexp.pose.solution import PoseSolution
from sldvexp.targets import Circles, Target


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
        self, laser: TwoMirror | None, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> PoseResult:
        """Solve the bitangent points of all scanned views, with the errors that they share."""
        circles, laser = circles_of(target, self.name), require_laser(laser)
        images = self.images(circles, laser, tree, self.pinhole)
        tables = [registration_table(i, circles) for i in images]
        found = self.solve(tables, laser, None, model=self._errors_of(images, circles, laser))
        found.pose.attrs["notes"] = "\n".join([*self.notes(images), *found.notes])
        kept = conics_to_dataset(images, circles, laser, self.pinhole)
        return replace(found, conic=kept)

    def _errors_of(
        self, images: Sequence[CircleImages], circles: Circles, laser: TwoMirror
    ) -> CovarianceModel:
        """Make the model of errors that come from ellipses and circles."""

        def covariance_model(
            solutions: Sequence[PoseSolution],
        ) -> tuple[list[PoseSolution], JointCovariance, list[str]]:
            errors = [bitangent_errors(i.view, i.bitangents, circles) for i in images]
            known, joint, probability = with_errors(
                solutions, errors, laser, self.adjust, self.shared
            )
            unlikely = [e.view for e, p in zip(errors, probability, strict=True) if p < UNLIKELY]
            notes = [
                f"view {view}: the residuals are larger than the edges' noise and the circles' "
                "accuracy explain, so that the bounds are too small; a mirror offset or "
                "calibration that is not the true one, or pinhole: false, looks like this"
                for view in unlikely
            ]
            return known, joint, notes

        return covariance_model
