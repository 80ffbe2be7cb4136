"""Digitised points in a table whose header names the coordinates and their unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sldvexp.errors import UserError
from sldvexp.files import require_file
from sldvexp.io.text_fields import csv_lines, number, unit_of_columns
from sldvexp.typing import Array, IntArray
from sldvexp.units import LengthUnit

AXES = ("x", "y", "z")


def read_points(path: Path) -> tuple[Array, IntArray]:
    """Coordinates of every point and the line on which it stands.

    Parameters
    ----------
    path : Path
        Header with ``x_U,y_U,z_U``, U one unit of length; lines that start with # are comments.

    Returns
    -------
    position : ndarray, shape (point, 3), m
    line : ndarray of int, shape (point,)

    Raises
    ------
    UserError
        If the file is missing, mixes units, lacks a column, or has a line that is not numbers.
    """
    require_file(path)
    lines = csv_lines(path)
    _, header = next(lines, (0, []))
    unit = unit_of_columns(AXES, tuple(LengthUnit.__members__), header, str(path)) or "m"
    columns = [f"{axis}_{unit}" for axis in AXES]
    if missing := [column for column in columns if column not in header]:
        raise UserError(
            f"{path}: the column {missing[0]} is missing; needed are x_U, y_U, z_U with U one of "
            f"{', '.join(LengthUnit.__members__)}"
        )
    rows, numbers = [], []
    for line, cells in lines:
        where = f"{path}, line {line}"
        if len(cells) != len(header):
            raise UserError(f"{where}: has {len(cells)} values under {len(header)} columns")
        rows.append([number(cells[header.index(c)], c, where) for c in columns])
        numbers.append(line)
    position = np.array(rows, float).reshape(-1, 3)
    return position * LengthUnit[unit].value, np.array(numbers, np.int64)
