"""Data sets 18 and 2420: coordinate systems, and what a node's directions are in the world."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.io.uff.fortran import Lines
from sldvexp.io.uff.index import Entry
from sldvexp.io.uff.source import Source
from sldvexp.typing import Array

CARTESIAN, CYLINDRICAL, SPHERICAL = 0, 1, 2
#: How far from orthonormal axes may be that are written with six digits.
ORTHONORMAL = 1e-4


@dataclass(frozen=True, eq=False)
class System:
    """A coordinate system.

    Parameters
    ----------
    label : int
    kind : int
        `CARTESIAN`, `CYLINDRICAL` (r, theta, z) or `SPHERICAL` (r, theta from z, phi), in deg.
    axes : ndarray, shape (3, 3)
        Unit rows: the system's x, y and z in the world.
    origin : ndarray, shape (3,)
        In the world, the file's unit of length.
    """

    label: int
    kind: int
    axes: Array
    origin: Array

    def position(self, coordinates: Array) -> Array:
        """Points in the world, shape (3,)."""
        a, b, c = coordinates
        if self.kind == CYLINDRICAL:
            b = np.radians(b)
            coordinates = np.array([a * np.cos(b), a * np.sin(b), c])
        elif self.kind == SPHERICAL:
            b, c = np.radians([b, c])
            coordinates = a * np.array([np.sin(b) * np.cos(c), np.sin(b) * np.sin(c), np.cos(b)])
        return self.origin + coordinates @ self.axes

    def directions(self, position: Array) -> Array:
        """Unit rows of the system's three directions at a point of the world, shape (3, 3).

        On the axis of a cylindrical or spherical system they are those at theta = phi = 0.
        """
        if self.kind == CARTESIAN:
            return self.axes
        x, y, z = self.axes @ (position - self.origin)
        around = np.arctan2(y, x)
        c, s = np.cos(around), np.sin(around)
        if self.kind == CYLINDRICAL:
            own = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        else:
            down = np.arctan2(np.hypot(x, y), z)
            u, v = np.cos(down), np.sin(down)
            own = np.array([[v * c, v * s, u], [u * c, u * s, -v], [-s, c, 0.0]])
        return own @ self.axes


WORLD = System(0, CARTESIAN, np.eye(3), np.zeros(3))


def read_systems(source: Source, entries: list[Entry]) -> dict[int, System]:
    """The coordinate systems of a file by their label.

    Raises
    ------
    UserError
        If one is given twice, is not orthonormal, or refers to one that comes later or is missing.
    """
    systems: dict[int, System] = {}
    for entry in entries:
        lines = Lines(source, entry)
        if entry.kind == 2420:
            lines.integers("the part's number", 1)
            lines.next("the part's name")
        while lines:
            system = (_system_2420 if entry.kind == 2420 else _system_18)(lines, systems)
            if system.label in systems:
                raise lines.wrong(f"the coordinate system {system.label} is given twice")
            systems[system.label] = system
    return systems


def _system_2420(lines: Lines, _: dict[int, System]) -> System:
    """Axes and origin, one row a line."""
    label, kind = lines.integers("label and type of a coordinate system", 2)[:2]
    _check_kind(lines, label, kind)
    lines.next("the coordinate system's name")
    rows = np.array([lines.numbers("a row of the coordinate system", 3, 25) for _ in range(4)])
    axes = rows[:3]
    if np.abs(axes @ axes.T - np.eye(3)).max() > ORTHONORMAL or np.linalg.det(axes) < 0:
        raise lines.wrong(f"the axes of coordinate system {label} are not orthonormal")
    return System(label, kind, _orthonormal(axes), rows[3])


def _system_18(lines: Lines, known: dict[int, System]) -> System:
    """Origin, a point on the x axis and one in the xz plane, in the reference system."""
    label, kind, refers = lines.integers("label, type and reference of a coordinate system", 3)[:3]
    _check_kind(lines, label, kind)
    if refers > 0 and refers not in known and refers != 1:
        raise lines.wrong(f"the coordinate system {label} refers to {refers}, which is not given")
    lines.next("the coordinate system's name")
    points = lines.numbers("origin and point on the x axis", 6, 13)
    points += lines.numbers("point in the xz plane", 3, 13)
    reference = known.get(refers, WORLD)
    origin, on_x, in_xz = (reference.position(np.array(points[i : i + 3])) for i in (0, 3, 6))
    x, normal = on_x - origin, np.cross(in_xz - origin, on_x - origin)
    if not np.linalg.norm(normal) > 1e-9 * np.linalg.norm(x) ** 2:
        raise lines.wrong(f"the three points of coordinate system {label} lie on a line")
    x, y = x / np.linalg.norm(x), normal / np.linalg.norm(normal)
    return System(label, kind, np.stack([x, y, np.cross(x, y)]), origin)


def _check_kind(lines: Lines, label: int, kind: int) -> None:
    if kind not in (CARTESIAN, CYLINDRICAL, SPHERICAL):
        raise lines.wrong(
            f"the type of coordinate system {label} must be 0, 1 or 2 (Cartesian, cylindrical, "
            f"spherical), not {kind}"
        )


def _orthonormal(axes: Array) -> Array:
    """The nearest orthonormal axes."""
    left, _, right = np.linalg.svd(axes)
    return left @ right
