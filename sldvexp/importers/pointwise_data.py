"""Views that were measured point by point, as line-of-sight velocities or as images.

Each view has values at the nodes that it measured. As line-of-sight velocities they are joined at
the nodes that all views have, with the direction of every line of sight: the response direction of
a degree of freedom, the same for a whole view, from a point to where the instrument stood, or along
the beam that the run's pose and mirrors send there. As images every node is a pixel, at the mirror
angles of the beam through it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from omegaconf import MISSING

from sldvexp import dataset
from sldvexp.dataset import Finding, Severity
from sldvexp.errors import UserError, nearest
from sldvexp.importers.conventions import Amplitude, Directions, MotionUnit, Positive, Quantity
from sldvexp.importers.incomplete import Incomplete
from sldvexp.importers.point_names import called
from sldvexp.importers.questions import SeenPoints, key_of_view, lacking, lost_points, no_errors
from sldvexp.importers.reference import ReferenceUnit
from sldvexp.io.uff import UniversalGeometry
from sldvexp.io.uff.functions import DIRECTIONS
from sldvexp.io.velocities import LineOfSight
from sldvexp.laser import TwoMirror, direction_cosines, project
from sldvexp.lazy import xarray as xr
from sldvexp.reconstruction.gaps import LEAST
from sldvexp.typing import Array, BoolArray, ComplexArray, IndexArray, IntArray
from sldvexp.units import LengthUnit

#: Cosine between a response direction and that of positive velocities, below which they differ.
OPPOSITE = -0.5
#: Distance of an instrument from an object over the object's size, beyond which nobody measures.
FARTHEST = 100.0
#: How far one node's positions in two files may be apart, relative to the object's size.
SAME_PLACE = 1e-4


@dataclass
class PointwiseView:
    """One view.

    Parameters
    ----------
    path : str
        Its file; several views may have the same one.
    dof : str
        Which of a universal file's response directions are read, as ``+Z``; empty for all.
    origin : list of 3 float, m
        Where the instrument stood, in the world of the points.
    direction : list of 3 float
        From the surface to an instrument that is far away, or moved along; any length.
    quantity : Quantity, optional
        As that of all views, which it wins over; so do the four below.
    unit : MotionUnit, optional
    length_unit : LengthUnit, optional
    amplitude : Amplitude, optional
    reference : str, optional
    """

    path: str = MISSING
    dof: str = ""
    origin: list[float] = field(default_factory=list)
    direction: list[float] = field(default_factory=list)
    quantity: Quantity | None = None
    unit: MotionUnit | None = None
    length_unit: LengthUnit | None = None
    amplitude: Amplitude | None = None
    reference: str | None = None


@dataclass(frozen=True, eq=False)
class PointwiseData:
    """Velocities that one view has at its nodes.

    Parameters
    ----------
    name, source : str
        Of the view and of its file.
    node : ndarray of int, shape (point,)
        Ascending.
    direction : ndarray of int, shape (point,)
        Code of each function's response direction.
    frequency : ndarray, shape (frequency,), Hz
    velocity : ndarray of complex, shape (point, frequency), m/s
    std : ndarray or None, shape of `velocity`, m/s
    missing : ndarray of bool, shape (point,)
        Where zeros stand for what was not measured.
    geometry : UniversalGeometry or None
        None if no file has positions.
    length : float
        One of the geometry's units in m.
    told : dict of str to str
        Conventions, for the record.
    findings : list of Finding
        What is odd but no reason to refuse.
    said : dict of int to str
        Where a file says that a point was not measured, by its place in `node`.
    reference : ReferenceUnit or None
        None if values have no reference.
    places : str
        File of the positions if it states their unit itself.
    names : dict of int to str
        Of nodes, where the file has names.
    amplitude : float or None
        Of the reference in its unit, if values are response functions times that.
    coherence : ndarray or None, shape of `velocity`
        Of which `std` is made.
    records : int
        Behind each value; 0 if not known.
    """

    name: str
    source: str
    node: IntArray
    direction: IntArray
    frequency: Array
    velocity: ComplexArray
    std: Array | None
    missing: BoolArray
    geometry: UniversalGeometry | None
    length: float
    told: dict[str, str]
    findings: list[Finding] = field(default_factory=list)
    said: dict[int, str] = field(default_factory=dict)
    reference: ReferenceUnit | None = None
    places: str = ""
    names: dict[int, str] = field(default_factory=dict)
    amplitude: float | None = None
    coherence: Array | None = None
    records: int = 0

    @property
    def measured(self) -> IntArray:
        """Nodes that were measured."""
        return self.node[~self.missing]

    @property
    def seen(self) -> SeenPoints:
        """Its points, and which of them it has measured."""
        return SeenPoints(
            self.name,
            self.source,
            self.node,
            self.missing,
            self.frequency,
            self.said,
            self.std is not None,
            self.names,
        )


def to_line_of_sight(
    views: list[PointwiseData],
    settings: Mapping[str, PointwiseView],
    directions: Directions,
    incomplete: Incomplete,
    tree: Mapping[str, xr.Dataset],
    laser: TwoMirror | None,
) -> xr.Dataset:
    """Join views at the nodes that all have, as the group ``line_of_sight``.

    Views whose pose was not found are left out if their directions need it.

    Parameters
    ----------
    settings : mapping of str to PointwiseView
        By the views' names.
    incomplete : Incomplete
        What becomes of nodes that a view lacks.
    tree : mapping of str to Dataset
        With the group ``pose``, for directions from it.
    laser : TwoMirror, optional
        Likewise.

    Raises
    ------
    UserError
        If the views have no point in common, or not all of them and these are to be refused.
    """
    joined = joined_views(settings, directions, tree)
    views = [view for view in views if view.name in joined]
    node, findings = _common(views, incomplete)
    position = _positions(views, node)
    here = [np.isin(node, view.measured) for view in views]
    shape = (len(views), len(node), len(views[0].frequency))
    cosines = np.full((*shape[:2], 3), np.nan)
    velocity = np.full(shape, np.nan, complex)
    std = np.full(shape, np.nan)
    for k, (view, seen) in enumerate(zip(views, here, strict=True)):
        at = np.searchsorted(view.node, node[seen])
        place = None if position is None else position[seen]
        own = settings[view.name]
        cosines[k, seen] = _directions(own, directions, view, node[seen], at, place, tree, laser)
        if directions is not Directions.dof:
            findings += _turned_away(view, at, cosines[k, seen])
        if place is not None and own.origin:
            findings += _far_off(view.name, np.array(own.origin), place)
        velocity[k, seen] = view.velocity[at]
        if view.std is not None:
            std[k, seen] = view.std[at]
    missing = ~np.stack(here)
    names = {n: own for view in views for n, own in view.names.items()}
    labels = [names.get(int(n), str(n)) for n in node]
    table = LineOfSight(
        ", ".join(dict.fromkeys(view.source for view in views)),
        [view.name for view in views],
        labels,
        views[0].frequency,
        cosines,
        velocity,
        std if all(view.std is not None for view in views) else None,
        np.broadcast_to(missing[..., None], shape) if missing.any() else None,
    )
    made = table.to_dataset()
    if position is not None:
        geometry = next(view.geometry for view in views if view.geometry is not None)
        made = made.merge(_shape(geometry, node, labels, position), combine_attrs="override")
    findings += [finding for view in views for finding in view.findings]
    return dataset.with_findings(made.assign_attrs(_record(views)), findings)


def joined_views(
    settings: Mapping[str, PointwiseView],
    directions: Directions,
    tree: Mapping[str, xr.Dataset],
) -> list[str]:
    """Name the views whose lines of sight are known, so that they are joined."""
    if directions is Directions.dof:
        return list(settings)
    lost = dataset.views_without_pose(tree)
    return [n for n, own in settings.items() if n not in lost or own.origin or own.direction]


def _turned_away(view: PointwiseData, at: IndexArray, cosines: Array) -> list[dataset.Finding]:
    """Find response directions of a file that are the opposite of a view's positive velocity."""
    codes = view.direction[at]
    known = view.geometry is not None and np.isin(view.node[at], view.geometry.label).all()
    if not known or not codes.all() or "positive" not in view.told:
        return []
    sense = Positive[view.told["positive"]].value
    along = (cosines * _of_dofs(view, view.node[at], codes)).sum(axis=1)
    if not np.median(sense * along) < OPPOSITE:
        return []
    name = DIRECTIONS[int(codes[0])]
    angle = np.degrees(np.arccos(np.clip(np.median(along), -1, 1)))
    other = Positive(-sense).name
    return [
        dataset.Finding(
            "sign",
            f"view {view.name}",
            f"{view.source}: the response direction of view {view.name} is {name}, {angle:.0f} deg "
            f"from that to the instrument, but instrument.positive={Positive(sense).name}; either "
            f"the file's direction is nominal, or positive is {other}",
            size=float(angle),
            remedy=f"instrument.positive={other}",
            views=(view.name,),
        )
    ]


