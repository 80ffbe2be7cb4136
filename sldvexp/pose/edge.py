"""`pose=edge`: maximum likelihood straight from all edge points, without a conic in between.

From the edges of a run to the group `pose` by maximum likelihood, all views together.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from sldvexp.config.registry import register
from sldvexp.errors import UserError
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import JointCovariance, pose_to_dataset
from sldvexp.pose.edge_solver import EdgePoints, EdgePoses, angles_along, solve_edges
from sldvexp.pose.from_scans import MISFIT, CircleImages, FromScans, circles_of, registration_table
from sldvexp.pose.intrinsics import adjusted_notes, places
from sldvexp.pose.single_view import solve_pose
from sldvexp.targets.base import Target, std_of_bound
from sldvexp.targets.circles import Circles
from sldvexp.typing import Array


@register("pose", "edge")
@dataclass
class Edge(FromScans):
    """Every edge point's beam must meet its circle's rim; the poses that do so best.

    The two-mirror model is exact here, while the image of a circle is a conic only nearly. All
    views are adjusted together, since they share the circles and their machining errors.
    """

    name: ClassVar[str] = "edge"

    def estimate(
        self, laser: TwoMirror, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> dict[str, xr.Dataset]:
        """The group ``pose`` of all scanned views."""
        return {"pose": estimate(self, laser, target, tree)}


def estimate(
    method: Edge, laser: TwoMirror, target: Target | None, tree: Mapping[str, xr.Dataset]
) -> xr.Dataset:
    """The pose of every scanned view.

    Parameters
    ----------
    method : Edge
    laser : TwoMirror
    target : Target or None
        Must be one of circles.
    tree : mapping of str to xarray.Dataset
        With the groups ``edge/<view>``.

    Raises
    ------
    UserError
        If there are no edges, no circles, or they do not determine the pose.
    """
    circles = circles_of(target, method.name)
    images = method.images(circles, laser, tree, pinhole=True)
    found = solve_edges(
        [edge_points(i, laser, circles) for i in images],
        [_start(i, laser, circles) for i in images],
        laser.mirror_offset,
        method.adjust,
        method.shared,
        circles.unit.value * std_of_bound(circles.accuracy),
        method.max_iterations,
        [f"view {i.view}" for i in images],
    )
    group = _group(method, images, found)
    group.attrs["mirror_offset"], group.attrs["step"] = laser.mirror_offset, laser.step
    group.attrs["shared"] = json.dumps(method.shared)
    notes = [*method.notes(images), *_misfit_notes(images, found)]
    group.attrs["notes"] = "\n".join([*notes, *adjusted_notes(method.adjust, method.shared, group)])
    return group


def _misfit_notes(images: list[CircleImages], found: EdgePoses) -> Iterator[str]:
    """Views whose edges lie farther from their circles than their standard errors explain."""
    for image, pose in zip(images, found.poses, strict=True):
        rms = float(np.sqrt(np.mean(pose.residual**2)))
        if rms > MISFIT:
            yield (
                f"view {image.view}: the edges lie {rms:.1f} standard errors beside their circles; "
                "a mirror offset or calibration that is not the true one looks like this"
            )


def edge_points(images: CircleImages, laser: TwoMirror, circles: Circles) -> EdgePoints:
    """All edge points of a view with the circles that they belong to, in m."""
    unit = circles.unit.value
    parts: dict[str, list[Any]] = {f: [] for f in EdgePoints.__dataclass_fields__}
    index = {number: k for k, number in enumerate(sorted(circles.circles))}
    for number, edges in images.edges.items():
        circle, count = circles.circles[number], len(edges.std)
        plane = circles.planes[circle.plane]
        axes = plane.axes()
        center = unit * (np.array(plane.origin) + circle.x * axes[0] + circle.y * axes[1])
        angle, along = angles_along(laser, edges.position, edges.direction, edges.std)
        parts["angle"].append(angle)
        parts["along"].append(along)
        parts["center"].append(np.tile(center, (count, 1)))
        parts["normal"].append(np.tile(axes[2], (count, 1)))
        parts["radius"].append(np.full(count, unit * circle.diameter / 2))
        parts["in_plane"].append(np.tile(axes[:2], (count, 1, 1)))
        parts["circle"].append(np.full(count, index[number]))
    return EdgePoints(**{name: np.concatenate(values) for name, values in parts.items()})


def _start(images: CircleImages, laser: TwoMirror, circles: Circles) -> tuple[Array, Array]:
    """Rotation and origin from one view's bitangent points."""
    table = registration_table(images, circles)
    try:
        start = solve_pose(
            table.object_point,
            table.angle_through(laser),
            step=laser.step,
            mirror_offset=laser.mirror_offset,
        )
    except UserError as error:
        raise UserError(f"view {images.view}: {error}") from None
    return start.rotation, start.origin


def _group(method: Edge, images: list[CircleImages], found: EdgePoses) -> xr.Dataset:
    """The group ``pose``."""
    poses, views = found.poses, [i.view for i in images]
    joint = JointCovariance(views, [*method.adjust], [*method.shared], found.covariance)
    dof = np.array([p.dof for p in poses])
    std = [np.concatenate([e.std for e in i.edges.values()]) for i in images]
    square = [np.sum((p.residual * own) ** 2) for p, own in zip(poses, std, strict=True)]
    count = [len(p.residual) for p in poses]
    return pose_to_dataset(
        views,
        np.array([p.rotation for p in poses]),
        np.array([p.origin for p in poses]),
        joint.of_views(),
        dof,
        method.confidence,
        adjusted=joint.adjusted,
        intrinsic=np.array([p.intrinsics[places(joint.adjusted)] for p in poses]),
        joint=joint,
        residual_rms=np.sqrt(np.divide(square, count)),
        s=np.sqrt(np.divide(square, dof)),
        rim=np.array([p.rim for p in poses]),
    )
