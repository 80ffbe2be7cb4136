"""`pose=edge`: maximum likelihood straight from all edge points, without a conic in between."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

from sldvexp.config.registry import register
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import PoseResult
from sldvexp.pose.from_points import require_laser
from sldvexp.pose.from_scans import FromScans, circles_of, start_of, with_failed, with_pointing
from sldvexp.pose.intrinsics import adjusted_notes
from sldvexp.pose.misfit import EdgeProblem, judge_circles
from sldvexp.targets import Target


@register("pose", "edge")
@dataclass
class Edge(FromScans):
    """Every edge point's beam must meet its circle's rim; the poses that do so best.

    The two-mirror model is exact here, while the image of a circle is a conic only nearly. All
    views are adjusted together, since they share the circles and their machining errors. Edges are
    weighed by their stated errors and the mirrors' pointing noise; see `sldvexp.pose.pointing` for
    how it is found and for what is not included (drift, hysteresis, a common zero error), and
    `sldvexp.pose.misfit` for how wrong circles and mirrors are. Gains, zeros and mirror offset that
    are neither in `adjust` nor in `shared` are taken as exact, however little of a mistake in them
    the edges would show.
    """

    name: ClassVar[str] = "edge"

    def estimate(
        self, laser: TwoMirror | None, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> PoseResult:
        """Adjust the poses of all scanned views, from those of their bitangent points."""
        circles, laser = circles_of(target, self.name), require_laser(laser)
        images, failed = self.images(circles, laser, tree, pinhole=True)
        problem = EdgeProblem(images, circles, laser, self.adjust, self.shared, self.max_iterations)
        found = problem.solve([start_of(i, laser, circles) for i in images])
        places = [(p.rotation, p.origin) for p in found.poses]
        wrong, joint = judge_circles(problem, found, places, found.joint)
        found = replace(found, joint=joint)
        pose = found.to_dataset(self.confidence, [i.pointing.dof for i in images])
        pose = with_failed(with_pointing(pose, images), failed)
        pose.attrs["mirror_offset"], pose.attrs["step"] = laser.mirror_offset, laser.step
        pose.attrs["shared"] = json.dumps(self.shared)
        notes = [*self.notes(images), *adjusted_notes(self.adjust, self.shared, pose)]
        pose.attrs["notes"] = "\n".join(notes)
        findings = [*failed, *self.findings(images, laser, tree), *wrong]
        return PoseResult(pose, findings=findings)
