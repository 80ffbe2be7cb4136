"""Reading line-of-sight velocities by the file's ending."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from sldvexp.errors import UserError
from sldvexp.files import require_file
from sldvexp.line_of_sight import arrays, csv
from sldvexp.line_of_sight.table import LineOfSight
from sldvexp.units import VelocityUnit

READERS: dict[str, Callable[[Path, VelocityUnit], LineOfSight]] = {
    ".csv": csv.read,
    ".nc": arrays.read_netcdf,
    ".mat": arrays.read_matlab,
}


def read(path: Path, unit: VelocityUnit) -> LineOfSight:
    """Read a file of velocities.

    Raises
    ------
    UserError
        If the file is missing, of an unknown kind, or not what its reader needs.
    """
    require_file(path)
    if path.suffix.lower() not in READERS:
        raise UserError(f"{path}: the ending must be one of {', '.join(READERS)}")
    return READERS[path.suffix.lower()](path, unit)
