"""`instrument=scan_export`: tables of points as scanning vibrometers export them as text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.importers.conventions import (
    Conventions,
    Directions,
    Quantity,
    Zeros,
    motion_of,
    unstated,
)
from sldvexp.importers.pointwise import PointwiseImport
from sldvexp.importers.pointwise_data import PointwiseData, PointwiseView, same_frequencies
from sldvexp.importers.scan_table import (
    ANGLES,
    ScanTable,
    by_rows,
    fields,
    frequencies_in,
    read_table,
)
from sldvexp.io.uff import UniversalGeometry
from sldvexp.io.uff.geometry import WORLD
from sldvexp.typing import Array, BoolArray, IndexArray, IntArray

#: Roles that a column may have.
ROLES = ("index", "x", "y", "z", "frequency", "status", "real", "imag", "magnitude", "phase")


@register("instrument", "scan_export")
@dataclass
class ScanExport(PointwiseImport):
    """Text tables with a line a point: number, coordinates, velocity, perhaps a status.

    Columns are recognised by their units and places, not by their names, which are of any
    language. Of several frequencies each has a row, or columns with the frequency above. What a
    file does not say, and a setting does not either, is asked for.

    Parameters
    ----------
    good_status : list of int
        Values of the status column of points that are to be trusted.
    columns : dict of str to int
        Which column, counted from 1, is what, instead of recognising them: index, x, y, z,
        frequency, status, real, imag, magnitude, phase. Where frequencies stand above columns,
        those of values are of one of them, as real and imaginary part of H1 beside H2, or left out.
    """

    directions: Directions = Directions.view
    good_status: list[int] = field(default_factory=list)
    columns: dict[str, int] = field(default_factory=dict)

    def check(self, checks: Checks) -> None:
        """Note what cannot be."""
        message = "must be view or pose: these tables have no directions"
        checks.require(self.directions is not Directions.dof, "directions", message)
        for role, column in self.columns.items():
            message = f"must be one of {', '.join(ROLES)}"
            checks.require(role in ROLES, f"columns.{role}", message)
            message = f"must be a column's number from 1, not {column}"
            checks.require(column >= 1, f"columns.{role}", message)
        for name, view in self.views.items():
            checks.require(not view.dof, f"views.{name}.dof", "is for universal files only")

    def measured(self) -> Iterator[PointwiseData]:
        """Read the views' tables, one after the other."""
        first: PointwiseData | None = None
        for name, view in self.views.items():
            found = _view(self, name, view)
            same_frequencies(found, first)
            first = first or found
            yield found


def _view(settings: ScanExport, name: str, view: PointwiseView) -> PointwiseData:
    """Read one view's table and turn its values into velocities."""
    table, columns = by_rows(read_table(locate(view.path)), settings.columns)
    roles = table.roles(columns)
    for needed in ("x", "y", "z"):
        if needed not in roles:
            raise table.wrong(f"instrument.columns does not name {needed}")
    node, frequency, row = _grid(settings, table, roles)
    rules = _conventions(settings, table, roles)
    values = _values(table, roles)[row]
    if (frequency == 0).any() and rules.quantity is Quantity.acceleration:
        raise table.wrong("an acceleration at 0 Hz says nothing of velocity; leave 0 Hz out")
    chosen = _chosen(settings, table, frequency)
    missing = _missing(settings, table, roles, row, values)
    length, by = _length(settings, table, roles)
    position = table.values[row[:, 0]][:, [roles[axis] for axis in "xyz"]]
    none = np.empty((0, 3), np.int64)
    return PointwiseData(
        name,
        str(table.path),
        node,
        np.zeros(len(node), np.int64),
        frequency[chosen],
        (velocity := rules.velocity(values, frequency)[:, chosen]),
        None if settings.std is None else np.full(velocity.shape, settings.std),
        missing,
        UniversalGeometry(
            node, position, (WORLD,) * len(node), none, np.empty((0, 4), np.int64), ()
        ),
        length,
        rules.told | {"length_unit": f"{length:g} m, {by}"},
    )


def _grid(
    settings: ScanExport, table: ScanTable, roles: dict[str, int]
) -> tuple[IntArray, Array, IndexArray]:
    """Find points, frequencies, and the row of each of their pairs, shape (point, frequency)."""
    rows = len(table.values)
    if "frequency" not in roles:
        frequency = np.array([_one_frequency(settings, table)])
        of_row = np.zeros(rows, np.intp)
    else:
        unit = table.units[roles["frequency"]].lower()
        stated = table.values[:, roles["frequency"]] * (1000.0 if unit == "khz" else 1.0)
        frequency, of_row = np.unique(stated, return_inverse=True)
    if "index" in roles:
        label = _whole(table, roles["index"])
    elif len(frequency) == 1:
        label = np.arange(1, rows + 1)
    else:
        raise table.wrong("several frequencies need a column of point numbers before x")
    node, of_node = np.unique(label, return_inverse=True)
    row = np.full((len(node), len(frequency)), -1, np.intp)
    for i, place in enumerate(zip(of_node, of_row, strict=True)):
        if row[place] >= 0:
            raise table.wrong(f"point {label[i]} at {frequency[place[1]]:g} Hz is given twice", i)
        row[place] = i
    if (row < 0).any():
        p, f = np.argwhere(row < 0)[0]
        raise table.wrong(f"there is no row for point {node[p]} at {frequency[f]:g} Hz")
    return node, frequency, row


def _whole(table: ScanTable, column: int) -> IntArray:
    """Read a column of integers."""
    values = table.values[:, column]
    wrong = np.flatnonzero((values != np.round(values)) | (np.abs(values) > 1e15))
    if len(wrong):
        row = int(wrong[0])
        raise table.wrong(
            f"column {table.place[column]} must be an integer, not {values[row]:g}", row
        )
    return values.astype(np.int64)


