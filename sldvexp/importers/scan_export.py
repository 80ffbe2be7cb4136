"""`instrument=scan_export`: tables of points as scanning vibrometers export them as text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.dataset import Finding
from sldvexp.errors import Checks, UserError
from sldvexp.importers.conventions import Conventions, Directions, Quantity, Zeros
from sldvexp.importers.incomplete import REMEDY, Incomplete, incomplete_by, then
from sldvexp.importers.point_names import number_names, told_of_names
from sldvexp.importers.pointwise import PointwiseImport
from sldvexp.importers.pointwise_data import PointwiseData, PointwiseView
from sldvexp.importers.questions import SeenPoints, ViewQuestions
from sldvexp.importers.reference import reference_of, unit_of_reference
from sldvexp.importers.scan_findings import (
    absent_numbers,
    contradicted_lines,
    left_out,
    overruled,
)
from sldvexp.importers.scan_frequency import stated_in
from sldvexp.importers.scan_rows import read_table
from sldvexp.importers.scan_table import (
    ColumnsNotUnderstoodError,
    ScanTable,
    by_rows,
    fields,
    is_frequency,
    is_length,
    label_of_values,
    meaning,
    motion_of,
)
from sldvexp.io.uff import UniversalGeometry
from sldvexp.io.uff.geometry import WORLD
from sldvexp.typing import Array, BoolArray, IndexArray, IntArray
from sldvexp.unit_labels import UnitLabel

#: How questions name what a table does not state.
COORDINATES, VALUES = "the unit of its coordinates", "the unit of its values"
AMPLITUDES = "whether amplitudes are peak or rms"
#: Values of a status that a question lists.
MOST_STATUS = 8
#: Phases beyond this are of no spectrum in rad, but of one in deg.
MOST_RADIANS = 25.0
#: Roles that a column may have.
ROLES = ("index", "x", "y", "z", "frequency", "status", "real", "imag", "magnitude", "phase")


@register("instrument", "scan_export")
@dataclass
class ScanExport(PointwiseImport):
    """Text tables with a line a point: number, coordinates, velocity, perhaps a status.

    Columns are recognised by their units and places, parts of values by words of their names in
    common languages. Of several frequencies each has a row, columns with the frequency above, or a
    block of rows below a line that states it. What a file does not say, and a setting does not
    either, is asked for, as is a column or a line that is not understood.

    Parameters
    ----------
    good_status : list of int or str
        Values of the status column, numbers or words, of points that are to be trusted.
    columns : dict of str to int
        Which column, counted from 1, is what, instead of recognising them: index, x, y, z,
        frequency, status, real, imag, magnitude, phase. Where frequencies stand above columns,
        those of values are of one of them, as real and imaginary part of H1 beside H2, or left out.
    """

    directions: Directions = Directions.view
    good_status: list[Any] = field(default_factory=list)
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

    def measured(self, questions: ViewQuestions) -> Iterator[PointwiseData]:
        """Read the views' tables, one after the other; what they leave open is asked together."""
        opened = {
            name: found
            for name, view in self.views.items()
            if (found := _opened(self.of_view(name), view, questions.of(name))) is not None
        }
        _ask_names(opened, questions)
        names = {name: own for name, found in opened.items() if (own := _names(*found))}
        numbers = number_names(names)
        views = [
            _view(self.of_view(name), name, *found, numbers, questions.of(name))
            for name, found in opened.items()
        ]
        units = {v.name: v.reference for v in views if v is not None and v.reference is not None}
        odd = self.check_references(units, questions)
        questions.done()
        for made in filter(None, views):
            made.findings.extend([*odd, *told_of_names(numbers)] if made is views[0] else [])
            yield made


def _opened(
    settings: ScanExport, view: PointwiseView, questions: ViewQuestions
) -> tuple[ScanTable, dict[str, int]] | None:
    """Read one view's table and find what its columns are; None if that is asked for."""
    read = read_table(locate(view.path))
    try:
        table, columns = by_rows(read, settings.columns)
        roles = table.roles(columns)
    except ColumnsNotUnderstoodError as error:
        questions.note(error, read.path)
        _ask_the_rest(settings, read, questions)
        return None
    if lost := [needed for needed in ("x", "y", "z") if needed not in roles]:
        message = f"instrument.columns does not name {' and '.join(lost)}"
        questions.note(table.wrong(message), table.path)
        _ask_the_rest(settings, table, questions)
        return None
    return table, roles