def _far_off(name: str, origin: Array, position: Array) -> list[dataset.Finding]:
    """Find an origin that is so far from the points that its unit is in doubt."""
    size = float(np.linalg.norm(np.ptp(position, axis=0)))
    away = float(np.linalg.norm(origin - position.mean(axis=0)))
    if size == 0 or away <= FARTHEST * size:
        return []
    text = (
        f"the origin of view {name} is {away:.3g} m from points that lie within {size:.3g} m of "
        f"one another; {key_of_view(name, 'origin')} is in m"
    )
    return [dataset.Finding("origin", f"view {name}", text, size=away / size, views=(name,))]


def _record(views: list[PointwiseData]) -> dict[str, str]:
    """Name what was decided of the files' conventions, as attributes."""
    keys = dict.fromkeys(key for view in views for key in view.told)
    return {
        f"import_{key}": "; ".join(dict.fromkeys(view.told.get(key, "") for view in views))
        for key in keys
    }


def _positions(views: list[PointwiseData], node: IntArray) -> Array | None:
    """Find nodes in the world, m, shape (point, 3); None if no file has any.

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
        there = np.array([int(n) in index for n in node])
        lost = [int(n) for n in node[~there] if n in view.measured]
        if lost:
            raise UserError(
                f"{view.source}: the geometry of view {view.name} lacks node {lost[0]}, for which "
                "there are functions"
            )
        own = np.full((len(node), 3), np.nan)
        places = view.geometry.position[[index[int(n)] for n in node[there]]]
        own[there] = view.length * places
        if found is None:
            found = own
        apart = np.linalg.norm(own - found, axis=1)  # NaN where only one has the node
        extent = float(np.nanmax(np.ptp(found[~np.isnan(found).any(axis=1)], axis=0)))
        if (apart > SAME_PLACE * max(extent, 1e-9)).any():
            worst = int(np.nanargmax(apart))
            raise UserError(
                f"{view.source}: the {called(view.names, int(node[worst]))} of view {view.name} is "
                f"{apart[worst]:.3g} m from where view {views[0].name} has it; the views must have "
                "one geometry in the axes of the world, not of each instrument"
                f"{_way_on(views)}"
            )
        found = np.where(np.isnan(found), own, found)
    return found


def _way_on(views: list[PointwiseData]) -> str:
    """Name a setting of one view where one of all fits not all units, and another way."""
    known = [view.places for view in views if view.places]
    if not known or len(known) == len(views):
        return ""
    other = next(view.name for view in views if not view.places)
    return (
        "; if units of coordinates are the reason, say that of one view alone with "
        f"{key_of_view(other, 'length_unit')}, or read coordinates of all views from {known[0]}, "
        f"which states their unit: instrument.geometry={known[0]} without instrument.length_unit"
    )


def _common(views: list[PointwiseData], incomplete: Incomplete) -> tuple[IntArray, list[Finding]]:
    """Find the nodes that all views have measured, or all nodes if they are to be marked."""
    seen = [view.seen for view in views]
    whole = np.unique(np.concatenate([view.node for view in views]))
    lost = lost_points(seen)
    everywhere = np.setdiff1d(whole, lost)
    marked = incomplete is Incomplete.mark and len(views) > LEAST
    if not len(everywhere) and not (marked and _is_seen_by(views, LEAST)):
        raise UserError("instrument.views: the views have no node in common that was measured")
    if not len(lost):
        return everywhere, []
    refused = lacking(seen)
    if incomplete is Incomplete.refuse and refused is not None:
        raise refused
    counts = ", ".join(
        f"view {view.name} {len(np.setdiff1d(whole, view.measured))}" for view in views
    )
    names = {n: own for view in views for n, own in view.names.items()}
    text = (
        f"{len(lost)} of {len(whole)} points are {incomplete.done}, as not all views have "
        f"measured them (missing: {counts}; the first is {called(names, int(lost[0]))})"
    )
    found = Finding("missing_points", "points", text, Severity.note, size=float(len(lost)))
    return (whole if incomplete is Incomplete.mark else everywhere), [found]


def _is_seen_by(views: list[PointwiseData], least: int) -> bool:
    """Tell whether some node was measured by so many views."""
    _, count = np.unique(np.concatenate([view.measured for view in views]), return_counts=True)
    return bool(len(count)) and int(count.max()) >= least


def _directions(
    own: PointwiseView,
    directions: Directions,
    view: PointwiseData,
    node: IntArray,
    at: IndexArray,
    position: Array | None,
    tree: Mapping[str, xr.Dataset],
    laser: TwoMirror | None,
) -> Array:
    """Find the unit vectors from the points to the instrument, shape (point, 3)."""
    if directions is Directions.dof:
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
    rotation, origin, laser = _pose_of(view.name, tree, laser)
    angles = project((position - origin) @ rotation.T, laser.mirror_offset)
    return direction_cosines(angles, rotation)


def _of_dofs(view: PointwiseData, node: IntArray, codes: IntArray) -> Array:
    """Turn the response directions into the world's axes."""
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


