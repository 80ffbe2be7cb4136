"""Reading line-of-sight velocities by the file's ending."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from sldvexp.errors import UserError
from sldvexp.files import require_file
from sldvexp.io.velocities import arrays, csv
from sldvexp.io.velocities.table import OWN, FileLayout, LineOfSight
from sldvexp.units import VelocityUnit

READERS: dict[str, Callable[[Path, VelocityUnit, FileLayout], LineOfSight]] = {
    ".csv": csv.read,
    ".nc": arrays.read_netcdf,
    ".mat": arrays.read_matlab,
}


def read(path: Path, unit: VelocityUnit, layout: FileLayout = OWN) -> LineOfSight:
    """Read a file of velocities.

    Parameters
    ----------
    path : Path
    unit : VelocityUnit
        Of the file's velocities.
    layout : FileLayout
        How the file differs from the program's own.

    Raises
    ------
    UserError
        If the file is missing, of an unknown kind, or not what its reader needs.
    """
    require_file(path)
    if path.suffix.lower() not in READERS:
        raise UserError(f"{path}: the ending must be one of {', '.join(READERS)}")
    return READERS[path.suffix.lower()](path, unit, layout)