def _names(table: ScanTable, roles: dict[str, int]) -> list[str]:
    """List the names of the points of a table's rows; empty if these have numbers, or nothing."""
    return table.words.get(roles.get("index", -1), [])


def _ask_names(
    opened: dict[str, tuple[ScanTable, dict[str, int]]], questions: ViewQuestions
) -> None:
    """Refuse names in some views and numbers in others, of which nobody knows which is which."""
    named = {view: found for view, found in opened.items() if _names(*found)}
    for view, (table, _) in opened.items():
        if named and view not in named:
            other = next(iter(named))
            example = _names(*named[other])[0]
            message = (
                f"{table.path}: the points of view {view} have no names, as {example} of view "
                f"{other} has; give all tables a column of names before x, or leave it out of all"
            )
            questions.note(UserError(message), table.path)
    for table, roles in named.values():
        lost = [i for i, name in enumerate(_names(table, roles)) if not name]
        if lost:
            raise table.wrong("the point has no name, as others have", lost[0])


def _view(
    settings: ScanExport,
    name: str,
    table: ScanTable,
    roles: dict[str, int],
    numbers: dict[str, int],
    questions: ViewQuestions,
) -> PointwiseData | None:
    """Turn one view's values into velocities; None if a question is open."""
    node, frequency, row = _grid(settings, table, roles, numbers, questions)
    of_point = {number: own for own, number in numbers.items()} if _names(table, roles) else {}
    rules = _conventions(settings, table, roles, questions)
    values = _values(table, roles)
    missing, said = _missing(settings, table, roles, row, values, questions)
    length, by = _length(settings, table, roles, questions)
    odd = contradicted_lines(settings, table, roles, length if by else None, questions)
    source, known = str(table.path), not settings.frequency and not np.isnan(frequency).any()
    has_std = settings.std is not None
    seen = SeenPoints(name, source, node, missing, frequency if known else None, said, has_std)
    seen = replace(seen, names=of_point)
    if questions:
        questions.saw(seen)
        return None
    chosen = _chosen(settings, table, frequency)
    questions.saw(replace(seen, frequency=frequency[chosen]))
    if (frequency == 0).any() and rules.quantity is Quantity.acceleration:
        raise table.wrong("an acceleration at 0 Hz says nothing of velocity; leave 0 Hz out")
    measured = np.where(missing[:, None], 0.0, values[row])
    velocity = rules.velocity(measured, frequency)[:, chosen]
    none = np.empty((0, 3), np.int64)
    return PointwiseData(
        name,
        source,
        node,
        np.zeros(len(node), np.int64),
        frequency[chosen],
        velocity,
        None if settings.std is None else np.full(velocity.shape, settings.std),
        missing,
        UniversalGeometry(
            node,
            _position(table, roles, row, node),
            (WORLD,) * len(node),
            none,
            np.empty((0, 4), np.int64),
            (),
        ),
        length,
        rules.told | {"length_unit": f"{length:g} m, {by}", "lines": table.told},
        [
            *absent_numbers(name, roles, node),
            *overruled(settings, name, table, roles),
            *(Finding("unit", f"view {name}", text, views=(name,)) for text in odd),
            *left_out(settings.columns, name, table, roles),
        ],
        said,
        rules.reference,
        names=of_point,
    )


def _position(table: ScanTable, roles: dict[str, int], row: IndexArray, node: IntArray) -> Array:
    """Find the points' coordinates, the same at all frequencies, in the file's unit."""
    place = np.column_stack([_known(table, axis, roles[axis]) for axis in "xyz"])
    there = row >= 0
    found = place[row[np.arange(len(row)), there.argmax(axis=1)]]
    moved = np.argwhere(there & (place[row] != found[:, None]).any(axis=2))
    if len(moved):
        p, f = moved[0]
        raise table.wrong(f"point {node[p]} stood elsewhere before", int(row[p, f]))
    return found


