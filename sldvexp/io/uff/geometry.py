"""Data sets 15, 2411, 2412 and 82: nodes in the world, elements and lines between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.io.uff.fortran import Lines, integers, numbers
from sldvexp.io.uff.index import Entry, shown
from sldvexp.io.uff.source import Source
from sldvexp.io.uff.systems import WORLD, System, read_systems
from sldvexp.typing import Array, IntArray

#: Elements of data set 2412 that have a line about their orientation.
BEAMS = (11, 21, 22, 23, 24)
#: Surface elements of data set 2412 by their number, of first and second order.
TRIANGLES = (41, 51, 61, 74, 81, 91)
TRIANGLES_2 = (42, 52, 62, 72, 82, 92)
QUADRILATERALS = (44, 54, 64, 71, 84, 94)
QUADRILATERALS_2 = (45, 55, 65, 85, 95)
NODES_15, NODES_2411, ELEMENTS, LINES = 15, 2411, 2412, 82
GEOMETRY = (NODES_15, NODES_2411, 18, 2420, ELEMENTS, LINES)


@dataclass(frozen=True, eq=False)
class Geometry:
    """Nodes and what connects them.

    Parameters
    ----------
    label : ndarray of int, shape (node,)
    position : ndarray, shape (node, 3)
        In the world, the file's unit of length.
    system : tuple of System
        Of each node's directions.
    triangles, quadrilaterals : ndarray of int, shape (element, 3) and (element, 4)
        Indices of nodes.
    lines : tuple of tuple of int
        Indices of nodes that a line joins.
    """

    label: IntArray
    position: Array
    system: tuple[System, ...]
    triangles: IntArray
    quadrilaterals: IntArray
    lines: tuple[tuple[int, ...], ...]

    def index(self) -> dict[int, int]:
        """Index of each node by its label."""
        return {int(label): i for i, label in enumerate(self.label)}

    def direction(self, node: int, code: int) -> Array:
        """Unit vector of a translation, +-1 to +-3 for +-x to +-z, at the node of that index."""
        own = self.system[node].directions(self.position[node])
        return np.sign(code) * own[abs(code) - 1]


def read_geometry(source: Source, entries: list[Entry]) -> Geometry | None:
    """The geometry of a file, None if it has no nodes.

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
    nodes: dict[int, tuple[Array, System]] = {}
    for entry in sorted(of[NODES_15] + of[NODES_2411], key=lambda e: e.number):
        _nodes(Lines(source, entry), systems, nodes)
    index = {label: i for i, label in enumerate(nodes)}
    elements: list[tuple[int, ...]] = []
    for entry in of[ELEMENTS]:
        elements += _elements(Lines(source, entry), index)
    lines: list[tuple[int, ...]] = []
    for entry in of[LINES]:
        lines += _lines(Lines(source, entry), index)
    corners = {n: [e for e in elements if len(e) == n] for n in (3, 4)}
    return Geometry(
        np.array(list(nodes), np.int64),
        np.array([p for p, _ in nodes.values()]).reshape(-1, 3),
        tuple(s for _, s in nodes.values()),
        np.array(corners[3], np.int64).reshape(-1, 3),
        np.array(corners[4], np.int64).reshape(-1, 4),
        tuple(lines),
    )


def _nodes(
    lines: Lines, systems: dict[int, System], nodes: dict[int, tuple[Array, System]]
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
        if label in nodes:
            raise lines.wrong(f"the node {label} is given twice", begin)
        of_position, of_motion = (_system(lines, begin, label, s, systems) for s in head[1:3])
        nodes[label] = (of_position.position(np.array(coordinates)), of_motion)


def _node_15(lines: Lines) -> tuple[list[int], list[float]]:
    """Label, systems and coordinates of data set 15: 4I10, 3E13.5."""
    line = lines.next("a node")
    for head, rest in ((line[:40], line[40:]), _split(line)):
        whole, real = integers(head, 10), numbers(rest, 13)
        if whole and real and len(whole) == 4 and len(real) == 3 and np.isfinite(real).all():
            return whole, real
    raise lines.wrong(f"a node must be four integers and three numbers, not {shown(line)}")


def _split(line: bytes) -> tuple[bytes, bytes]:
    """Four fields between blanks, and the rest."""
    fields = line.split()
    return b" ".join(fields[:4]), b" ".join(fields[4:])


def _system(lines: Lines, line: int, node: int, label: int, systems: dict[int, System]) -> System:
    """The system of that label; 0, and 1 where a file defines none, is the world."""
    if label in systems:
        return systems[label]
    if label == 0 or (label == 1 and not systems):
        return WORLD
    message = f"the node {node} is in coordinate system {label}, which is not given"
    raise lines.wrong(message, line)


def _elements(lines: Lines, index: dict[int, int]) -> list[tuple[int, ...]]:
    """Corners of the surface elements of a data set 2412; others are left out."""
    found = []
    while lines:
        head = lines.integers("label, kind and number of nodes of an element", 6)
        label, kind, count = head[0], head[1], head[5]
        if not 1 <= count <= 8 * (len(lines.text) - lines.at):
            raise lines.wrong(f"the element {label} claims {count} nodes, which are not there")
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
        if corners:
            found.append(_indices(lines, corners, index, f"the element {label}"))
    return found


def _corners(kind: int, nodes: list[int]) -> list[int]:
    """The corners of a surface element; those of second order have nodes between them."""
    for kinds, count, step in (
        (TRIANGLES, 3, 1),
        (TRIANGLES_2, 3, 2),
        (QUADRILATERALS, 4, 1),
        (QUADRILATERALS_2, 4, 2),
    ):
        if kind in kinds and len(nodes) >= count * step:
            return nodes[: count * step : step]
    return []


def _lines(lines: Lines, index: dict[int, int]) -> list[tuple[int, ...]]:
    """The lines of a data set 82; a node 0 lifts the pen."""
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


def _indices(lines: Lines, nodes: list[int], index: dict[int, int], whose: str) -> tuple[int, ...]:
    """Indices of nodes by their labels."""
    lost = [n for n in nodes if n not in index]
    if lost:
        raise lines.wrong(f"{whose} names the node {lost[0]}, which is not given")
    return tuple(index[n] for n in nodes)
