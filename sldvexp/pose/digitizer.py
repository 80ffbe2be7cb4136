"""`pose=digitizer`: pose from points digitised on the object and on the instrument itself.

Each repeat of the points gives two rigid motions from the digitizer's axes (Section 4.6.3), one
into the laser frame by the instrument's posts and one into the world by the object's points. The
pose is the mean over the repeats, its covariance that of this mean. Repeats with a wrong reading
are left out and named. The spread of the repeats knows nothing of errors in the posts' own
coordinates, which show where the posts' distances differ from those that were digitised.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from omegaconf import MISSING

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.errors import Checks, ConfigError, Problem, UserError, nearest
from sldvexp.files import read_text, require_file
from sldvexp.geometry import nearest_rotation, rigid_transform, vector_from_rotation
from sldvexp.io import read_table
from sldvexp.io.tables import AXES, COORDINATES, number, plain_cells
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import PoseMethod, PoseResult, pose_to_dataset
from sldvexp.pose.digitised_points import judge_readings, judge_shape
from sldvexp.targets import Target
from sldvexp.typing import Array
from sldvexp.units import LengthUnit


@register("pose", "digitizer")
@dataclass
class Digitizer(PoseMethod):
    """Rigid transform from repeated triples on the object and on the instrument (Section 4.6.3).

    Repeats with a wrong reading are left out and named (`sldvexp.pose.digitised_points`).

    Parameters
    ----------
    path : str
        Digitised points in the digitizer's own axes, every point several times: a ``.csv`` with
        the columns ``point,x_m,y_m,z_m`` (or another unit), or a plain table of x y z (``.sev``)
        with the instrument's points first, then the object's, each with all its repeats together.
    unit : LengthUnit
        Of a plain table, and of the points below.
    instrument_points : dict of str to list of float
        Where the digitised posts stand in the laser frame, ``{low: [x, y, z], med: ...}``.
    object_points : dict of str to list of float
        Where the digitised points of the object stand in the world.
    view : str
        Name of the view.
    confidence : float
        Level of the intervals.
    """

    path: str = MISSING
    unit: LengthUnit = LengthUnit.m
    instrument_points: dict[str, list[float]] = field(default_factory=dict)
    object_points: dict[str, list[float]] = field(default_factory=dict)
    view: str = "digitizer"
    confidence: float = 0.95

    def __post_init__(self) -> None:
        checks = Checks()
        checks.probability("confidence", self.confidence)
        checks.require(bool(self.view.strip()), "view", "must be a name")
        for name in ("instrument_points", "object_points"):
            points = getattr(self, name)
            enough = f"needs at least three points, not {len(points)}"
            checks.require(len(points) >= 3, name, enough)
            for label, xyz in points.items():
                wrong = f"must be three coordinates, not {len(xyz)}"
                checks.require(len(xyz) == 3, f"{name}.{label}", wrong)
                checks.finite(f"{name}.{label}", *xyz)
        both = set(self.instrument_points) & set(self.object_points)
        message = f"has names that object_points has too: {', '.join(sorted(both))}"
        checks.require(not both, "instrument_points", message)
        checks.done()

    def inputs(self) -> list[str]:
        """List the digitised points."""
        return [self.path]

    def estimate(
        self, laser: TwoMirror | None, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> PoseResult:
        """Average one pose for each repeat; attribute ``fit_rms`` is how well they fit, in m."""
        path = locate(self.path)
        names = [*self.instrument_points, *self.object_points]
        readings = read_repeats(path, names, self.unit)
        right, findings = judge_readings(readings, names, self.view, path.name)
        digitised = readings[right]
        posts = len(self.instrument_points)
        known = [
            np.array(list(points.values()), float) * self.unit.value
            for points in (self.instrument_points, self.object_points)
        ]
        measured = [digitised[:, :posts], digitised[:, posts:]]
        for what, points, repeats in zip(
            ("instrument_points", "object_points"), known, measured, strict=True
        ):
            _check_triangles(what, points, repeats, path)
            own = list(getattr(self, what))
            findings += judge_shape(repeats, points, own, self.view, f"pose.{what}")
        motions = [rigid_transform(m, k) for m, k in zip(measured, known, strict=True)]
        (to_laser, laser_shift), (to_world, world_shift) = motions
        rotation = to_laser @ np.swapaxes(to_world, 1, 2)
        origin = world_shift - np.einsum("kji,kj->ki", rotation, laser_shift)
        mean_rotation = nearest_rotation(rotation.mean(axis=0))
        count = len(rotation)
        deviation = np.hstack([vector_from_rotation(rotation @ mean_rotation.T), origin])
        covariance = np.cov(deviation.T) / count if count > 1 else np.full((6, 6), np.nan)
        pose = pose_to_dataset(
            [self.view],
            mean_rotation[None],
            origin.mean(axis=0)[None],
            covariance[None],
            [count - 1],
            self.confidence,
        )
        misfit = [
            np.einsum("kij,knj->kni", turn, m) + shift[:, None] - k
            for (turn, shift), m, k in zip(motions, measured, known, strict=True)
        ]
        pose.attrs |= {
            "repeats": count,
            "fit_rms": float(np.sqrt((np.concatenate(misfit, axis=1) ** 2).sum(-1).mean())),
            "source": path.name,
        }
        if count == 1:
            pose.attrs["notes"] = (
                f"view {self.view}: a single repeat gives no bounds; digitise again"
            )
        return PoseResult(pose, findings=findings)


#: Three points whose smaller extent is below this fraction of their larger one lie on a line.
COLLINEAR = 1e-3


def _check_triangles(what: str, points: Array, repeats: Array, path: Path) -> None:
    """Refuse points on one line: they leave the rotation about it unknown."""
    if not _is_triangle(points):
        message = "the points lie on one line; the rotation about it is unknown"
        raise ConfigError([Problem(f"pose.{what}", message)])
    for repeat, triple in enumerate(repeats, 1):
        if not _is_triangle(triple):
            raise UserError(
                f"{path}: repeat {repeat} of the {what} lies on one line; digitise it again"
            )


def _is_triangle(points: Array) -> bool:
    """Tell whether points span a plane."""
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(extent[1] > COLLINEAR * extent[0])


def read_repeats(path: Path, names: list[str], unit: LengthUnit) -> Array:
    """Read digitised coordinates, shape (repeat, point, 3), m, the points in the order of `names`.

    Raises
    ------
    UserError
        If a point is unknown or missing, or the points differ in how often they were digitised.
    """
    require_file(path)
    found: dict[str, list[list[float]]] = {name: [] for name in names}
    if path.suffix.lower() == ".csv":
        _read_csv(path, found)
    else:
        _read_plain(path, found, unit)
    counts = {len(rows) for rows in found.values()}
    if 0 in counts:
        missing = next(name for name, rows in found.items() if not rows)
        raise UserError(f"{path}: the point {missing} is not there")
    if len(counts) > 1:
        told = ", ".join(f"{name} {len(rows)} times" for name, rows in found.items())
        raise UserError(f"{path}: every point must be digitised equally often, but there is {told}")
    return np.swapaxes(np.array(list(found.values())), 0, 1)


def _read_csv(path: Path, found: dict[str, list[list[float]]]) -> None:
    """Read the rows of a table with named columns, m."""
    table = read_table(path)
    needed = f"needed are point, {COORDINATES}"
    table.require(["point"], needed)
    position, _ = table.quantity(AXES, LengthUnit, needed)
    for i, (name, xyz) in enumerate(zip(table.column("point"), position.tolist(), strict=True)):
        if name not in found:
            raise UserError(f"{table.where(i)}: no point is called {name}; {nearest(name, found)}")
        found[name].append(xyz)


def _read_plain(path: Path, found: dict[str, list[list[float]]], unit: LengthUnit) -> None:
    """Read rows of three numbers in `unit`, each point's repeats together, in the names' order."""
    rows = [[x * unit.value for x in xyz] for xyz in _plain_rows(path)]
    if not rows or len(rows) % len(found):
        raise UserError(
            f"{path}: has {len(rows)} lines, which {len(found)} points digitised equally often "
            "cannot give"
        )
    repeats = len(rows) // len(found)
    for i, name in enumerate(found):
        found[name] = rows[i * repeats : (i + 1) * repeats]


def _plain_rows(path: Path) -> Iterator[list[float]]:
    """Give three numbers a line, separated by blanks, commas or semicolons."""
    for line, text in enumerate(read_text(path).splitlines(), 1):
        cells = plain_cells(text)
        if not cells or cells[0].startswith("#"):
            continue
        if len(cells) != 3:
            raise UserError(f"{path}, line {line}: must be x y z, not {text.strip()!r}")
        yield [number(c, "a coordinate", f"{path}, line {line}") for c in cells]
