"""`pose=bitangent`: the dissertation's automated pose from bitangent points of fitted conics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from sldvexp.config.registry import register
from sldvexp.dataset import Finding, Severity
from sldvexp.errors import UserError
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import JointCovariance, PoseResult
from sldvexp.pose.circle_images import (
    bitangent_errors,
    registration_table,
)
from sldvexp.pose.conics import conics_to_dataset
from sldvexp.pose.correlated_errors import with_errors
from sldvexp.pose.from_points import CovarianceModel, require_laser
from sldvexp.pose.from_scans import FromScans, circles_of, with_failed, with_pointing
from sldvexp.pose.misfit import EdgeProblem, judge_circles
from sldvexp.pose.pointing import UNLIKELY
from sldvexp.pose.solution import PoseSolution
from sldvexp.targets import Target


@register("pose", "bitangent")
@dataclass
class Bitangent(FromScans):
    """Conics through the edges, their bitangent points, and the pose from these (4.4.4.2).

    Conics are weighed by the edges' stated errors and the mirrors' pointing noise; see
    `sldvexp.pose.pointing` for how it is found and for what is not included (drift, hysteresis, a
    common zero error), and `sldvexp.pose.misfit` for how wrong circles and mirrors are, which all
    edges together tell. Gains, zeros and mirror offset that are neither in `adjust` nor in `shared`
    are taken as exact, however little of a mistake in them the edges would show.

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
        images, failed = self.images(circles, laser, tree, self.pinhole)
        tables = [registration_table(i, circles) for i in images]
        findings = [*self.findings(images, laser, tree), *failed]
        problem = EdgeProblem(images, circles, laser, self.adjust, self.shared, self.max_iterations)
        found = self.solve(tables, laser, None, model=self._errors_of(problem, findings))
        pose = with_failed(with_pointing(found.pose, images), failed)
        pose.attrs["notes"] = "\n".join([*self.notes(images), *found.notes])
        kept = conics_to_dataset(images, circles, laser, self.pinhole)
        told = [*findings, *found.findings]
        return replace(found, pose=pose, findings=told, conic=kept)

    def _errors_of(self, problem: EdgeProblem, findings: list[Finding]) -> CovarianceModel:
        """Make the model of errors that come from ellipses and circles, which adds its findings."""

        def covariance_model(
            solutions: Sequence[PoseSolution],
        ) -> tuple[list[PoseSolution], JointCovariance, list[str]]:
            errors = [bitangent_errors(i, problem.circles) for i in problem.images]
            known, joint, probability = with_errors(
                solutions, errors, problem.laser, self.adjust, self.shared
            )
            wrong, joint = _judged(problem, known, joint)
            each = zip(problem.views, known, probability, strict=True)
            wrong = wrong or [self._no_conics(*v) for v in each if v[2] < UNLIKELY]
            findings.extend(wrong)
            known = [
                replace(s, covariance=own) for s, own in zip(known, joint.of_views(), strict=True)
            ]
            return known, joint, []

        return covariance_model

    def _no_conics(self, view: str, solution: PoseSolution, probability: float) -> Finding:
        """Say that conics do not fit an object that the edges themselves fit."""
        rms = float(solution.residual_rms)
        return Finding(
            "calibration",
            f"view {view}",
            f"view {view}: the bitangent points fit the object to {rms:.2g} DAC steps rms, worse "
            "than the edges' noise and the circles' accuracy explain, and the bounds leave that "
            "out; the edges themselves fit it, as where the images of circles are no conics",
            Severity.void,
            p_value=probability,
            size=rms,
            remedy="pose=edge" if self.pinhole else "pose.pinhole=true",
            views=(view,),
        )


def _judged(
    problem: EdgeProblem, solutions: Sequence[PoseSolution], joint: JointCovariance
) -> tuple[list[Finding], JointCovariance]:
    """Test object and mirrors by all edges, which their own poses fit best."""
    places = [(s.rotation, s.origin) for s in solutions]
    try:
        edges = problem.solve(places)
    except UserError:
        return [], joint
    return judge_circles(problem, edges, places, joint)
