"""`instrument=scan_export`: tables of points as scanning vibrometers export them as text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.dataset import Finding, Severity
from sldvexp.errors import Checks, UserError
from sldvexp.importers.conventions import Conventions, Directions, Quantity, Zeros
from sldvexp.importers.head_lines import HeadLines
from sldvexp.importers.incomplete import REMEDY, Incomplete, incomplete_by, then
from sldvexp.importers.pointwise import PointwiseImport
from sldvexp.importers.pointwise_data import PointwiseData, PointwiseView
from sldvexp.importers.questions import SeenPoints, ViewQuestions
from sldvexp.importers.reference import reference_of, unit_of_reference
from sldvexp.importers.scan_frequency import stated_in
from sldvexp.importers.scan_rows import read_table
from sldvexp.importers.scan_table import (
    ColumnsNotUnderstoodError,
    ScanTable,
    by_rows,
    fields,
    is_frequency,
    is_length,
    meaning,
)
from sldvexp.io.statements import Known
from sldvexp.io.uff import UniversalGeometry
from sldvexp.io.uff.geometry import WORLD
from sldvexp.typing import Array, BoolArray, IndexArray, IntArray
from sldvexp.unit_labels import SpectralForm, UnitLabel, same_unit

#: How questions name what a table does not state.
COORDINATES, VALUES = "the unit of its coordinates", "the unit of its values"
AMPLITUDES = "whether amplitudes are peak or rms"
#: Beyond such point numbers gaps mean nothing, as they are names then.
MOST_NUMBERS = 10**7
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
        views = [_view(self.of_view(n), n, v, questions.of(n)) for n, v in self.views.items()]
        units = {v.name: v.reference for v in views if v is not None and v.reference is not None}
        odd = self.check_references(units, questions)
        questions.done()
        for found in filter(None, views):
            found.findings.extend(odd if found is views[0] else [])
            yield found


def _view(
    settings: ScanExport, name: str, view: PointwiseView, questions: ViewQuestions
) -> PointwiseData | None:
    """Read one view's table and turn its values into velocities; None if a question is open."""
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
    node, frequency, row = _grid(settings, table, roles, questions)
    rules = _conventions(settings, table, roles, questions)
    values = _values(table, roles)
    missing, said = _missing(settings, table, roles, row, values, questions)
    length, by = _length(settings, table, roles, questions)
    odd = _head_lines(settings, table, roles, length if by else None, questions)
    source, known = str(table.path), not settings.frequency and not np.isnan(frequency).any()
    has_std = settings.std is not None
    seen = SeenPoints(name, source, node, missing, frequency if known else None, said, has_std)
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
            *_gaps(name, roles, node),
            *_overruled(settings, name, table, roles),
            *(Finding("unit", f"view {name}", text) for text in odd),
            *_left_out(settings, name, table, roles),
        ],
        said,
        rules.reference,
    )


def _gaps(name: str, roles: dict[str, int], node: IntArray) -> list[Finding]:
    """Tell which point numbers there are not, of which a file may have lost the rows."""
    if "index" not in roles or node[-1] - node[0] > MOST_NUMBERS:
        return []
    absent = np.setdiff1d(np.arange(node[0], node[-1] + 1), node)
    if not len(absent):
        return []
    shown = ", ".join(str(n) for n in absent[:5]) + (" and more" if len(absent) > 5 else "")
    text = (
        f"the table of view {name} has no rows for {len(absent)} of the point numbers {node[0]} to "
        f"{node[-1]}: {shown}"
    )
    size = float(len(absent))
    return [Finding("missing_rows", f"view {name}", text, Severity.note, size=size)]


#: Different words in a column that may be a point's status; of more, it is a remark.
FEW_WORDS = range(2, 7)


