"""Data sets 55 and 2414: values at nodes at one frequency, as functions of node and direction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.io.uff.fortran import TextLines, between_blanks
from sldvexp.io.uff.functions import NODAL, Axis, Function
from sldvexp.io.uff.source import DataSet, Source, decoded
from sldvexp.typing import Array, IntArray

#: Names of analyses by their number; only a frequency response has values of one frequency.
ANALYSES = {
    1: "static",
    2: "of a normal mode",
    3: "of a complex mode",
    4: "of an instant of time",
    6: "of buckling",
    7: "of a complex mode",
}
NORMAL_MODE, RESPONSE = 2, 5
#: Directions of a node's values by their number: a scalar, translations, translations and turns.
DIRECTIONS_OF = {1: (0,), 3: (1, 2, 3), 6: (1, 2, 3, 4, 5, 6)}
#: Types of values: whether they are complex.
COMPLEX = {2: False, 4: False, 5: True, 6: True}
WIDTH = 13
#: Data set with more about the analysis, and the place of values that is read, nodes.
ANALYSIS, AT_NODES = 2414, 1


class Nodal(NamedTuple):
    """One data set 55 or 2414.

    Parameters
    ----------
    entry : DataSet
        Where it stands.
    text : tuple of str
        The five lines that identify it.
    quantity : int
        The file's number of it, as 11 for velocity; 0 if unknown.
    frequency : float, Hz
    node : ndarray of int, shape (node,)
        Ascending.
    values : ndarray, shape (node, direction)
        Real or complex, in the file's units.
    """

    entry: DataSet
    text: tuple[str, ...]
    quantity: int
    frequency: float
    node: IntArray
    values: NDArray


def read_nodal(source: Source, entry: DataSet, containing: str = "") -> Nodal | None:
    """Read one data set; None if its identifying lines lack a text.

    Raises
    ------
    UserError
        If it is broken, is of a mode, or its values are of more than displacements in space.
    """
    head = _head(source, entry, containing)
    if head is None:
        return None
    lines, text, (_, analysis, _, quantity, type_, count) = head
    if analysis != RESPONSE:
        raise lines.wrong(
            f"these values are {ANALYSES.get(analysis, f'of the analysis type {analysis}')}, not "
            f"amplitudes at a frequency; needed are frequency responses (type {RESPONSE}), or "
            "functions (data set 58)"
        )
    if type_ not in COMPLEX or count not in DIRECTIONS_OF:
        raise lines.wrong(
            "must be real or complex values (type 2 or 5) of 1, 3 or 6 directions, not of type "
            f"{type_} and {count} directions"
        )
    frequency = (_frequency_2414 if entry.kind == ANALYSIS else _frequency_55)(lines)
    if frequency < 0:
        raise lines.wrong(f"the frequency must be zero or positive, not {frequency:g}")
    return _nodal(lines, text, quantity, frequency, COMPLEX[type_], count)


def read_normal_mode(source: Source, entry: DataSet, containing: str = "") -> Nodal | None:
    """Read one data set of a normal mode; None if it is of something else, or lacks a text.

    Raises
    ------
    UserError
        If it is broken, or its values are not three or six real ones a node.
    """
    head = _head(source, entry, containing)
    if head is None or head[2][1] != NORMAL_MODE:
        return None
    lines, text, (_, _, _, quantity, type_, count) = head
    if COMPLEX.get(type_) is not False or count not in (3, 6):
        raise lines.wrong(
            "a normal mode must have real values (type 2) of 3 or 6 directions, not of type "
            f"{type_} and {count} directions"
        )
    if entry.kind == ANALYSIS:
        frequency = _frequency_2414(lines)
    else:
        lines.integers("number of integers and of reals, load case and mode", 2)
        frequency = lines.numbers("frequency, modal mass and damping", 1, WIDTH)[0]
    return _nodal(lines, text, quantity, frequency, False, count)


def _head(
    source: Source, entry: DataSet, containing: str
) -> tuple[TextLines, tuple[str, ...], list[int]] | None:
    """Read what a data set is of; None if its identifying lines lack a text."""
    lines = TextLines(source, entry)
    if entry.kind == ANALYSIS:
        lines.integers("the label of the data set", 1)
        lines.next("the name of the data set")
        place = lines.integers("the place of the values", 1)[0]
        if place != AT_NODES:
            raise lines.wrong(f"the values must be at nodes (place {AT_NODES}), not place {place}")
    text = tuple(decoded(lines.next("a line of text")).strip() for _ in range(5))
    if containing not in " ".join(text):
        return None
    return lines, text, lines.integers("the kinds of the values", 6)[:6]


def _nodal(
    lines: TextLines,
    text: tuple[str, ...],
    quantity: int,
    frequency: float,
    pairs: bool,
    count: int,
) -> Nodal:
    """Read the values at the nodes, with real and imaginary parts in pairs if they are complex."""
    node, flat = _rows(lines, count * (1 + pairs))
    order = np.argsort(node, kind="stable")
    node, flat = node[order], np.ascontiguousarray(flat[order])
    if len(twice := node[1:][node[1:] == node[:-1]]):
        raise lines.wrong(f"the node {twice[0]} has values twice")
    values = flat.view(np.complex128) if pairs else flat
    return Nodal(lines.entry, text, quantity, frequency, node, values)


def _frequency_55(lines: TextLines) -> float:
    """Read the only real number of a frequency response."""
    integers = lines.integers("number of integers and of reals", 2)
    if integers[1] != 1 or not 0 <= integers[0] <= 6:
        message = f"a frequency response has one real number, its frequency, not {integers[1]}"
        raise lines.wrong(message)
    return lines.numbers("the frequency", 1, WIDTH)[0]


def _frequency_2414(lines: TextLines) -> float:
    """Read the lines about the analysis; the second of its first numbers is the frequency."""
    lines.integers("numbers of design, iteration, solution and frequency", 8)
    lines.integers("how the values were made", 1)
    frequency = lines.numbers("time and frequency", 2, WIDTH)[1]
    lines.numbers("eigenvalue and modal quantities", 1, WIDTH)
    return frequency


def _rows(lines: TextLines, count: int) -> tuple[IntArray, Array]:
    """Read numbers of nodes and their values, to the end of the data set."""
    start = lines.at
    flat = between_blanks(b"\n".join(lines.text[start:]))
    if flat is not None and len(flat) and len(flat) % (1 + count) == 0:
        table = flat.reshape(-1, 1 + count)
        node = table[:, 0]
        if np.isfinite(table).all() and (node == np.round(node)).all() and abs(node).max() < 1e10:
            return node.astype(np.int64), table[:, 1:]
    nodes, rows = [], []  # one line after the other tells what is wrong, and where
    while lines:
        nodes.append(lines.integers("the number of a node", 1)[0])
        row: list[float] = []
        while len(row) < count:
            row += lines.numbers("the values of a node", min(6, count - len(row)), WIDTH)
        rows.append(row)
    if not nodes:
        raise lines.wrong("has no values")
    return np.array(nodes, np.int64), np.array(rows)


class ShapeFunctions:
    """Data sets 55 of a file as functions of frequency.

    Parameters
    ----------
    sets : list of Nodal
        At least one; all with the same nodes and directions.

    Raises
    ------
    UserError
        If they differ in nodes, directions or quantity, or two are of one frequency.
    """

    def __init__(self, source: Source, sets: list[Nodal]):
        sets = sorted(sets, key=lambda one: one.frequency)
        first = sets[0]
        for before, one in zip([first, *sets[:-1]], sets, strict=True):
            self._check(source, before, one)
        self.frequency = np.array([one.frequency for one in sets])
        self.node, self.entry = first.node, first.entry
        #: shape (node, direction, frequency)
        self.values = np.stack([one.values for one in sets], axis=2)
        self.directions = DIRECTIONS_OF[first.values.shape[1]]
        self.functions = [
            Function(
                first.entry,
                first.text,
                NODAL,
                node=int(node),
                direction=direction,
                reference_node=0,
                reference_direction=0,
                complex=bool(np.iscomplexobj(self.values)),
                double=False,
                even=False,
                size=len(sets),
                first=0.0,
                step=0.0,
                abscissa=Axis(18, "", "Hz"),
                ordinate=Axis(first.quantity, "", ""),
                reference=Axis(0, "", ""),
            )
            for node in first.node
            for direction in self.directions
        ]

    def values_of(self, function: Function) -> tuple[NDArray, NDArray]:
        """Give frequencies and values of one of the functions."""
        place = np.searchsorted(self.node, function.node)
        return self.frequency, self.values[place, self.directions.index(function.direction)]

    @staticmethod
    def _check(source: Source, before: Nodal, one: Nodal) -> None:
        def wrong(what: str) -> UserError:
            return one.entry.wrong(source, one.entry.first, what)

        other = f"data set {before.entry.number}"
        if one is not before and one.frequency == before.frequency:
            raise wrong(
                f"and {other} are both of {one.frequency:g} Hz; choose one with "
                "instrument.containing, a text of the lines that identify it"
            )
        same = np.array_equal(one.node, before.node) and one.values.shape == before.values.shape
        if not same or one.quantity != before.quantity:
            raise wrong(f"has other nodes, directions or another quantity than {other}")
