"""Two runs' shapes beside each other, and how alike they are at each pair of frequencies.

Shapes a and b of the same nodes are compared by the modal assurance criterion
``MAC = |a^H b|^2 / ((a^H a) (b^H b))``: 1 if one is a complex multiple of the other, 0 if they have
nothing in common. Of two surfaces those nodes count that lie at the same place and are determined
in both runs; whether a value is above its bound does not count.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.dataset import RunData, load
from sldvexp.geometry import joined_points
from sldvexp.lazy import scipy
from sldvexp.report.html.blocks import Beside, HtmlTable, Section, Shape, Text, having
from sldvexp.report.html.figures import figures
from sldvexp.report.html.results import lines_shape, mode_shapes
from sldvexp.report.html.shape import surface_values
from sldvexp.report.numbers import number

#: Of the surface's diagonal, by which two nodes may be apart and still be the same.
MOST_APART = 1e-3
#: A table of more rows or columns than this tells each frequency's best partner only.
MOST_COLUMNS = 8
#: With which the names of both shapes' controls begin.
PREFIXES = ("shape", "other")


@dataclass(frozen=True)
class Surface:
    """A run's velocities as they are drawn.

    Parameters
    ----------
    position : (node, axis) array, m
    velocity : (frequency, node, axis) array, m/s
        Along the world's axes.
    """

    position: NDArray
    velocity: NDArray


def pair_section(paths: Sequence[Path], names: Sequence[str]) -> Section | None:
    """Show the shapes of two runs beside each other, or none if one has no shape.

    Parameters
    ----------
    paths : sequence of Path
        Two files of runs.
    names : sequence of str
        What they are called.
    """
    columns, surfaces, data = [], [], []
    with ExitStack() as opened:
        trees = [opened.enter_context(load(path)) for path in paths]
        runs = [
            replace(RunData.from_source(tree), path=path)
            for tree, path in zip(trees, paths, strict=True)
        ]
        shown = [mode_shapes(run, name) for run, name in zip(runs, PREFIXES, strict=True)]
        modal = all(shown)
        for run, prefix, modes in zip(runs, PREFIXES, shown, strict=True):
            blocks = modes if modal else having(lines_shape(run, prefix), figures(run, "shape"))
            shapes = [block for block in blocks if isinstance(block, Shape)]
            if not shapes:
                return None
            data.append(shapes[0].data)
            surfaces.append(_surface(run, data[-1], modal))
            columns.append(blocks)
    told = _compared(surfaces, data, names)
    return Section("Shapes", having(Beside(list(names), columns), told))


def mac(first: NDArray, second: NDArray) -> NDArray:
    """Compute how alike shapes are, each of the first with each of the second.

    Parameters
    ----------
    first, second : (n, ...) and (m, ...) arrays
        Complex; values that are NaN in any of them do not count.

    Returns
    -------
    (n, m) array

    Examples
    --------
    >>> mac(np.array([[1, 2j]]), np.array([[2j, -4], [2j, 1.0]])).round(3).tolist()
    [[1.0, 0.0]]
    """
    a, b = (values.reshape(len(values), -1) for values in (first, second))
    known = np.isfinite(a).all(axis=0) & np.isfinite(b).all(axis=0)
    a, b = a[:, known], b[:, known]
    sizes = np.outer(*((np.abs(values) ** 2).sum(axis=1) for values in (a, b)))
    with np.errstate(invalid="ignore"):
        found: NDArray = np.abs(a.conj() @ b.T) ** 2 / sizes
    return found


def same_nodes(first: NDArray, second: NDArray) -> tuple[NDArray, NDArray]:
    """Find pairs of nodes at the same place, as indices into both."""
    size = float(np.linalg.norm(np.ptp(first, axis=0)))
    away, other = scipy.spatial.cKDTree(second).query(first)
    own = np.flatnonzero(away <= MOST_APART * size)
    return own, other[own]


def _surface(run: RunData, data: dict[str, Any], modal: bool) -> Surface:
    """Take what is drawn of a run, at the frequencies that its page has."""
    fields = {"modes": run.groups["modes/field"]} if modal else run.fields()
    if fields and "volume" in run.groups:
        position, velocity, directions = surface_values(
            next(iter(fields.values())), run.groups["volume"], data["frequencies"]
        )
    else:
        position, *_ = joined_points(run.groups["line_of_sight"])
        group = run.groups["point"]
        velocity = group["velocity"].transpose(..., "component", "point").values
        velocity = velocity.reshape(-1, *velocity.shape[-2:])
        if "frequency" in group.coords:
            velocity = velocity[np.isin(group["frequency"].values, data["frequencies"])]
        directions = np.eye(3)[: velocity.shape[1], None]
    return Surface(position, np.einsum("fcn,cna->fna", velocity, directions + 0 * position[None]))


def _compared(
    surfaces: Sequence[Surface], data: Sequence[dict[str, Any]], names: Sequence[str]
) -> list[HtmlTable | Text]:
    """Make the table of likeness, and tell each shape its partners."""
    first, second = surfaces
    own, other = same_nodes(first.position, second.position)
    if not own.size:
        return [Text("The runs have no nodes at the same places, so that no MAC is given.")]
    alike = mac(first.velocity[:, own], second.velocity[:, other])
    if not np.isfinite(alike).any():
        return [Text("No node is determined in both runs, so that no MAC is given.")]
    likely = np.nan_to_num(alike, nan=-1.0)
    data[0]["partners"], data[1]["partners"] = (
        likely.argmax(axis=1).tolist(),
        likely.argmax(axis=0).tolist(),
    )
    hertz = [["" if f is None else f"{f:.6g} Hz" for f in one["frequencies"]] for one in data]
    if max(alike.shape) <= MOST_COLUMNS:
        columns = [f"{names[0]} \\ {names[1]}", *hertz[1]]
        rows = [
            [name, *(number(value, 3) for value in row)]
            for name, row in zip(hertz[0], alike, strict=True)
        ]
    else:
        columns = [names[0], f"most alike in {names[1]}", "MAC"]
        rows = [
            [name, hertz[1][best], number(row[best], 3)]
            for name, row, best in zip(hertz[0], alike, data[0]["partners"], strict=True)
        ]
    told = (
        f"MAC of {own.size} nodes at the same places, all components: 1 where one shape is a "
        "multiple of the other, 0 where they have nothing in common. The shape at the right "
        "follows the one at the left, at the frequency at which it is most alike."
    )
    return [HtmlTable(columns, rows, "Likeness of shapes (MAC)"), Text(told, "small")]