def _known(table: ScanTable, role: str, column: int) -> Array:
    """Read a column whose numbers must all be there."""
    values = table.values[:, column]
    if np.isnan(values).any():
        row = int(np.flatnonzero(np.isnan(values))[0])
        raise table.wrong(
            f"column {table.place[column]}, {role}, has no number, so that nobody knows what the "
            "row is of",
            row,
        )
    return values


def _grid(
    settings: ScanExport,
    table: ScanTable,
    roles: dict[str, int],
    numbers: dict[str, int],
    questions: ViewQuestions,
) -> tuple[IntArray, Array, IndexArray]:
    """Find points, frequencies, and the row of each of their pairs, -1 if there is none."""
    rows = len(table.values)
    if "frequency" not in roles:
        frequency = np.array([_one_frequency(settings, table, questions)])
        of_row = np.zeros(rows, np.intp)
    else:
        unit = meaning(table.units[roles["frequency"]])
        factor = unit.factor if unit is not None and unit.quantity == "frequency" else 1.0
        stated = factor * _known(table, "frequency", roles["frequency"])
        frequency, of_row = np.unique(stated, return_inverse=True)
    if names := _names(table, roles):
        label = np.array([numbers[name] for name in names], np.int64)
    elif "index" in roles:
        label = _whole(table, roles["index"])
    elif len(frequency) == 1:
        label = np.arange(1, rows + 1)
    else:
        raise table.wrong("several frequencies need a column of point numbers before x")
    node, of_node = np.unique(label, return_inverse=True)
    row = np.full((len(node), len(frequency)), -1, np.intp)
    for i, place in enumerate(zip(of_node, of_row, strict=True)):
        if row[place] >= 0:
            own = names[i] if names else label[i]
            raise table.wrong(f"point {own} at {frequency[place[1]]:g} Hz is given twice", i)
        row[place] = i
    if (row < 0).any() and incomplete_by(settings.incomplete) is Incomplete.refuse:
        p, f = np.argwhere(row < 0)[0]
        own = next((k for k, n in numbers.items() if names and n == node[p]), node[p])
        message = f"there is no row for point {own} at {frequency[f]:g} Hz; {REMEDY}"
        questions.note(table.wrong(message), table.path, "incomplete")
    return node, frequency, row


def _whole(table: ScanTable, column: int) -> IntArray:
    """Read a column of integers."""
    values = _known(table, "the point's number or status", column)
    wrong = np.flatnonzero((values != np.round(values)) | (np.abs(values) > 1e15))
    if len(wrong):
        row = int(wrong[0])
        raise table.wrong(
            f"column {table.place[column]} must be an integer, not {values[row]:g}", row
        )
    return values.astype(np.int64)


def _one_frequency(settings: ScanExport, table: ScanTable, questions: ViewQuestions) -> float:
    """Find the frequency of a table without a column of it; NaN of one that is asked for."""
    lines = table.before.splitlines()
    # Cells too: the comma before `100 Hz` is a delimiter here and a decimal mark there.
    cells = ["\t".join(fields(line, table.delimiter)) for line in lines]
    stated = stated_in([*lines, *cells], table.delimiter)
    if stated.one is None and len(settings.frequency) == 1:
        return settings.frequency[0]
    if stated.one is None:
        numbers = ", ".join(f"{f:g}" for f in stated.all)
        several = f"states {numbers} Hz" if numbers else "states none"
        questions.ask(table.path, "frequency", "[197]", f"one frequency of its values ({several})")
        return np.nan
    return stated.one


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
        label = meaning(table.units[roles["phase"]])
        if label is None or label.quantity != "angle":
            raise table.wrong("the phase must be in deg or rad, as its column's name must state")
        largest = float(np.nanmax(np.abs(column["phase"]), initial=0.0))
        if label.factor == 1.0 and largest > MOST_RADIANS:
            raise table.wrong(
                f"the phase is in {table.units[roles['phase']]} and reaches {largest:g}, which are "
                "many turns; correct the unit in the column's name if it is in deg"
            )
        return np.asarray(column["magnitude"] * np.exp(1j * label.factor * column["phase"]))
    if "real" not in column:
        raise table.wrong("instrument.columns must name real (and imag), or magnitude and phase")
    return column["real"] + 1j * column["imag"] if "imag" in column else column["real"]