def _one_frequency(settings: ScanExport, table: ScanTable) -> float:
    """Find the frequency of a table without a column of it."""
    lines = table.before.splitlines()
    # Cells too: the comma before `100 Hz` is a delimiter here and a decimal mark there.
    cells = [cell for line in lines for cell in fields(line, table.delimiter)]
    stated = frequencies_in("\n".join([*lines, *cells]))
    if len(settings.frequency) == 1 and len(stated) != 1:
        return settings.frequency[0]
    if len(stated) != 1:
        several = f"states {', '.join(f'{f:g}' for f in stated)} Hz" if stated else "states none"
        raise UserError(
            f"{table.path}: does not state one frequency of its values ({several}); say it with "
            "instrument.frequency, for example instrument.frequency=[197]"
        )
    return stated[0]


def _chosen(settings: ScanExport, table: ScanTable, frequency: Array) -> IndexArray:
    """Find the places of the wanted frequencies."""
    if not settings.frequency:
        return np.arange(len(frequency))
    wanted = np.array(settings.frequency)
    near = np.abs(frequency[:, None] - wanted).argmin(axis=0)
    off = np.flatnonzero(np.abs(frequency[near] - wanted) > 1e-6 * np.abs(wanted))
    if len(off):
        raise table.wrong(
            f"is not at {wanted[off[0]]:g} Hz; the nearest is {frequency[near[off[0]]]:g}"
        )
    return near


def _values(table: ScanTable, roles: dict[str, int]) -> NDArray:
    """Read the rows' values, real or complex, in the file's unit."""
    column = {role: table.values[:, i] for role, i in roles.items()}
    if "magnitude" in column and "phase" in column:
        unit = table.units[roles["phase"]].lower()
        if unit not in ANGLES:
            raise table.wrong("the phase must be in deg or rad, as its column's name must state")
        return np.asarray(column["magnitude"] * np.exp(1j * ANGLES[unit] * column["phase"]))
    if "real" not in column:
        raise table.wrong("instrument.columns must name real (and imag), or magnitude and phase")
    return column["real"] + 1j * column["imag"] if "imag" in column else column["real"]


def _missing(
    settings: ScanExport,
    table: ScanTable,
    roles: dict[str, int],
    row: IndexArray,
    values: NDArray,
) -> BoolArray:
    """Mark points that are not to be trusted by their status, or are zero throughout."""
    zero = np.asarray(~values.any(axis=1))
    if settings.zeros is Zeros.refuse and zero.any():
        raise table.wrong(
            "all values of this point are zero, as programs write where nothing was measured; say "
            "instrument.zeros=missing, or measured if they are",
            int(row[zero][0, 0]),
        )
    missing = zero if settings.zeros is Zeros.missing else np.zeros(len(row), bool)
    if "status" not in roles:
        return missing
    status = _whole(table, roles["status"])
    if not settings.good_status and len(np.unique(status)) > 1:
        seen = ", ".join(map(str, np.unique(status)))
        column = table.place[roles["status"]]
        raise UserError(
            f"{table.path}: column {column} may be a status with the values {seen}, of which "
            "nobody says which are good; say it with instrument.good_status, for example "
            f"instrument.good_status=[{status[0]}]"
        )
    bad = ~np.isin(status, settings.good_status or status)
    return np.asarray(missing | bad[row].any(axis=1))


def _length(settings: ScanExport, table: ScanTable, roles: dict[str, int]) -> tuple[float, str]:
    """Find one unit of the coordinates in m, and who says so."""
    if settings.length_unit is not None:
        return settings.length_unit.value, "as set"
    motion = motion_of(unit := table.units[roles["x"]])
    if motion is None:
        raise unstated(table.path, "length_unit", "mm", "the unit of its coordinates")
    return motion.unit.value, f"by the label {unit}"


def _conventions(settings: ScanExport, table: ScanTable, roles: dict[str, int]) -> Conventions:
    """Decide how values become velocities: by the settings, or the unit of their column."""
    label = table.units[roles.get("real", roles.get("magnitude", 0))]
    motion = motion_of(label)
    quantity = settings.quantity or (motion.quantity if motion else None)
    if quantity is None:
        raise unstated(table.path, "quantity", "velocity", "the unit of its values")
    unit = settings.unit or (motion.unit if motion else None)
    if unit is None:
        raise unstated(table.path, "unit", "m", "the unit of its values (m of m/s)")
    told = {
        "quantity": quantity.name,
        "unit": f"{unit.value:g} m per unit, {'as set' if settings.unit else f'by {label}'}",
    }
    factor = unit.value
    if motion is not None and motion.rest:
        if settings.reference is None:
            what = f"the reference's peak amplitude, which values in {label} are multiplied with"
            raise unstated(table.path, "reference", "1.0", what)
        factor *= settings.reference
        told["reference"] = f"{settings.reference:g} {motion.rest}"
    else:
        if settings.amplitude is None:
            raise unstated(table.path, "amplitude", "peak", "whether amplitudes are peak or rms")
        factor *= settings.amplitude.value
        told["amplitude"] = settings.amplitude.name
    if settings.positive is None:
        raise unstated(table.path, "positive", "towards", "where a positive velocity points to")
    if settings.phase is None:
        what = "the sign of the phase (exp_plus or exp_minus)"
        raise unstated(table.path, "phase", "exp_plus", what)
    told |= {"positive": settings.positive.name, "phase": settings.phase.name}
    told["directions"] = settings.directions.name
    told["columns"] = ", ".join(f"{role} {table.place[i]}" for role, i in roles.items())
    conjugate = settings.phase.value < 0
    return Conventions(quantity, factor * settings.positive.value, conjugate, told)
