"""Surfaces in universal files: the triangles and quadrilaterals of data set 2412."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sldvexp.errors import UserError
from sldvexp.io.uff.reader import universal_file
from sldvexp.typing import Array, IntArray

SUFFIXES = (".uff", ".unv", ".uf", ".bunv")
#: How far the file's unit of length may be from the one of the configuration.
SAME_UNIT = 1e-3


def read_universal(path: Path, unit: float) -> tuple[Array, IntArray, IntArray, IntArray]:
    """Nodes and surface elements of a universal file.

    Parameters
    ----------
    path : Path
    unit : float
        One unit of the file's coordinates in m.

    Returns
    -------
    position : ndarray, shape (node, 3), m
    triangles, quadrilaterals : ndarray of int, shape (element, 3) and (element, 4)
    label : ndarray of int, shape (node,)

    Raises
    ------
    UserError
        If the file is broken, has no nodes, or states another unit.
    """
    with universal_file(path) as file:
        geometry, units = file.geometry, file.units
    if geometry is None:
        raise UserError(f"{path}: has no geometry (data set 15 or 2411)")
    if units is not None and abs(units.length / unit - 1) > SAME_UNIT:
        raise UserError(
            f"{path}: states coordinates in units of {units.length:g} m, the configuration "
            f"volume.unit in units of {unit:g} m; they must agree"
        )
    position = np.asarray(geometry.position * unit)
    return position, geometry.triangles, geometry.quadrilaterals, geometry.label