def _missing(
    settings: ScanExport,
    table: ScanTable,
    roles: dict[str, int],
    row: IndexArray,
    values: NDArray,
    questions: ViewQuestions,
) -> tuple[BoolArray, dict[int, str]]:
    """Mark points without numbers or rows, or of a bad status, or that are zero throughout.

    Returns
    -------
    missing : ndarray of bool, shape (point,)
    said : dict of int to str
        Where the file says so, by the point's place.
    """
    absent, there = ~np.isfinite(values), row >= 0
    of_row = absent | ~_good(settings, table, roles, questions)
    missing = np.asarray((of_row[row] | ~there).any(axis=1))
    zero = ~missing & ~values[row].any(axis=1)
    if settings.zeros is Zeros.refuse and zero.any():
        line = table.line[row[zero][0, 0]]
        what = f"whether points whose values are all zero, as in line {line}, were measured"
        also = f" (measured, or missing{then(settings.incomplete)})"
        questions.ask(table.path, "zeros", "missing", what, also)
    if settings.zeros is Zeros.missing:
        missing = missing | zero
    said = {
        int(p): f"line {table.line[r]}"
        for p in np.flatnonzero(missing)
        for r in row[p]
        if r >= 0 and (of_row[r] or not values[r])
    }
    _ask_incomplete(settings, table, absent, questions)
    return missing, said


def _ask_incomplete(
    settings: ScanExport, table: ScanTable, absent: BoolArray, questions: ViewQuestions
) -> None:
    """Ask what becomes of rows without values, `absent` of shape (row,)."""
    if absent.any() and incomplete_by(settings.incomplete) is Incomplete.refuse:
        lines = [table.line[i] for i in np.flatnonzero(absent)]
        what = (
            f"the values of {len(lines)} of {len(absent)} rows (the first is line {lines[0]}), "
            "whose points may be left out, or kept and marked"
        )
        questions.ask(table.path, "incomplete", "drop", what)


def _good(
    settings: ScanExport, table: ScanTable, roles: dict[str, int], questions: ViewQuestions
) -> BoolArray:
    """Tell which rows are to be trusted by their status, shape (row,)."""
    if "status" not in roles:
        return np.ones(len(table.values), bool)
    column = roles["status"]
    words = table.words.get(column)
    status = np.array(words if words else [str(n) for n in _whole(table, column)])
    seen = list(dict.fromkeys(status.tolist()))
    if not settings.good_status and (words or len(seen) > 1):
        listed = ", ".join(sorted(seen)[:MOST_STATUS])
        place = table.place[column]
        what = f"which are good of the values {listed}, of which column {place} may be a status"
        also = f" (others are missing{then(settings.incomplete)})" if len(seen) > 1 else ""
        questions.ask(table.path, "good_status", f"[{seen[0]}]", what, also)
        return np.ones(len(status), bool)
    return np.isin(status, [str(good) for good in settings.good_status] or seen)


def _length(
    settings: ScanExport, table: ScanTable, roles: dict[str, int], questions: ViewQuestions
) -> tuple[float, str]:
    """Find one unit of the coordinates in m, and who says so."""
    if settings.length_unit is not None:
        return settings.length_unit.value, "as set"
    units = {table.units[roles[axis]] for axis in "xyz"}
    label = meaning(unit := units.pop()) if len(units) == 1 else None
    if label is None or not is_length(unit):
        questions.ask(table.path, "length_unit", "mm", COORDINATES)
        return 1.0, ""
    return label.factor, f"by the label {unit}"


