"""Geometry of universal files: nodes (15, 2411), elements (2412), lines (82), systems (18, 2420).

A node has coordinates in one system and moves along the directions of another, which at each node
of a cylindrical or spherical system are its own; both are turned to the world's here. Angles in
the file are in degrees.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.io.uff.fortran import TextLines, integers, numbers
from sldvexp.io.uff.source import DataSet, Source, shown
from sldvexp.typing import Array, IntArray

CARTESIAN, CYLINDRICAL, SPHERICAL = 0, 1, 2
#: How far two positions may be apart of which one has six digits, relatively.
SIX_DIGITS = 1e-5
#: How far from orthonormal axes may be that are written with six digits.
ORTHONORMAL = 1e-4


@dataclass(frozen=True, eq=False)
class CoordinateSystem:
    """Coordinate system of a universal file.

    Parameters
    ----------
    label : int
        By which nodes name it.
    kind : int
        `CARTESIAN`, `CYLINDRICAL` (r, theta, z) or `SPHERICAL` (r, theta from z, phi), in deg.
    axes : ndarray, shape (3, 3)
        Unit rows: x, y and z of the system in the world.
    origin : ndarray, shape (3,)
        In the world, the file's unit of length.
    """

    label: int
    kind: int
    axes: Array
    origin: Array

    def is_like(self, other: CoordinateSystem) -> bool:
        """Tell whether two are the same, of which one may have six digits."""
        same = self.kind == other.kind and np.abs(self.axes - other.axes).max() <= SIX_DIGITS
        return bool(same and _alike(self.origin, other.origin))

    def position(self, coordinates: Array) -> Array:
        """Put a point of the system into the world, shape (3,)."""
        a, b, c = coordinates
        if self.kind == CYLINDRICAL:
            b = np.radians(b)
            coordinates = np.array([a * np.cos(b), a * np.sin(b), c])
        elif self.kind == SPHERICAL:
            b, c = np.radians([b, c])
            coordinates = a * np.array([np.sin(b) * np.cos(c), np.sin(b) * np.sin(c), np.cos(b)])
        return self.origin + coordinates @ self.axes

    def directions(self, position: Array) -> Array:
        """Find the system's three directions at a point of the world, unit rows, shape (3, 3).

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


WORLD = CoordinateSystem(0, CARTESIAN, np.eye(3), np.zeros(3))


def read_systems(source: Source, entries: list[DataSet]) -> dict[int, CoordinateSystem]:
    """Read the coordinate systems of a file by their label.

    Raises
    ------
    UserError
        If one is given twice, is not orthonormal, or refers to one that comes later or is missing.
    """
    systems: dict[int, CoordinateSystem] = {}
    for entry in entries:
        lines = TextLines(source, entry)
        if entry.kind == 2420:
            lines.integers("the part's number", 1)
            lines.next("the part's name")
        while lines:
            system = (_system_2420 if entry.kind == 2420 else _system_18)(lines, systems)
            if (before := systems.get(system.label)) is not None:
                if before.is_like(system):
                    continue
                raise lines.wrong(f"the coordinate system {system.label} is given twice")
            systems[system.label] = system
    return systems


def _system_2420(lines: TextLines, _: dict[int, CoordinateSystem]) -> CoordinateSystem:
    """Read axes and origin, one row a line."""
    label, kind = lines.integers("label and type of a coordinate system", 2)[:2]
    _check_kind(lines, label, kind)
    lines.next("the coordinate system's name")
    rows = np.array([lines.numbers("a row of the coordinate system", 3, 25) for _ in range(4)])
    axes = rows[:3]
    if np.abs(axes @ axes.T - np.eye(3)).max() > ORTHONORMAL or np.linalg.det(axes) < 0:
        raise lines.wrong(f"the axes of coordinate system {label} are not orthonormal")
    return CoordinateSystem(label, kind, _orthonormal(axes), rows[3])


def _system_18(lines: TextLines, known: dict[int, CoordinateSystem]) -> CoordinateSystem:
    """Read origin, a point on the x axis and one in the xz plane, in the reference system."""
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
    return CoordinateSystem(label, kind, np.stack([x, y, np.cross(x, y)]), origin)


def _check_kind(lines: TextLines, label: int, kind: int) -> None:
    """Refuse kinds of coordinate systems that there are not."""
    if kind not in (CARTESIAN, CYLINDRICAL, SPHERICAL):
        raise lines.wrong(
            f"the type of coordinate system {label} must be 0, 1 or 2 (Cartesian, cylindrical, "
            f"spherical), not {kind}"
        )


