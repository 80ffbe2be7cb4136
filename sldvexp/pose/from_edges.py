"""From the edges of a run to the group `pose` by maximum likelihood, one view at a time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from sldvexp.errors import UserError
from sldvexp.pose.base import EXTRINSICS, pose_group
from sldvexp.pose.edge_model import EdgePoints, angles_along
from sldvexp.pose.edge_solver import OFFSET, EdgePose, solve_edges
from sldvexp.pose.images import (
    CircleImages,
    circles_of,
    edge_views,
    image_notes,
    match_images,
    registration_table,
)
from sldvexp.pose.solver import solve_pose
from sldvexp.pose.statistics import half_width
from sldvexp.session.circles import edges_of
from sldvexp.target.base import std_of_bound

if TYPE_CHECKING:
    from sldvexp.laser.two_mirror import TwoMirror
    from sldvexp.pose.edge import Edge
    from sldvexp.target.base import Target
    from sldvexp.target.circles import Circles


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
    circles = circles_of(target, "edge")
    images = [
        match_images(view, edges_of(group), circles, laser, pinhole=True)
        for view, group in edge_views(tree, "edge").items()
    ]
    poses = [_solve(method, i, laser, circles) for i in images]
    group = _group(method, images, poses)
    group.attrs["mirror_offset"], group.attrs["step"] = laser.mirror_offset, laser.step
    group.attrs["notes"] = "\n".join(n for i in images for n in image_notes(i))
    return group


def edge_points(images: CircleImages, laser: TwoMirror, circles: Circles) -> EdgePoints:
    """All edge points of a view with the circles that they belong to, in m."""
    unit = circles.unit.value
    parts: dict[str, list[Any]] = {f: [] for f in EdgePoints.__dataclass_fields__}
    for index, (number, edges) in enumerate(images.edges.items()):
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
        parts["circle"].append(np.full(count, index))
    return EdgePoints(**{name: np.concatenate(values) for name, values in parts.items()})


def _solve(method: Edge, images: CircleImages, laser: TwoMirror, circles: Circles) -> EdgePose:
    """One view, started from its bitangent points."""
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
    return solve_edges(
        edge_points(images, laser, circles),
        start.rotation,
        start.origin,
        laser.mirror_offset,
        method.adjust.get("mirror_offset", 0.0),
        circles.unit.value * std_of_bound(circles.accuracy),
        method.max_iterations,
        f"view {images.view}",
    )


def _group(method: Edge, images: list[CircleImages], poses: list[EdgePose]) -> xr.Dataset:
    """The group ``pose``."""
    size = OFFSET + len(method.adjust)
    covariance = np.array([p.covariance[:size, :size] for p in poses])
    dof = np.array([p.dof for p in poses])
    std = [np.concatenate([e.std for e in i.edges.values()]) for i in images]
    square = [np.sum((p.residual * own) ** 2) for p, own in zip(poses, std, strict=True)]
    count = [len(p.residual) for p in poses]
    coords: dict[str, Any] = {}
    more: dict[str, Any] = {}
    if method.adjust:
        error = np.sqrt(covariance[:, OFFSET:, OFFSET])
        coords["adjusted"] = list(method.adjust)
        more = {
            "intrinsic": np.array([[p.mirror_offset] for p in poses]),
            "intrinsic_std": error,
            "intrinsic_confidence": half_width(error, dof, method.confidence),
        }
    return pose_group(
        [i.view for i in images],
        np.array([p.rotation for p in poses]),
        np.array([p.origin for p in poses]),
        covariance,
        dof,
        method.confidence,
        parameters=(*EXTRINSICS, *method.adjust),
        coords=coords,
        residual_rms=np.sqrt(np.divide(square, count)),
        s=np.sqrt(np.divide(square, dof)),
        rim=np.array([p.rim for p in poses]),
        **more,
    )
