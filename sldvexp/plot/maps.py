"""Panels of maps over a surface of triangles: sizes, bounds, and phases where they mean something.

Linear inside of a triangle. What a map does not tell is hatched.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.tri import Triangulation

from sldvexp.plot import style
from sldvexp.plot.triangle_map import TriangleMap
from sldvexp.typing import Array, BoolArray, ComplexArray

#: Title of a map of phases.
PHASES = "phase"
#: Part of a title that says how values below their bounds look.
FAINT = "pale or hatched: below the bound"


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
    corner = mesh.triangles
    faint = np.zeros(len(values), bool)
    if bound is not None:
        faint = there & ~(np.abs(values) > np.nan_to_num(bound))
    array = factor * np.where(there, values, values[there].mean())
    mapped = TriangleMap(
        mesh,
        array[corner],
        shown=there[corner].all(axis=1),
        veiled=faint[corner].sum(axis=1) > 1,
        array=array,
        cmap=style.colour_map(style.SIZE_MAP),
        norm=Normalize(low, high),
    )
    axes.add_collection(mapped, autolim=False)
    return mapped


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
    phases = np.degrees(np.angle(mean))
    faces = TriangleMap(
        mesh,
        np.repeat(phases[:, None], 3, axis=1),
        shown=known,
        veiled=np.zeros(len(known), bool),
        array=phases[known],
        cmap=style.colour_map(style.PHASE_MAP),
        norm=Normalize(-180.0, 180.0),
    )
    axes.add_collection(faces, autolim=False)
    return faces
