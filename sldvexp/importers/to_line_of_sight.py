"""What views measured point by point, as line-of-sight velocities of points."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sldvexp import dataset
from sldvexp.errors import UserError, nearest
from sldvexp.importers.pointwise import Directions, PointwiseData, PointwiseImport
from sldvexp.io.uff.geometry import UniversalGeometry
from sldvexp.io.velocities.table import LineOfSight
from sldvexp.laser.model import direction_cosines, project
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, IndexArray, IntArray

#: How far one node's positions in two files may be apart, relative to the object's size.
SAME_PLACE = 1e-4


def read_points(
    settings: PointwiseImport, tree: Mapping[str, xr.Dataset], laser: TwoMirror | None
) -> xr.Dataset:
    """The group ``line_of_sight``.

    Raises
    ------
    UserError
        If the views have no point in common, or not all of them and `incomplete` is false.
    """
    views = list(settings.measured())
    node = _common(settings, views)
    where = [np.searchsorted(view.node, node) for view in views]
    position = positions(views, node)
    cosines = [
        _directions(settings, view, node, at, position, tree, laser)
        for view, at in zip(views, where, strict=True)
    ]
    errors = [view.std[at] for view, at in zip(views, where, strict=True) if view.std is not None]
    table = LineOfSight(
        ", ".join(dict.fromkeys(view.source for view in views)),
        [view.name for view in views],
        [str(n) for n in node],
        views[0].frequency,
        np.stack(cosines),
        np.stack([view.velocity[at] for view, at in zip(views, where, strict=True)]),
        np.stack(errors) if errors else None,
    )
    made = table.group()
    if position is not None:
        made = made.merge(_shape(_geometry(views), node, position), combine_attrs="override")
    return made.assign_attrs(record(views))


def record(views: list[PointwiseData]) -> dict[str, str]:
    """What was decided of the files' conventions, as attributes."""
    keys = dict.fromkeys(key for view in views for key in view.told)
    return {
        f"import_{key}": "; ".join(dict.fromkeys(view.told.get(key, "") for view in views))
        for key in keys
    }


def positions(views: list[PointwiseData], node: IntArray) -> Array | None:
    """Positions of nodes in the world, m, shape (point, 3); None if no file has any.

    Raises
    ------
    UserError
        If a node has no position, or stands at different places in two files.
    """
    found: Array | None = None
    for view in views:
        if view.geometry is None:
            continue
        index = view.geometry.index()
        lost = [int(n) for n in node if int(n) not in index]
        if lost:
            raise UserError(
                f"{view.source}: the geometry of view {view.name} lacks node {lost[0]}, for which "
                "there are functions"
            )
        own = view.length * view.geometry.position[[index[int(n)] for n in node]]
        if found is None:
            found = own
        apart = np.linalg.norm(own - found, axis=1)
        if (apart > SAME_PLACE * max(float(np.ptp(found, axis=0).max()), 1e-9)).any():
            worst = int(apart.argmax())
            raise UserError(
                f"{view.source}: the node {node[worst]} of view {view.name} is "
                f"{apart[worst]:.3g} m from where view {views[0].name} has it; the views must have "
                "one geometry"
            )
    return found


def _geometry(views: list[PointwiseData]) -> UniversalGeometry:
    return next(view.geometry for view in views if view.geometry is not None)


def _common(settings: PointwiseImport, views: list[PointwiseData]) -> IntArray:
    """The nodes that all views have."""
    everywhere = views[0].node
    measured_by = [view.node[~view.missing] for view in views]
    for nodes in measured_by:
        everywhere = np.intersect1d(everywhere, nodes)
    whole = np.unique(np.concatenate([view.node for view in views]))
    lost = np.setdiff1d(whole, everywhere)
    if len(lost) and not settings.incomplete:
        by = next(v for v, n in zip(views, measured_by, strict=True) if lost[0] not in n)
        raise UserError(
            f"{by.source}: the view {by.name} has not measured node {lost[0]}, as others have; "
            "leave such points out with instrument.incomplete=true"
        )
    if not len(everywhere):
        raise UserError("instrument.views: the views have no node in common")
    return everywhere


def _directions(
    settings: PointwiseImport,
    view: PointwiseData,
    node: IntArray,
    at: IndexArray,
    position: Array | None,
    tree: Mapping[str, xr.Dataset],
    laser: TwoMirror | None,
) -> Array:
    """Unit vectors from the points to the instrument, shape (point, 3)."""
    own = settings.views[view.name]
    if settings.directions is Directions.dof:
        return _of_dofs(view, node, view.direction[at])
    if own.direction:
        return np.tile(np.array(own.direction) / np.linalg.norm(own.direction), (len(node), 1))
    if position is None:
        raise UserError(
            f"{view.source}: has no geometry (data set 15 or 2411), which directions need; name a "
            "file that has with instrument.geometry"
        )
    if own.origin:
        towards = np.array(own.origin) - position
        return towards / np.linalg.norm(towards, axis=1, keepdims=True)
    rotation, origin, laser = pose_of(view.name, tree, laser)
    angles = project((position - origin) @ rotation.T, laser.mirror_offset)
    return direction_cosines(angles, rotation)


def _of_dofs(view: PointwiseData, node: IntArray, codes: IntArray) -> Array:
    """The response directions in the world."""
    if view.geometry is None:
        raise UserError(
            f"{view.source}: has no geometry (data set 15 or 2411), so that its directions cannot "
            "be told; name a file that has with instrument.geometry, or the view's direction"
        )
    index = view.geometry.index()
    for n, code in zip(node, codes, strict=True):
        if code == 0 or int(n) not in index:
            what = "has no direction" if code == 0 else "is not in the geometry"
            raise UserError(
                f"{view.source}: node {n} of view {view.name} {what}; give the view's origin or "
                "direction with instrument.directions=view"
            )
    return np.array(
        [view.geometry.direction(index[int(n)], int(c)) for n, c in zip(node, codes, strict=True)]
    )


def pose_of(
    name: str, tree: Mapping[str, xr.Dataset], laser: TwoMirror | None
) -> tuple[Array, Array, TwoMirror]:
    """Rotation and origin of a view, and the laser that they are of."""
    if "pose" not in tree or laser is None:
        raise UserError(
            "instrument: needs a pose and a laser, for example pose=given, which tell where the "
            "instrument stood"
        )
    names = [str(v) for v in tree["pose"]["view"].values]
    if name not in names:
        raise UserError(f"view {name}: has velocities but no pose; {nearest(name, names)}")
    pose = tree["pose"].sel(view=name)
    return pose["rotation"].values, pose["origin"].values, laser


def _shape(geometry: UniversalGeometry, node: IntArray, position: Array) -> xr.Dataset:
    """Positions of points, and triangles and lines between them, for those who draw."""
    place = {label: i for i, label in enumerate(node.tolist())}
    q = geometry.quadrilaterals
    corners = np.concatenate([geometry.triangles, q[:, [0, 1, 2]], q[:, [0, 2, 3]]])
    ends = [(a, b) for line in geometry.lines for a, b in pairwise(line)]

    def between_points(indices: NDArray) -> IntArray | None:
        named = [[place.get(int(geometry.label[i]), -1) for i in row] for row in indices]
        kept = [row for row in named if min(row) >= 0]
        return np.array(kept, np.int64) if kept else None

    return dataset.group(
        "line_of_sight",
        {"point": [str(n) for n in node]},
        position=position,
        triangle=between_points(corners),
        line=between_points(np.array(ends, np.int64).reshape(-1, 2)),
    )
