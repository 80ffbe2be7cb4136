"""`sldvexp aim`: where a point of the world is in DAC steps, and where the beam of steps goes.

Bounds in steps are those of the run's pose alone, ``C_dac = J C_pose J'`` with the derivatives J
of steps by the pose.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sldvexp import dataset
from sldvexp.config import Origins, composing, registry, schema
from sldvexp.config.experiment import Experiment
from sldvexp.config.paths import RUN_FILE
from sldvexp.errors import UserError, nearest
from sldvexp.geometry import KnownPose, euler_from_rotation, meets_plane, meets_triangles
from sldvexp.laser import TwoMirror, dac_jacobian, dac_of_points, rays
from sldvexp.lazy import xarray as xr
from sldvexp.pose.uncertainty import half_width, standard_error
from sldvexp.scan import Scan, ScanPart
from sldvexp.scan.by_hand import ByHand
from sldvexp.scan.rectangle import Rectangle
from sldvexp.scan.session import Session
from sldvexp.sweep import recorded_config
from sldvexp.targets import Circles, Target, unseen_circles
from sldvexp.typing import Array
from sldvexp.units import LengthUnit, beyond_belief, unit_named

#: Words of this command, and what stands behind the equals sign.
WORDS = {
    "view": "a view's name",
    "at": "a point x,y,z",
    "dac": "steps up_down,left_right",
    "unit": "a unit of length",
}
#: Numbers with commas between them, which no setting is.
NUMBERS = re.compile(r"[-+.,\d]*,[-+.,\d]*")
#: Corners of the box that a scan images.
BOX = 4


@dataclass(frozen=True, eq=False)
class PosedView:
    """One view: where its instrument stands, and who says so.

    Parameters
    ----------
    name : str
    rotation : ndarray, shape (3, 3)
        World to laser.
    origin : ndarray, shape (3,), m
    source : str
        Whose pose it is, for people.
    covariance : ndarray, shape (6, 6), optional
        Of rotation vector and origin, if the pose has bounds.
    dof : float
    confidence : float
    """

    name: str
    rotation: Array
    origin: Array
    source: str
    covariance: Array | None = None
    dof: float = np.inf
    confidence: float = 0.95

    def bounds(self, point: Array, laser: TwoMirror) -> Array | None:
        """Compute the half-widths of a point's steps, shape (2,), None if the pose has none."""
        if self.covariance is None or not np.isfinite(self.covariance).all():
            return None
        by_pose = dac_jacobian(point[None], self.rotation, self.origin, laser)[0]
        error = standard_error(by_pose @ self.covariance @ by_pose.T)
        return half_width(error, np.array(self.dof), self.confidence)


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Everything besides poses that is known of an experiment.

    Parameters
    ----------
    laser : TwoMirror
    target : Target or None
        Marks that the scan has of its own are one.
    scan : Scan or None
    surface : ndarray, shape (triangle, 3, 3), m
        Corners of the volume's surface; none without a volume.
    """

    laser: TwoMirror
    target: Target | None
    scan: Scan | None
    surface: Array


def run(words: list[str], config_dir: str | None) -> int:
    """Print what the words ask for, a line for each point or pair of steps and view.

    Raises
    ------
    UserError
        If there is no run or configuration, no pose, or a word cannot be understood.
    """
    asked: dict[str, list[str]] = {name: [] for name in WORDS}
    rest = []
    for word in words:
        name, equals, value = word.partition("=")
        asked[name].append(value) if equals and name in WORDS else rest.append(word)
        if name.isidentifier() and name not in WORDS and NUMBERS.fullmatch(value):
            told = nearest(name, WORDS)
            raise UserError(f"command line: aim takes no {word}; {told} (at= is a point, m)")
    unit = LengthUnit.m
    for value in asked["unit"]:
        unit = unit_named(LengthUnit, value, "command line: unit")
    points = [unit.value * _point(value, unit) for value in asked["at"]]
    steps = [_numbers("dac", value, 2) for value in asked["dac"]]
    if len(rest) == 1 and "=" not in rest[0]:
        views, around = of_run(Path(rest[0]))
    else:
        views, around = of_settings(rest, config_dir)
    for name in asked["view"]:
        if name not in [view.name for view in views]:
            told = nearest(name, [view.name for view in views])
            raise UserError(f"command line: there is no view {name}; {told}")
    for pair in steps:
        _require_on_board(pair, around.laser)
    for view in views:
        if asked["view"] and view.name not in asked["view"]:
            continue
        print(f"view {view.name}, {view.source}, at {_place(view.origin, unit)}")
        if not points and not steps:
            print("\n".join(known_lines(view, around, unit)))
        for point in points:
            print(point_line("", point, view, around.laser, unit))
        for pair in steps:
            print("\n".join(beam_lines(pair, view, around, unit)))
    return 0


def of_run(path: Path) -> tuple[list[PosedView], Surroundings]:
    """Take the poses that a run has found.

    Raises
    ------
    UserError
        If there is no finished run, or it has no poses.
    """
    file = path / RUN_FILE if path.is_dir() else path
    with dataset.load(file) as tree:
        found = recorded_config.read(file, tree.attrs)
        registry.load_installed()
        e = schema.build(found.config())
        if "pose" not in tree.children:
            raise UserError(f"{file}: the run has no poses; give settings instead, of their scan")
        pose = tree["pose"].to_dataset().load()
        volume = tree["volume"].to_dataset().load() if "volume" in tree.children else None
    method = found.plugins.get("pose", "given")
    views = []
    for name in pose["view"].values:
        one = pose.sel(view=name)
        bound = "dof" in one and "origin_confidence" in one
        views.append(
            PosedView(
                str(name),
                one["rotation"].values,
                one["origin"].values,
                f"its pose as pose={method} found it",
                one["covariance"].values if bound else None,
                float(one["dof"]) if bound else np.inf,
                float(pose.attrs.get("confidence_level", 0.95)),
            )
        )
    return views, _around(e, volume)


def of_settings(words: list[str], config_dir: str | None) -> tuple[list[PosedView], Surroundings]:
    """Take the poses that settings say.

    Raises
    ------
    UserError
        If they are no configuration, or say no pose.
    """
    wrong = Origins(words).unreadable
    if wrong and (Path(wrong[0]).is_dir() or wrong[0].endswith(".nc")):
        raise UserError(
            f"command line: aim takes the folder of a run, {wrong[0]}, or settings, not both; "
            "what a run was made with is known from it"
        )
    if wrong:
        raise UserError(
            f"command line: {wrong[0]} is neither a run nor a setting; aim takes the folder of a "
            f"run, or settings as experiment=plate, and {', '.join(f'{name}=' for name in WORDS)}"
        )
    e = composing.made_from(words, config_dir)
    told = {name: (pose, source) for source, poses in _stated(e) for name, pose in poses.items()}
    if not told:
        raise UserError(
            "aim: these settings say nowhere where the instrument stands: give rough poses in "
            f"{(e.scan or Session).rough_poses_key}, or pose=given, or a scene, or the folder of a "
            "finished run"
        )
    views = [PosedView(n, pose.rotation, pose.place, source) for n, (pose, source) in told.items()]
    return views, _around(e, e.volume.group() if e.volume else None)


def _stated(e: Experiment) -> Iterator[tuple[str, dict[str, KnownPose]]]:
    """Yield poses that settings state, those that win last."""
    yield "its true pose in the scene", getattr(e.scene, "views", {})
    yield "its pose as pose=given has it", getattr(e.pose, "views", {})
    yield "its rough pose of the scan", e.scan.rough_poses() if e.scan else {}


def _around(e: Experiment, volume: xr.Dataset | None) -> Surroundings:
    if e.laser is None:
        raise UserError("aim: there is no laser; choose laser=ometron or one of yours")
    surface = np.zeros((0, 3, 3))
    if volume is not None and volume.attrs.get("triangles"):
        lowest = volume["element"].values[: volume.attrs["triangles"], :3]
        layer = int(np.abs(volume["depth"].values).argmin())
        surface = volume["position"].values[lowest + layer * int(volume.attrs["surface_nodes"])]
    own = [part.own_marks() for part in _parts(e.scan) if isinstance(part, ByHand)]
    return Surroundings(e.laser, next(filter(None, own), e.target), e.scan, surface)


def _parts(scan: Scan | None) -> list[ScanPart]:
    """List the parts of a scan's first view, which are of the same kinds in all."""
    return scan.parts(scan.view_names()[0]) if scan and scan.view_names() else []