def _orthonormal(axes: Array) -> Array:
    """Find the nearest orthonormal axes."""
    left, _, right = np.linalg.svd(axes)
    return left @ right


#: Elements of data set 2412 that have a line about their orientation.
BEAMS = (11, 21, 22, 23, 24)
#: Surface elements of data set 2412 by their number, of first and second order.
TRIANGLES = (41, 51, 61, 74, 81, 91)
TRIANGLES_2 = (42, 52, 62, 72, 82, 92)
QUADRILATERALS = (44, 54, 64, 71, 84, 94)
QUADRILATERALS_2 = (45, 55, 65, 85, 95)
SOLIDS = range(101, 120)
NODES_15, NODES_2411, ELEMENTS, LINES = 15, 2411, 2412, 82
GEOMETRY = (NODES_15, NODES_2411, 18, 2420, ELEMENTS, LINES)


@dataclass(frozen=True, eq=False)
class UniversalGeometry:
    """Nodes and what connects them.

    Parameters
    ----------
    label : ndarray of int, shape (node,)
        By which functions and elements name a node.
    position : ndarray, shape (node, 3)
        In the world, the file's unit of length.
    system : tuple of CoordinateSystem
        Of each node's directions.
    triangles, quadrilaterals : ndarray of int, shape (element, 3) and (element, 4)
        Indices of nodes.
    lines : tuple of tuple of int
        Indices of nodes that a line joins.
    solids : int
        Number of solid elements, which are left out.
    """

    label: IntArray
    position: Array
    system: tuple[CoordinateSystem, ...]
    triangles: IntArray
    quadrilaterals: IntArray
    lines: tuple[tuple[int, ...], ...]
    solids: int = 0

    def index(self) -> dict[int, int]:
        """Map each node's label to its index."""
        return {int(label): i for i, label in enumerate(self.label)}

    def direction(self, node: int, code: int) -> Array:
        """Find the unit vector of a translation, +-1 to +-3 for +-x to +-z, at a node."""
        own = self.system[node].directions(self.position[node])
        return np.sign(code) * own[abs(code) - 1]


def read_geometry(source: Source, entries: list[DataSet]) -> UniversalGeometry | None:
    """Read the geometry of a file, None if it has no nodes.

    Raises
    ------
    UserError
        If a node is given twice, an element or line names one that is not there, or a node's
        coordinate system is missing.
    """
    of = {kind: [e for e in entries if e.kind == kind] for kind in GEOMETRY}
    if not of[NODES_15] and not of[NODES_2411]:
        return None
    systems = read_systems(source, [e for e in entries if e.kind in (18, 2420)])
    nodes: dict[int, tuple[Array, CoordinateSystem]] = {}
    for entry in sorted(of[NODES_15] + of[NODES_2411], key=lambda e: e.number):
        _nodes(TextLines(source, entry), systems, nodes)
    index = {label: i for i, label in enumerate(nodes)}
    elements: list[tuple[int, ...]] = []
    solids, seen = 0, set[tuple[int, ...]]()
    for entry in of[ELEMENTS]:
        found, others = _elements(TextLines(source, entry), index, seen)
        elements, solids = elements + found, solids + others
    lines: list[tuple[int, ...]] = []
    for entry in of[LINES]:
        lines += _lines(TextLines(source, entry), index)
    corners = {n: [e for e in elements if len(e) == n] for n in (3, 4)}
    return UniversalGeometry(
        np.array(list(nodes), np.int64),
        np.array([p for p, _ in nodes.values()]).reshape(-1, 3),
        tuple(s for _, s in nodes.values()),
        np.array(corners[3], np.int64).reshape(-1, 3),
        np.array(corners[4], np.int64).reshape(-1, 4),
        tuple(lines),
        solids,
    )


def _nodes(
    lines: TextLines,
    systems: dict[int, CoordinateSystem],
    nodes: dict[int, tuple[Array, CoordinateSystem]],
) -> None:
    """Add the nodes of a data set."""
    if not lines:
        raise lines.wrong("has no nodes")
    while lines:
        begin = lines.at
        if lines.entry.kind == NODES_15:
            head, coordinates = _node_15(lines)
        else:
            head = lines.integers("label and coordinate systems of a node", 3)
            coordinates = lines.numbers(f"coordinates of node {head[0]}", 3, 25)
        label = head[0]
        of_position, of_motion = (_system(lines, begin, label, s, systems) for s in head[1:3])
        position = of_position.position(np.array(coordinates))
        if label in nodes:
            before, motion = nodes[label]
            if not (_alike(position, before) and of_motion.is_like(motion)):
                raise lines.wrong(
                    f"the node {label} is given twice, here at {_shown(position)} and before at "
                    f"{_shown(before)}",
                    begin,
                )
            if lines.entry.kind == NODES_15:  # of fewer digits
                continue
        nodes[label] = (position, of_motion)


