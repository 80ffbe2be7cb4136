"""Panels of maps over a surface of triangles: sizes, bounds, and phases where they mean something.

Linear inside of a triangle. What a map does not tell is hatched.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.tri import Triangulation

from sldvexp.plot import style
from sldvexp.typing import Array, BoolArray, ComplexArray

#: Title of a map of phases.
PHASES = "phase (hatched: below its bound)"


def map_of(
    axes: Axes,
    mesh: Triangulation,
    values: Array,
    unit: str,
    low: float | None = None,
    known: BoolArray | None = None,
) -> None:
    """Draw values at nodes, and their scale in the prefixed unit that suits them.

    Parameters
    ----------
    values : ndarray, shape (node,)
        NaN where there is none.
    unit : str
        Without prefix.
    low : float, optional
        Lower end of the scale; without it the smallest value.
    known : ndarray of bool, shape (node,), optional
        Which values mean something.
    """
    style.hatched(axes)
    factor, shown_unit = style.prefixed(values, unit)
    there = np.isfinite(values) & (True if known is None else known)
    if not there.any():
        axes.triplot(mesh, color="none")
        style.not_determined(axes)
        return
    shown = Triangulation(mesh.x, mesh.y, mesh.triangles)
    shown.set_mask(~there[mesh.triangles].all(axis=1))
    mapped = axes.tripcolor(
        shown,
        factor * np.where(there, values, values[there].mean()),
        shading="gouraud",
        cmap=style.SIZE_MAP,
        vmin=low,
        rasterized=True,
    )
    style.scale_beside(axes, mapped, shown_unit)


def phase_map(axes: Axes, mesh: Triangulation, values: ComplexArray, bound: Array) -> Any:
    """Draw phases of triangles, where values are larger than their bound.

    Parameters
    ----------
    values, bound : ndarray, shape (node,)

    Returns
    -------
    ScalarMappable
        For the scale.
    """
    style.hatched(axes)
    mean = values[mesh.triangles].mean(axis=1)
    known = np.abs(mean) > np.nan_to_num(bound)[mesh.triangles].mean(axis=1)  # a NaN is not above
    axes.triplot(mesh, linestyle="none")  # as wide as the others, whatever is known
    if not known.any():
        known[0], mean[0] = True, np.nan
    return axes.tripcolor(
        Triangulation(mesh.x, mesh.y, mesh.triangles[known]),
        facecolors=np.ma.masked_invalid(np.angle(mean[known])),
        cmap=style.PHASE_MAP,
        vmin=-np.pi,
        vmax=np.pi,
        rasterized=True,
    )