def _left_out(
    settings: ScanExport, name: str, table: ScanTable, roles: dict[str, int]
) -> list[Finding]:
    """Tell which columns `instrument.columns` leaves out, and if one may say what is valid."""
    others = [i for i in range(table.values.shape[1]) if i not in roles.values()]
    if not settings.columns or not others:
        return []
    named = f"{table.path}: instrument.columns leaves out {table.listed(others)}"
    few = {i: sorted(set(table.words[i])) for i in others if i in table.words}
    few = {i: words for i, words in few.items() if len(words) in FEW_WORDS}
    if not few or "status" in roles:
        return [Finding("left_out", f"view {name}", named, Severity.note)]
    column, words = next(iter(few.items()))
    text = (
        f"{named}; column {table.place[column]} is {', '.join(words)}: if that tells which values "
        "are good, points of bad ones are used"
    )
    remedy = f"instrument.columns.status={table.place[column]}"
    return [Finding("left_out", f"view {name}", text, Severity.doubtful, remedy=remedy)]


def _overruled(
    settings: ScanExport, name: str, table: ScanTable, roles: dict[str, int]
) -> list[Finding]:
    """Tell where settings win over labels that are understood."""
    text, length = _label(table, roles), table.units[roles["x"]]
    values, places = meaning(text), meaning(length)
    if values is not None and not values.is_motion:
        values = None
    differs = {
        ("quantity", text): values is not None
        and settings.quantity is not None
        and settings.quantity.name != values.quantity,
        ("unit", text): values is not None
        and settings.unit is not None
        and not same_unit(values.factor, settings.unit.value),
        ("amplitude", text): values is not None
        and None not in (settings.amplitude, values.amplitude)
        and settings.amplitude is not values.amplitude,
        ("length_unit", length): places is not None
        and settings.length_unit is not None
        and places.quantity == "displacement"
        and not same_unit(places.factor, settings.length_unit.value),
    }
    return [
        Finding(
            "unit",
            f"view {name}",
            f"{table.path}: {settings.key(setting)}={getattr(settings, setting).name} wins, "
            f"although the file says {label}",
        )
        for (setting, label), so in differs.items()
        if so
    ]


def _head_lines(
    settings: ScanExport,
    table: ScanTable,
    roles: dict[str, int],
    length: float | None,
    questions: ViewQuestions,
) -> list[str]:
    """Compare lines that are no rows with what values are read as; tell where settings win."""
    text = _label(table, roles)
    label = _motion(table, text)
    phase = meaning(table.units[roles["phase"]]) if "phase" in roles else None
    amplitude = settings.amplitude or (label.amplitude if label else None)
    quantity = settings.quantity.name if settings.quantity else label.quantity if label else None
    known = Known(
        quantity,
        settings.unit.value if settings.unit else label.factor if label else None,
        None if label is not None and label.reference else amplitude,
        length,
        None if phase is None else "radian" if phase.factor == 1.0 else "degree",
        settings.phase.name if settings.phase else None,
        settings.positive.name if settings.positive else None,
    )
    by = dict.fromkeys(("quantity", "unit", "amplitude"), f"the column of values {text}")
    by["length_unit"] = f"the columns of coordinates {table.units[roles['x']]}"
    by["angle"] = f"the column of phases {table.units[roles.get('phase', 0)]}"
    lines = HeadLines(settings, str(table.path), known, by)
    places = (partial(f"{table.path}, line {{}}".format, i) for i, _ in table.said)
    lines.compare(zip(places, (line for _, line in table.said), strict=True), questions)
    return lines.odd


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
    settings: ScanExport, table: ScanTable, roles: dict[str, int], questions: ViewQuestions
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
    if (row < 0).any() and incomplete_by(settings.incomplete) is Incomplete.refuse:
        p, f = np.argwhere(row < 0)[0]
        message = f"there is no row for point {node[p]} at {frequency[f]:g} Hz; {REMEDY}"
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
    text = _label(table, roles)
    label = _motion(table, text)
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


def _label(table: ScanTable, roles: dict[str, int]) -> str:
    """Give the label of the values' unit."""
    return table.units[roles.get("real", roles.get("magnitude", 0))]


def _motion(table: ScanTable, text: str) -> UnitLabel | None:
    """Understand the values' unit; None if it is none of a motion.

    Raises
    ------
    UserError
        If values are squares, or spectra over a frequency, which have no amplitude.
    """
    label = meaning(text)
    if label is None or not label.is_motion:
        return None
    if label.form is not SpectralForm.linear or label.product:
        raise table.wrong(
            f"its values are in {text}, which is no amplitude of a motion; export linear values, "
            "as in mm/s, or response functions"
        )
    return label


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
