"""`pose=bitangent`: the dissertation's automated pose from bitangent points of fitted conics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from sldvexp.config.registry import register
from sldvexp.dataset import Finding
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import JointCovariance, PoseResult
from sldvexp.pose.circle_images import (
    CircleImages,
    bitangent_errors,
    registration_table,
)
from sldvexp.pose.conics import conics_to_dataset
from sldvexp.pose.correlated_errors import with_errors
from sldvexp.pose.from_points import CovarianceModel, require_laser
from sldvexp.pose.from_scans import FromScans, circles_of, with_pointing
from sldvexp.pose.pointing import misfit_finding
from sldvexp.pose.solution import PoseSolution
from sldvexp.targets import Circles, Target


@register("pose", "bitangent")
@dataclass
class Bitangent(FromScans):
    """Conics through the edges, their bitangent points, and the pose from these (4.4.4.2).

    Conics are weighed by the edges' stated errors and the mirrors' pointing noise; see
    `sldvexp.pose.pointing` for how it is found and for what is not included (drift, hysteresis, a
    common zero error).

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
        findings = self.findings(images)
        model = self._errors_of(images, circles, laser, findings)
        found = self.solve(tables, laser, None, model=model)
        pose = with_pointing(found.pose, images)
        pose.attrs["notes"] = "\n".join([*self.notes(images), *found.notes])
        kept = conics_to_dataset(images, circles, laser, self.pinhole)
        told = [*findings, *found.findings]
        return replace(found, pose=pose, findings=told, conic=kept)

    def _errors_of(
        self,
        images: Sequence[CircleImages],
        circles: Circles,
        laser: TwoMirror,
        findings: list[Finding],
    ) -> CovarianceModel:
        """Make the model of errors that come from ellipses and circles, which adds its findings."""

        def covariance_model(
            solutions: Sequence[PoseSolution],
        ) -> tuple[list[PoseSolution], JointCovariance, list[str]]:
            errors = [bitangent_errors(i, circles) for i in images]
            known, joint, probability = with_errors(
                solutions, errors, laser, self.adjust, self.shared
            )
            for e, s, p in zip(errors, known, probability, strict=True):
                findings.extend(misfit_finding(e.view, float(s.residual_rms), np.nan, p))
            return known, joint, []

        return covariance_model