def _pose_of(
    name: str, tree: Mapping[str, xr.Dataset], laser: TwoMirror | None
) -> tuple[Array, Array, TwoMirror]:
    """Look up rotation and origin of a view, and the laser that they are of."""
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


def _shape(
    geometry: UniversalGeometry, node: IntArray, labels: list[str], position: Array
) -> xr.Dataset:
    """Give positions of points, and triangles and lines between them, for those who draw."""
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
        {"point": labels},
        position=position,
        triangle=between_points(corners),
        line=between_points(np.array(ends, np.int64).reshape(-1, 2)),
    )


def to_images(
    views: list[PointwiseData], tree: Mapping[str, xr.Dataset], laser: TwoMirror | None
) -> dict[str, xr.Dataset]:
    """Make the groups ``image/<view>`` for a field over a volume, a pixel for each node.

    Views whose pose was not found are left out.

    Parameters
    ----------
    tree : mapping of str to Dataset
        With the group ``pose``.

    Raises
    ------
    UserError
        If there is no geometry, pose, or standard error, or a point is off the board.
    """
    lost = dataset.views_without_pose(tree)
    return {
        f"image/{view.name}": _image(view, tree, laser) for view in views if view.name not in lost
    }


def _image(
    view: PointwiseData, tree: Mapping[str, xr.Dataset], laser: TwoMirror | None
) -> xr.Dataset:
    rotation, origin, laser = _pose_of(view.name, tree, laser)
    position = _positions([view], view.node)
    if position is None:
        raise UserError(
            f"{view.source}: has no geometry (data set 15 or 2411), by which points become pixels; "
            "name a file that has with instrument.geometry"
        )
    if view.std is None:
        raise no_errors(view.source)
    angle = project((position - origin) @ rotation.T, laser.mirror_offset)
    dac = laser.dac_from_angle(
        angle, [f"view {view.name}, {called(view.names, int(n))}" for n in view.node]
    )
    cosines = direction_cosines(angle, rotation)
    findings = view.findings + _turned_away(view, np.arange(len(view.node)), cosines)
    flagged = int(view.missing.sum())
    pixels, lines = view.velocity.shape
    made = dataset.group(
        "image",
        {"frequency": view.frequency},
        velocity=view.velocity,
        velocity_std=view.std,
        angle=angle,
        dac=dac,
        flags=view.missing.astype(np.int8),
        reference_amplitude=None if view.amplitude is None else np.full(lines, view.amplitude),
        coherence=view.coherence,
        records=np.full(pixels, view.records) if view.records else None,
    )
    if view.amplitude is not None and view.reference is not None:
        made["reference_amplitude"].attrs["units"] = view.reference.text or "1"
    summary = f"{flagged} of {len(view.node)} pixels are flagged"
    if flagged:
        text = f"view {view.name} has not measured {flagged} of its {len(view.node)} points"
        own = f"view {view.name}"
        findings.append(
            Finding(
                "missing_points", own, text, Severity.note, size=float(flagged), views=(view.name,)
            )
        )
    made = made.assign_attrs({"summary": summary} | _record([view]))
    return dataset.with_findings(made, findings)