def known_lines(view: PosedView, around: Surroundings, unit: LengthUnit) -> Iterator[str]:
    """Yield a line for each circle or mark, and each corner of the region, that is known."""
    target, laser = around.target, around.laser
    if isinstance(target, Circles):
        unseen = unseen_circles(view.origin, target)
        for number, edge in zip(target.circles, target.outlines(), strict=True):
            yield point_line(f"circle {number} ", edge.mean(axis=0), view, laser, unit)
            if number in unseen:
                yield f"    it is {unseen[number]}"
            elif beyond := _unreachable(edge, view, laser):
                yield f"    its edge: {beyond}"
    elif target is not None:
        points = target.points()
        for number, point in zip(points.number, points.position, strict=True):
            yield point_line(f"mark {number} ", point, view, laser, unit)
    parts = around.scan.parts(view.name) if around.scan and _has(around.scan, view.name) else []
    for part in parts:
        corners = _corners(part, view.name)
        # The box that is scanned has four corners; a region of others has points beside them.
        name = "corner" if len(corners) == BOX else "corners_at, point"
        for k, corner in enumerate(corners, 1):
            yield point_line(f"{name} {k} ", corner, view, laser, unit)
        if isinstance(part, Rectangle):
            yield from _box_line(part, view, laser)
    if len(around.surface):
        low, high = around.surface.min(axis=(0, 1)), around.surface.max(axis=(0, 1))
        yield f"  surface of the volume from {_place(low, unit)} to {_place(high, unit)}"


