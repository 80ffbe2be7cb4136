"""`pose=edge`: maximum likelihood straight from all edge points, without a conic in between."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from sldvexp.config.registry import register
from sldvexp.dataset import Finding
from sldvexp.errors import UserError
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import PoseResult
from sldvexp.pose.circle_images import CircleImages, registration_table
from sldvexp.pose.edge_solver import EdgePoints, EdgePoses, solve_edges
from sldvexp.pose.from_points import require_laser
from sldvexp.pose.from_scans import FromScans, circles_of, with_pointing
from sldvexp.pose.intrinsics import adjusted_notes
from sldvexp.pose.pointing import lack_of_fit, misfit_finding
from sldvexp.pose.single_view import solve_points
from sldvexp.targets import Circles, Target, std_of_bound
from sldvexp.typing import Array


@register("pose", "edge")
@dataclass
class Edge(FromScans):
    """Every edge point's beam must meet its circle's rim; the poses that do so best.

    The two-mirror model is exact here, while the image of a circle is a conic only nearly. All
    views are adjusted together, since they share the circles and their machining errors. Edges are
    weighed by their stated errors and the mirrors' pointing noise; see `sldvexp.pose.pointing` for
    how it is found and for what is not included (drift, hysteresis, a common zero error).
    """

    name: ClassVar[str] = "edge"

    def estimate(
        self, laser: TwoMirror | None, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> PoseResult:
        """Adjust the poses of all scanned views, from those of their bitangent points."""
        circles, laser = circles_of(target, self.name), require_laser(laser)
        images = self.images(circles, laser, tree, pinhole=True)
        found = solve_edges(
            [edge_points(i, laser, circles) for i in images],
            mirror_offset=laser.mirror_offset,
            views=[i.view for i in images],
            starts=[_start(i, laser, circles) for i in images],
            adjust=self.adjust,
            shared=self.shared,
            circle_std=circles.unit.value * std_of_bound(circles.accuracy),
            max_iterations=self.max_iterations,
        )
        pose = found.to_dataset(self.confidence, [i.pointing.dof for i in images])
        pose = with_pointing(pose, images)
        pose.attrs["mirror_offset"], pose.attrs["step"] = laser.mirror_offset, laser.step
        pose.attrs["shared"] = json.dumps(self.shared)
        notes = [*self.notes(images), *adjusted_notes(self.adjust, self.shared, pose)]
        pose.attrs["notes"] = "\n".join(notes)
        findings = [*self.findings(images), *_misfits(found, images)]
        return PoseResult(pose, findings=findings)


def edge_points(images: CircleImages, laser: TwoMirror, circles: Circles) -> EdgePoints:
    """Gather all edge points of a view with the circles that they belong to."""
    edges = images.edges
    return EdgePoints.from_dac(
        circles,
        laser,
        np.concatenate([np.full(len(e.std), number) for number, e in edges.items()]),
        *(
            np.concatenate([getattr(e, name) for e in edges.values()])
            for name in ("position", "direction", "std")
        ),
    )


def _start(images: CircleImages, laser: TwoMirror, circles: Circles) -> tuple[Array, Array]:
    """Solve for rotation and origin from one view's bitangent points."""
    table = registration_table(images, circles)
    try:
        start = solve_points(
            table.object_point,
            table.angle_through(laser),
            step=laser.step,
            mirror_offset=laser.mirror_offset,
        )
    except UserError as error:
        raise UserError(f"view {images.view}: {error}") from None
    return start.rotation, start.origin


def _misfits(found: EdgePoses, images: Sequence[CircleImages]) -> Iterator[Finding]:
    """Find views whose circles, as ellipses show them, are not those of the object."""
    for image, pose in zip(images, found.poses, strict=True):
        square = float(pose.residual @ pose.residual)
        statistic, probability = lack_of_fit(image.pointing, square, pose.dof)
        yield from misfit_finding(image.view, pose.residual_rms, statistic, probability)