def _conventions(
    settings: ScanExport, table: ScanTable, roles: dict[str, int], questions: ViewQuestions
) -> Conventions:
    """Decide how values become velocities: by the settings, or the unit of their column."""
    text = label_of_values(table, roles)
    label = motion_of(table, text)
    quantity = settings.quantity or (Quantity[label.quantity] if label else None)
    if quantity is None:
        questions.ask(table.path, "quantity", "velocity", VALUES)
    unit = settings.unit.value if settings.unit else label.factor if label else None
    if unit is None:
        questions.ask(table.path, "unit", "m", f"{VALUES} (m of m/s)")
    factor, told = _scale(settings, table, label, questions)
    _ask_senses(settings, table, questions)
    if quantity is None or unit is None or settings.positive is None or settings.phase is None:
        return Conventions(Quantity.velocity, 1.0, False, {})  # what is missing is asked for
    told |= {
        "quantity": quantity.name,
        "unit": f"{unit:g} per unit in SI, {'as set' if settings.unit else f'by {text}'}",
        "positive": settings.positive.name,
        "phase": settings.phase.name,
        "directions": settings.directions.name,
        "columns": ", ".join(f"{role} {table.place[i]}" for role, i in roles.items()),
    }
    conjugate = settings.phase.value < 0
    factor *= unit * settings.positive.value
    per = unit_of_reference(label.reference) if label and label.reference else None
    return Conventions(quantity, factor, conjugate, told, reference=per)


def _ask_the_rest(settings: ScanExport, table: ScanTable, questions: ViewQuestions) -> None:
    """Ask for what is open besides the columns, of which some are not known."""
    _ask_senses(settings, table, questions)
    lengths = [i for i, unit in enumerate(table.units) if is_length(unit)]
    if settings.length_unit is None and len(lengths) < len("xyz"):
        questions.ask(table.path, "length_unit", "mm", COORDINATES)
    motions = {
        unit: label
        for i, unit in enumerate(table.units)
        if i not in lengths[:3] and (label := meaning(unit)) is not None and label.is_motion
    }
    for label in motions.values() or [None]:
        _scale(settings, table, label, questions)
    if not motions:
        for setting, example, what in (
            ("quantity", "velocity", VALUES),
            ("unit", "m", f"{VALUES} (m of m/s)"),
        ):
            if getattr(settings, setting) is None:
                questions.ask(table.path, setting, example, what)
    if "Hz" not in table.before and not any(map(is_frequency, table.units)):
        _one_frequency(settings, table, questions)
    numbers = [i for i in range(len(table.units)) if i not in table.words]
    absent = np.asarray(np.isnan(table.values[:, numbers]).any(axis=1))
    _ask_incomplete(settings, table, absent, questions)


def _ask_senses(settings: ScanExport, table: ScanTable, questions: ViewQuestions) -> None:
    """Ask for the senses that no table tells."""
    if settings.positive is None:
        what = "where a positive velocity points to"
        questions.ask(table.path, "positive", "towards", what)
    if settings.phase is None:
        what = "the sign of the phase (exp_plus or exp_minus)"
        questions.ask(table.path, "phase", "exp_plus", what)


def _scale(
    settings: ScanExport, table: ScanTable, label: UnitLabel | None, questions: ViewQuestions
) -> tuple[float, dict[str, str]]:
    """Find the factor to peak amplitudes, or to those of the reference, and what says so."""
    if label is not None and label.reference:
        if settings.reference is None:
            what = (
                f"the reference's peak amplitude, which values in {label.text} are multiplied with"
            )
            questions.ask(table.path, "reference", "1.0", what)
            return 1.0, {}
        try:
            amount = reference_of(settings.reference).per(unit_of_reference(label.reference))
        except UserError as error:
            questions.note(table.wrong(str(error)), table.path, "reference")
            return 1.0, {}
        return amount, {"reference": f"{amount:g} {label.reference}"}
    amplitude = settings.amplitude or (label.amplitude if label else None)
    if amplitude is None:
        questions.ask(table.path, "amplitude", "peak", AMPLITUDES)
        return 1.0, {}
    by = "" if settings.amplitude else f" by {label.text if label else ''}"
    return amplitude.value, {"amplitude": f"{amplitude.name}{by}"}