def _alike(one: Array, two: Array) -> bool:
    """Tell whether two positions are the same, of which one may have six digits."""
    return bool(np.abs(one - two).max() <= SIX_DIGITS * max(np.abs(one).max(), np.abs(two).max()))


def _shown(position: Array) -> str:
    """Show a position in a message."""
    return f"({', '.join(f'{x:g}' for x in position)})"


def _node_15(lines: TextLines) -> tuple[list[int], list[float]]:
    """Read label, systems and coordinates of data set 15: 4I10, 3E13.5."""
    line = lines.next("a node")
    for head, rest in ((line[:40], line[40:]), _split(line)):
        whole, real = integers(head, 10), numbers(rest, 13)
        if whole and real and len(whole) == 4 and len(real) == 3 and np.isfinite(real).all():
            return whole, real
    raise lines.wrong(f"a node must be four integers and three numbers, not {shown(line)}")


def _split(line: bytes) -> tuple[bytes, bytes]:
    """Split off four fields between blanks."""
    fields = line.split()
    return b" ".join(fields[:4]), b" ".join(fields[4:])


def _system(
    lines: TextLines, line: int, node: int, label: int, systems: dict[int, CoordinateSystem]
) -> CoordinateSystem:
    """Find the system of that label; 0, and 1 where a file defines none, is the world."""
    if label in systems:
        return systems[label]
    if label == 0 or (label == 1 and not systems):
        return WORLD
    message = f"the node {node} is in coordinate system {label}, which is not given"
    raise lines.wrong(message, line)


def _elements(
    lines: TextLines, index: dict[int, int], seen: set[tuple[int, ...]]
) -> tuple[list[tuple[int, ...]], int]:
    """Read corners of the surface elements of a data set 2412, and count the solid ones."""
    found, solids = [], 0
    while lines:
        head = lines.integers("label, kind and number of nodes of an element", 6)
        label, kind, count = head[0], head[1], head[5]
        if not 1 <= count <= 8 * (len(lines.text) - lines.at):
            raise lines.wrong(f"the element {label} claims {count} nodes, which are not there")
        solids += kind in SOLIDS
        if kind in BEAMS:
            lines.next(f"the orientation of element {label}")
        nodes: list[int] = []
        while len(nodes) < count:
            nodes += lines.integers(f"the nodes of element {label}", 1)
        if len(nodes) != count:
            raise lines.wrong(f"the element {label} has {len(nodes)} nodes, not {count}")
        corners = _corners(kind, nodes)
        if len(set(corners)) != len(corners):
            raise lines.wrong(f"the element {label} has one node twice")
        if corners and (label, *corners) not in seen:  # the same element may be given twice
            seen.add((label, *corners))
            found.append(_indices(lines, corners, index, f"the element {label}"))
    return found, solids


def _corners(kind: int, nodes: list[int]) -> list[int]:
    """Find the corners of a surface element; those of second order have nodes between them."""
    for kinds, count, step in (
        (TRIANGLES, 3, 1),
        (TRIANGLES_2, 3, 2),
        (QUADRILATERALS, 4, 1),
        (QUADRILATERALS_2, 4, 2),
    ):
        if kind in kinds and len(nodes) >= count * step:
            return nodes[: count * step : step]
    return []


def _lines(lines: TextLines, index: dict[int, int]) -> list[tuple[int, ...]]:
    """Read the lines of a data set 82; a node 0 lifts the pen."""
    number, count = lines.integers("number of the line and of its nodes", 2)[:2]
    lines.next("the line's name")
    if not 0 <= count <= 8 * (len(lines.text) - lines.at):
        raise lines.wrong(f"the line {number} claims {count} nodes, which are not there")
    nodes: list[int] = []
    while len(nodes) < count:
        nodes += lines.integers(f"the nodes of line {number}", 1)
    found: list[list[int]] = [[]]
    for node in nodes[:count]:
        if node == 0:
            found.append([])
        else:
            found[-1].append(node)
    return [_indices(lines, part, index, f"the line {number}") for part in found if len(part) > 1]


def _indices(
    lines: TextLines, nodes: list[int], index: dict[int, int], whose: str
) -> tuple[int, ...]:
    """Find indices of nodes by their labels."""
    lost = [n for n in nodes if n not in index]
    if lost:
        raise lines.wrong(f"{whose} names the node {lost[0]}, which is not given")
    return tuple(index[n] for n in nodes)