def _unreachable(points: Array, view: PosedView, laser: TwoMirror) -> str:
    """Say which of the points the beam cannot go to; nothing if it can go to all."""
    names = [f"point {k}" for k in range(1, len(points) + 1)]
    try:
        dac_of_points(points, view.rotation, view.origin, laser, names)
    except UserError as error:
        return str(error)
    return ""


def _box_line(part: Rectangle, view: PosedView, laser: TwoMirror) -> Iterator[str]:
    """Yield a line with the corners of the box that is scanned, in steps, if they are known."""
    given = part.views[view.name].corners
    pose = KnownPose(euler_from_rotation(view.rotation).tolist(), view.origin.tolist())
    with suppress(UserError):  # the line of a corner says why it cannot be reached
        steps = given or part.box(view.name, pose, laser).tolist()
        what = "scan of the box around" if given else "box that is scanned:"
        told = ", ".join(f"corner {k} dac {u} {v}" for k, (u, v) in enumerate(steps, 1))
        yield from [f"  {what} {told}"] * bool(told)


def _has(scan: Scan, view: str) -> bool:
    return view in scan.view_names()


def _corners(part: ScanPart, view: str) -> Array:
    """Find a region's corners in the world, shape (corner, 3), m; none if steps are given."""
    region: Any = part.views[view]
    found = getattr(region, "corners_at", []) or getattr(part, "corners_at", [])
    unit = getattr(part, "unit", LengthUnit.m)
    return np.array(found, float).reshape(-1, 3) * unit.value


def point_line(name: str, point: Array, view: PosedView, laser: TwoMirror, unit: LengthUnit) -> str:
    """Say where a point is in DAC steps and mirror angles, or why the beam cannot go there."""
    told = f"  {name}{_place(point, unit)}: "
    try:
        steps = dac_of_points(point[None], view.rotation, view.origin, laser, ["it"])[0]
    except UserError as error:
        return told + str(error)
    whole = np.rint(steps).astype(int)
    up_down, left_right = np.rad2deg(laser.angle_from_dac(steps))
    bounds = view.bounds(point, laser)
    sure = "" if bounds is None else f" ± {bounds[0]:.2g} {bounds[1]:.2g}"
    away = np.linalg.norm(point - view.origin) / unit.value
    return (
        f"{told}dac {whole[0]} {whole[1]}{sure}, mirrors {up_down:.3f} {left_right:.3f} deg, "
        f"{away:.4g} {unit.name} away"
    )


def beam_lines(
    steps: Array, view: PosedView, around: Surroundings, unit: LengthUnit
) -> Iterator[str]:
    """Yield where the beam of DAC steps comes from and goes, and what it meets."""
    laser = around.laser
    angle = laser.angle_from_dac(steps)
    own, along = rays(angle, laser.mirror_offset)
    origin = view.origin + own @ view.rotation
    direction = along @ view.rotation
    up_down, left_right = np.rad2deg(angle)
    yield (
        f"  dac {steps[0]:g} {steps[1]:g}: mirrors {up_down:.3f} {left_right:.3f} deg, from "
        f"{_place(origin, unit)} along ({', '.join(f'{d:.5f}' for d in direction)})"
    )
    met = {}
    if len(around.surface):
        met["the volume's surface"] = meets_triangles(origin, direction, around.surface)
    if isinstance(around.target, Circles):
        for name, plane in around.target.planes.items():
            point = around.target.unit.value * np.array(plane.origin)
            distance = meets_plane(origin, direction, point, plane.normal)
            met[f"the calibration object's plane {name}"] = distance
    if not met:
        met["the plane z = 0"] = meets_plane(origin, direction, [0, 0, 0], [0, 0, 1])
    for name, distance in met.items():
        where = _place(origin + distance * direction, unit) if np.isfinite(distance) else "nowhere"
        yield f"    meets {name}: {where}"


def _place(point: Array, unit: LengthUnit) -> str:
    """Write a point of the world in a unit, to a hundredth of a mm."""
    digits = max(0, 5 + round(np.log10(unit.value)))
    return f"({', '.join(f'{x:.{digits}f}' for x in point / unit.value + 0.0)}) {unit.name}"


def _require_on_board(steps: Array, laser: TwoMirror) -> None:
    try:
        laser.angle_from_dac(steps, f"dac={steps[0]:g},{steps[1]:g}")
    except UserError as error:
        raise UserError(f"command line: {str(error).removeprefix('point ')}") from None


def _point(text: str, unit: LengthUnit) -> Array:
    """Read a point, of which no coordinate is beyond all that is measured."""
    point = _numbers("at", text, 3)
    if told := beyond_belief(unit, *point):
        raise UserError(f"command line: at={text}: {told} (unit=mm says so)")
    return point


def _numbers(name: str, text: str, count: int) -> Array:
    """Read numbers with commas between them."""
    try:
        found = np.array([float(part) for part in text.strip("[]()").split(",")])
    except ValueError:
        found = np.zeros(0)
    if len(found) != count or not np.isfinite(found).all():
        raise UserError(f"command line: {name}={text}: must be {WORDS[name]}, numbers with commas")
    return found
