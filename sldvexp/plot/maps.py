"""Panels of maps over a surface of triangles: sizes, bounds, and phases where they mean something.

Linear inside of a triangle. What a map does not tell is hatched.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import TriMesh
from matplotlib.colors import Normalize
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.tri import Triangulation

from sldvexp.plot import style
from sldvexp.typing import Array, BoolArray, ComplexArray

#: Title of a map of phases.
PHASES = "phase"
#: Part of a title that says how values below their bounds look.
FAINT = "pale or hatched: below the bound"
#: Share of white over values below their bounds.
VEIL = 0.72


def map_of(
    axes: Axes,
    mesh: Triangulation,
    values: Array,
    scale: tuple[float, float, float],
    known: BoolArray | None = None,
    bound: Array | None = None,
) -> Any:
    """Draw values at nodes.

    Parameters
    ----------
    values : ndarray, shape (node,)
        NaN where there is none.
    scale : tuple of float
        Factor of the shown unit, and the least and largest value of the colours in that unit.
    known : ndarray of bool, shape (node,), optional
        Which values mean something.
    bound : ndarray, shape (node,), optional
        Of the values; where they are below it, they are pale.

    Returns
    -------
    ScalarMappable or None
        For the scale; None if there is nothing to draw.
    """
    style.hatched(axes)
    factor, low, high = scale
    there = np.isfinite(values) & (True if known is None else known)
    style.ends_of(axes, mesh.x, mesh.y)
    if not there.any():
        style.not_determined(axes)
        return None
    mapped = TriMesh(
        Triangulation(mesh.x, mesh.y, mesh.triangles, ~there[mesh.triangles].all(axis=1)),
        array=factor * np.where(there, values, values[there].mean()),
        cmap=style.SIZE_MAP,
        norm=Normalize(low, high),
        rasterized=True,
    )
    axes.add_collection(mapped, autolim=False)
    if bound is not None:
        faint = there & ~(np.abs(values) > np.nan_to_num(bound))
        veil(axes, mesh, faint[mesh.triangles].sum(axis=1) > 1)
    return mapped


def veil(axes: Axes, mesh: Triangulation, faint: BoolArray) -> None:
    """Lay white over triangles whose values are not above their bounds."""
    if faint.any():
        corners = _corners(mesh, faint)[:, [0, 1, 2, 0]]
        codes = np.tile(TRIANGLE, len(corners))
        look: dict[str, Any] = {"facecolor": "#ffffff", "alpha": VEIL, "linewidth": 0.0}
        # as one path, which is drawn at once
        over = PathPatch(Path(corners.reshape(-1, 2), codes), rasterized=True, **look)
        over.set_antialiased(False)
        over.set_transform(axes.transData)
        axes.add_artist(over)


#: How a path goes around a triangle.
TRIANGLE = (Path.MOVETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY)


def _corners(mesh: Triangulation, chosen: BoolArray) -> Array:
    """Find the places of some triangles' corners, shape (triangle, 3, 2)."""
    return np.stack([mesh.x, mesh.y], axis=1)[mesh.triangles[chosen]]


def scale_of(
    values: Sequence[Array], unit: str, factor: float | None = None
) -> tuple[tuple[float, float, float], str]:
    """Choose the unit and the ends of one scale from zero for several maps.

    Parameters
    ----------
    values : sequence of ndarray
    unit : str
        Without prefix.
    factor : float, optional
        Of the unit of another scale of the figure, which is then this one's too.

    Returns
    -------
    scale : tuple of float
        As `map_of` takes it.
    unit : str
        With a prefix.
    """
    sizes = np.abs(np.concatenate([np.ravel(v) for v in values]))
    largest = float(sizes[np.isfinite(sizes)].max(initial=0.0))
    own, shown = style.prefixed(largest if factor is None else 1.0 / factor, unit)
    return (own, 0.0, own * largest or 1.0), shown


def phase_map(axes: Axes, mesh: Triangulation, values: ComplexArray, bound: Array) -> Any:
    """Draw phases of triangles, deg, where values are larger than their bound.

    Parameters
    ----------
    values, bound : ndarray, shape (node,)

    Returns
    -------
    ScalarMappable
        For the scale.
    """
    style.hatched(axes)
    style.ends_of(axes, mesh.x, mesh.y)
    mean = values[mesh.triangles].mean(axis=1)
    known = np.abs(mean) > np.nan_to_num(bound)[mesh.triangles].mean(axis=1)  # a NaN is not above
    if not known.any():  # one that is not seen
        known[0], mean[0] = True, np.nan
    # with corners of its own a triangle has one colour
    corner = _corners(mesh, known).reshape(-1, 2)
    x, y = corner.T
    alone = Triangulation(x, y, np.arange(len(corner)).reshape(-1, 3))
    phases = np.ma.masked_invalid(np.repeat(np.degrees(np.angle(mean[known])), 3))
    look: dict[str, Any] = {"cmap": style.PHASE_MAP, "norm": Normalize(-180.0, 180.0)}
    faces = TriMesh(alone, array=phases, rasterized=True, **look)
    axes.add_collection(faces, autolim=False)
    return faces
