"""Registration data in files: the suffix chooses the format, a module with `read` and `write`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from sldvexp.errors import UserError
from sldvexp.files import require_file
from sldvexp.io.registration import csv, netcdf, reg
from sldvexp.io.registration.table import RegistrationTable
from sldvexp.units import LengthUnit
from sldvexp.writing import whole_or_nothing

#: Suffix of a file to the module that reads and writes it.
FORMATS = {".reg": reg, ".csv": csv, ".nc": netcdf}


def read(path: str | Path, unit: LengthUnit | None = None) -> list[RegistrationTable]:
    r"""Read registration data of every view in a file, in SI units.

    Parameters
    ----------
    path : str or Path
        ``.reg`` (Figure 4.28), ``.csv`` or ``.nc`` (a run, or a dataset with the same names).
    unit : LengthUnit, optional
        Of the object points, for a file that does not state it itself.

    Returns
    -------
    list of RegistrationTable
        One a view, in the file's order.

    Raises
    ------
    UserError
        If the file is missing, of no known format or wrong anywhere; names the file and the line
        or the view and point.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "front.csv")
    >>> _ = path.write_text("point,x_mm,y_mm,z_mm,up_down_deg,left_right_deg\n7,500,0,0,1,-2\n")
    >>> read(path)
    [<RegistrationTable of view front: 1 point with angles>]
    """
    path = Path(path)
    module = _format(path)
    require_file(path)
    return list(module.read(path, unit))


def write(path: str | Path, tables: Sequence[RegistrationTable]) -> None:
    """Write one or several views; afterwards the file is complete, or is what it was before.

    Parameters
    ----------
    path : str or Path
        Its suffix chooses the format, as in `read`; ``.reg`` holds one view only.
    tables : sequence of RegistrationTable
        Text formats state lengths in each table's `unit` and angles in degrees, in decimals that
        read back the same (see `sldvexp.units.decimal_in`).

    Raises
    ------
    UserError
        If the format cannot hold these tables, or the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> table = RegistrationTable("front", np.array([7]), np.eye(3)[:1], dac=np.array([[30, -60]]))
    >>> path = Path(tempfile.mkdtemp(), "front.csv")
    >>> write(path, [table])
    >>> path.read_text().splitlines()[2]
    'front,7,1,0,0,30,-60'
    """
    path = Path(path)
    module = _format(path)
    if not tables:
        raise UserError(f"{path}: there are no views to write")
    with whole_or_nothing(path) as beside:
        module.write(beside, tables)


def _format(path: Path) -> ModuleType:
    """Find the module of a file's format."""
    if path.suffix.lower() not in FORMATS:
        raise UserError(
            f"{path}: registration data cannot be a {path.suffix or 'file without a suffix'}; "
            f"valid: {', '.join(FORMATS)}"
        )
    return FORMATS[path.suffix.lower()]
