"""Conventions of a universal file: from its own words and the settings, or asked for.

The quantity of values is stated by a number (8, 11 or 12; 0 and 1 say nothing) and by the label of
their unit, the unit by the label and by data set 164. A label that is there and not understood is
asked about: nothing else in the file replaces it.
"""

from __future__ import annotations

from enum import Enum
from functools import partial
from typing import NamedTuple

from sldvexp.dataset import Severity
from sldvexp.errors import UserError
from sldvexp.importers.conventions import (
    Amplitude,
    Conventions,
    Directions,
    Phase,
    Quantity,
)
from sldvexp.importers.head_lines import HeadLines
from sldvexp.importers.pointwise import PointwiseImport
from sldvexp.importers.questions import ViewQuestions
from sldvexp.importers.reference import ReferenceUnit, reference_of, unit_of_reference
from sldvexp.io.statements import Known
from sldvexp.io.uff import Function, UniversalFile
from sldvexp.io.uff.functions import (
    ACCELERATION,
    DISPLACEMENT,
    HALF_PEAK,
    KINDS,
    PEAK,
    RMS,
    VELOCITY,
)
from sldvexp.unit_labels import (
    SpectralForm,
    UnitLabel,
    UnitNotUnderstoodError,
    read_unit,
    same_unit,
)


class FunctionKind(Enum):
    """Kinds of functions that are read; the value is their type in data set 58, or the data set."""

    frf = 4
    spectrum = 12
    time = 1
    cross = 3
    nodal = 55


BY_NUMBER = {
    DISPLACEMENT: Quantity.displacement,
    VELOCITY: Quantity.velocity,
    ACCELERATION: Quantity.acceleration,
}
SCALES = {PEAK: Amplitude.peak, RMS: Amplitude.rms}
#: Kinds whose values are amplitudes of motions.
OF_AMPLITUDES = (FunctionKind.spectrum, FunctionKind.nodal)
#: Kinds whose values are per unit of a reference, or were multiplied with it.
OF_REFERENCE = (FunctionKind.frf, FunctionKind.cross)
#: Numbers of reaction and excitation forces.
FORCES = (9, 13)


class Meaning(NamedTuple):
    """Meaning of the values of a function.

    Parameters
    ----------
    factor : float
        One of their unit in SI.
    by : str
        Who says so.
    amplitude : Amplitude or None
        By the label.
    odd : tuple of (str, Severity)
        What else the file says that is not heeded, and how much that weighs.
    """

    quantity: Quantity
    factor: float
    by: str
    amplitude: Amplitude | None = None
    odd: tuple[tuple[str, Severity], ...] = ()

    def __str__(self) -> str:
        """Name the quantity with its unit, for a message."""
        return f"units of {self.factor:g} m of {self.quantity.name} ({self.by})"


def decide_conventions(
    settings: PointwiseImport,
    file: UniversalFile,
    functions: list[Function],
    questions: ViewQuestions,
) -> Conventions | None:
    """Decide how values of the chosen functions of a file become velocities.

    Parameters
    ----------
    questions : ViewQuestions
        To which is added what is not said anywhere, or in two ways.

    Returns
    -------
    Conventions or None
        None if a question is open.

    Raises
    ------
    UserError
        If functions differ, or are powers.
    """
    kind = FunctionKind(functions[0].kind)
    meaning = _one_meaning(settings, file, functions, questions)
    unit = _reference_unit(file, functions) if kind in OF_REFERENCE else None
    scaled = _scale(settings, file, functions[0], meaning, unit, questions)
    phase = Phase.exp_plus if kind is FunctionKind.time else settings.phase
    if phase is None:
        ask_phase(settings, file, questions, kind)
    along_dof = settings.directions is Directions.dof
    ask_positive(settings, file, questions)
    odd = _head_lines(settings, file, functions, meaning, scaled, questions)
    if meaning is None or scaled is None or phase is None or questions:
        return None
    scale, said = scaled
    sign = 1 if along_dof or settings.positive is None else settings.positive.value
    told = {"quantity": meaning.quantity.name, "unit": f"{meaning.factor:g} m per unit, "}
    told["unit"] += meaning.by
    told |= said | {
        "positive": settings.positive.name if settings.positive else "along the dof",
        "phase": phase.name,
        "function": KINDS[kind.value],
        "directions": settings.directions.name,
    }
    factor = meaning.factor * scale * sign
    conjugate = phase is Phase.exp_minus
    amplitude = scale if unit is not None else None
    return Conventions(meaning.quantity, factor, conjugate, told, odd, unit, amplitude)


def _head_lines(
    settings: PointwiseImport,
    file: UniversalFile,
    functions: list[Function],
    meaning: Meaning | None,
    scaled: tuple[float, dict[str, str]] | None,
    questions: ViewQuestions,
) -> tuple[tuple[str, Severity], ...]:
    """Compare what functions and the file say of themselves; tell all that is not heeded."""
    path = str(file.source.path)
    of_amplitudes = scaled is not None and FunctionKind(functions[0].kind) in OF_AMPLITUDES
    along_dof = settings.directions is Directions.dof
    known = Known(
        meaning.quantity.name if meaning else None,
        meaning.factor if meaning else None,
        Amplitude(scaled[0]) if scaled and of_amplitudes else None,
        phase=settings.phase.name if settings.phase else None,
        positive=settings.positive.name if settings.positive and not along_dof else None,
    )
    by = dict.fromkeys(("quantity", "unit"), f"its values are in {meaning}")
    if scaled and of_amplitudes:
        by["amplitude"] = f"its amplitudes are {scaled[1]['amplitude']}"
    lines = HeadLines(settings, path, known, by)
    texts = file.texts(functions)
    lines.compare([(partial(file.at, e, i), text) for e, i, text in texts], questions)
    lines.compare([(partial(file.at, e, i), text) for e, i, text in file.about], questions, True)
    own = meaning.odd if meaning else ()
    return (
        *((f"{path}: {text}", severity) for text, severity in own),
        *((text, Severity.doubtful) for text in lines.odd),
    )


def ask_phase(
    settings: PointwiseImport,
    file: UniversalFile,
    questions: ViewQuestions,
    kind: FunctionKind | None = None,
) -> None:
    """Ask for the sign of the phase, of functions of one kind or of any."""
    if settings.phase is None and not (kind is None and questions.asked("phase")):
        what = "the sign of the phase (exp_plus or exp_minus)"
        if kind is FunctionKind.cross:
            what += "; a cross spectrum of the response and the conjugate reference is exp_plus"
        questions.ask(file.source.path, "phase", "exp_plus", what)


def ask_positive(settings: PointwiseImport, file: UniversalFile, questions: ViewQuestions) -> None:
    """Ask where a positive velocity points to, unless a dof tells it."""
    if settings.directions is not Directions.dof and settings.positive is None:
        what = "where a positive velocity points to"
        questions.ask(file.source.path, "positive", "towards", what)


def _one_meaning(
    settings: PointwiseImport,
    file: UniversalFile,
    functions: list[Function],
    questions: ViewQuestions,
) -> Meaning | None:
    """Find the meaning that all functions have in common."""
    each = {f.ordinate: f for f in reversed(functions)}  # the first function of each
    meanings = {_meaning(settings, file, f, questions): f for f in reversed(each.values())}
    if None in meanings:
        return None
    if len(meanings) > 1:
        (one, first), (two, second) = list(meanings.items())[:2]
        raise file.wrong(
            second,
            f"has values in {two}, but data set {first.entry.number} in {one}; functions of mixed "
            "units must come in different files, or instrument.containing must choose among them",
        )
    return next(iter(meanings))


def _scale(
    settings: PointwiseImport,
    file: UniversalFile,
    function: Function,
    meaning: Meaning | None,
    unit: ReferenceUnit | None,
    questions: ViewQuestions,
) -> tuple[float, dict[str, str]] | None:
    """Find the factor to peak amplitudes: the reference, or the scale of spectra."""
    kind = FunctionKind(function.kind)
    if kind is FunctionKind.time:
        return 1.0, {"amplitude": "peak, of the sines of time records"}
    if kind in OF_AMPLITUDES:
        found = _amplitude(settings, file, function, meaning, questions)
        return (found[0].value, {"amplitude": f"{found[0].name}, {found[1]}"}) if found else None
    if settings.reference is None or unit is None:
        what = (
            "the reference's peak amplitude, which response functions are multiplied with (1: "
            "velocities per unit of the reference)"
        )
        questions.ask(file.source.path, "reference", "1.0", what)
        return None
    try:
        amount = reference_of(settings.reference).per(unit)
    except UserError as error:
        questions.note(file.wrong(function, str(error)), file.source.path, "reference")
        return None
    return amount, {"reference": f"{amount:g} {unit.text}".strip()}


def _reference_unit(file: UniversalFile, functions: list[Function]) -> ReferenceUnit:
    """Find the one unit of the references of all functions.

    Raises
    ------
    UserError
        If they are in several.
    """
    first = _own_reference_unit(file, functions[0])
    for function in functions[1:]:
        unit = _own_reference_unit(file, function)
        if not unit.is_same(first):
            raise file.wrong(
                function,
                f"has a reference in {unit.text or 'an unknown unit'}, data set "
                f"{functions[0].entry.number} in {first.text or 'an unknown unit'}; functions of "
                "references in several units must come in different files",
            )
    return first


def _own_reference_unit(file: UniversalFile, f: Function) -> ReferenceUnit:
    """Find the unit of a reference by its label, that of the values, or data set 164."""
    label, _ = read_label(f)
    texts = [f.reference.unit, label.reference if label is not None else ""]
    stated = [unit_of_reference(text) for text in texts if text]
    if stated and not stated[0].is_same(stated[-1]):
        return ReferenceUnit(" or ".join(unit.text for unit in stated))
    if stated or file.units is None:
        return stated[0] if stated else ReferenceUnit()
    if f.reference.kind in FORCES and file.units.force > 0:
        name = next((n for n in ("N", "lbf") if _is_force(n, file.units.force)), "")
        return ReferenceUnit(name or f"{file.units.force:g} N", "force", file.units.force)
    if f.reference.kind in BY_NUMBER:
        quantity = BY_NUMBER[f.reference.kind]
        per_time = {Quantity.displacement: "", Quantity.velocity: "/s"}.get(quantity, "/s^2")
        length = file.units.length
        name = "m" if length == 1 else f"{length:g} m"
        return ReferenceUnit(name + per_time, quantity.name, length)
    return ReferenceUnit()


def _is_force(name: str, factor: float) -> bool:
    """Tell whether a unit of force of data set 164 is the one of that name."""
    return unit_of_reference(name).is_same(ReferenceUnit(name, "force", factor))


def length_unit(
    settings: PointwiseImport, file: UniversalFile, questions: ViewQuestions
) -> tuple[float, str]:
    """Find one unit of the file's coordinates in m, and who says so."""
    if settings.length_unit is not None:
        return settings.length_unit.value, "as set"
    if file.units is not None:
        _ask_contradiction(file, "length_unit", questions)
        return file.units.length, "by data set 164"
    what = "the unit of its coordinates in a data set 164"
    also = ", or give the geometry of a file that does with instrument.geometry"
    questions.ask(file.source.path, "length_unit", "mm", what, also)
    return 1.0, ""


def _ask_contradiction(file: UniversalFile, setting: str, questions: ViewQuestions) -> None:
    """Ask for a unit that a data set 164 states in two ways."""
    if file.units is not None and file.units.contradiction:
        message = f"{file.units.contradiction}; say which with instrument.{setting}"
        questions.note(UserError(message), file.source.path, setting)


def _meaning(
    settings: PointwiseImport, file: UniversalFile, f: Function, questions: ViewQuestions
) -> Meaning | None:
    """Find quantity and unit of values: by the settings, the function's own words, data set 164."""
    where = f"{file.source.path}, data set {f.entry.number}"
    by_number = BY_NUMBER.get(f.ordinate.kind)
    label, trouble = read_label(f)
    if label is not None:
        _require_form(file, f, label)
    quantity = settings.quantity or by_number or (Quantity[label.quantity] if label else None)
    if quantity is None:
        what = "whether its values are a displacement, a velocity or an acceleration"
        questions.ask(where, "quantity", "velocity", what + trouble)
    if settings.unit is not None and quantity is not None:
        amplitude = label.amplitude if label is not None else None
        odd = _not_heeded(settings, f, label)
        return Meaning(quantity, settings.unit.value, "as set", amplitude, odd)
    if label is not None and quantity is not None:
        return _by_label(settings, file, f, label, quantity, questions)
    if not f.ordinate.unit and file.units is not None:
        by = "by data set 164"
        _ask_contradiction(file, "unit", questions)
        return Meaning(quantity, file.units.length, by) if quantity is not None else None
    if settings.unit is None:
        questions.ask(where, "unit", "m", f"the unit of its values (m of m/s){trouble}")
    return None


def read_label(f: Function) -> tuple[UnitLabel | None, str]:
    """Understand the label of a function's unit as one of a motion, or tell why not."""
    if not f.ordinate.unit:
        return None, ""
    try:
        label = read_unit(f.ordinate.unit)
    except UnitNotUnderstoodError as error:
        return None, f": {error}"
    if not label.is_motion:
        return None, (
            f": {label.text} is a unit of {label.quantity}; export values in a unit of motion, "
            f"unless 1 {label.text} is 1 of what the settings name"
        )
    cross = f.kind == FunctionKind.cross.value
    if label.reference and label.product is not cross:
        what = "divided by" if cross else "multiplied with"
        return None, f": {label.text} is of a motion {what} a reference"
    of_amplitudes = FunctionKind(f.kind) in OF_AMPLITUDES
    if label.amplitude is not None and not of_amplitudes:
        return None, (
            f": {label.text} names a measure of amplitudes, but the function is a {KINDS[f.kind]}"
        )
    return label, ""


def _require_form(file: UniversalFile, f: Function, label: UnitLabel) -> None:
    """Refuse values that are powers or densities, which have no phase or depend on a bandwidth."""
    good = {SpectralForm.linear}
    if f.kind == FunctionKind.cross.value:
        good |= {SpectralForm.power, SpectralForm.density}
    if label.form not in good:
        raise file.wrong(
            f,
            f"has values in {label.text}, a {label.form.value} of a {label.quantity}; export "
            "complex amplitudes or response functions",
        )


def _by_label(
    settings: PointwiseImport,
    file: UniversalFile,
    f: Function,
    label: UnitLabel,
    quantity: Quantity,
    questions: ViewQuestions,
) -> Meaning | None:
    """Find the unit by a label that is understood, unless others contradict it."""
    where = f"{file.source.path}, data set {f.entry.number}"
    factor = label.factor
    if label.quantity != quantity.name:
        if settings.quantity is None:
            message = (
                f"states the quantity {quantity.name}, but its unit {label.text} is one of "
                f"{label.quantity}; say which with instrument.quantity"
            )
            questions.note(file.wrong(f, message), file.source.path, "quantity")
            return None
        if label.factor != label.length:  # of times other than seconds, or of g
            what = f"the unit of length of its {quantity.name}; the label {label.text} has another"
            questions.ask(where, "unit", "m", f"{what} quantity")
            return None
        factor = label.length
    odd = _not_heeded(settings, f, label)
    if label.length and file.units is not None:
        stated = file.units.length
        differ = not same_unit(label.length, stated)
        if differ and stated != 1:
            message = (
                f"has values in {label.text}, but data set 164 states a unit of length of "
                f"{stated:g} m; units are mixed, say which with instrument.unit"
            )
            questions.note(file.wrong(f, message), file.source.path, "unit")
            return None
        if differ:  # programs write a data set 164 of SI whatever the labels are
            said = f"values are in {label.text} as their label says, although data set 164 states m"
            odd = (*odd, (said, Severity.note))
    return Meaning(quantity, factor, f"by the label {label.text}", label.amplitude, odd)


def _not_heeded(
    settings: PointwiseImport, f: Function, label: UnitLabel | None
) -> tuple[tuple[str, Severity], ...]:
    """Say where settings win over a function's own words.

    A label that is not understood was asked about; it is no contradiction.
    """
    by_number = BY_NUMBER.get(f.ordinate.kind)
    stated = {label.quantity} if label is not None else set()
    stated |= {by_number.name} if by_number is not None else set()
    amplitude = label.amplitude if label is not None else None
    unit_differs = (
        settings.unit is not None
        and f.ordinate.unit
        and (label is None or not same_unit(label.factor, settings.unit.value))
    )
    contradictions = {
        "quantity": settings.quantity is not None and stated - {settings.quantity.name},
        "unit": unit_differs,
        "amplitude": None not in (settings.amplitude, amplitude)
        and settings.amplitude is not amplitude,
    }
    said = f"{by_number.name + ' in ' if by_number else ''}{f.ordinate.unit or 'no unit'}"
    answer = "unit" if label is None else ""
    return tuple(
        (
            f"{settings.key(name)}={getattr(settings, name).name} wins, although the file says "
            f"{said}",
            Severity.note if name == answer else Severity.doubtful,
        )
        for name, differs in contradictions.items()
        if differs
    )


def _amplitude(
    settings: PointwiseImport,
    file: UniversalFile,
    function: Function,
    meaning: Meaning | None,
    questions: ViewQuestions,
) -> tuple[Amplitude, str] | None:
    """Find the scale of amplitudes of a spectrum, or of nodal values, of which 1858 is silent."""
    path = file.source.path
    if settings.amplitude is not None:
        return settings.amplitude, "as set"
    stated = file.amplitude if function.kind == FunctionKind.spectrum.value else None
    by_label = meaning.amplitude if meaning is not None else None
    if by_label is not None and stated is not None and SCALES.get(stated[0]) is not by_label:
        message = (
            f"{path}, data set {function.entry.number}: its unit {function.ordinate.unit} says "
            f"{by_label.name}, but data set {stated[1].number} (1858) the scale {stated[0]} (1 "
            "half-peak, 2 peak, 3 rms); say which with instrument.amplitude"
        )
        questions.note(UserError(message), path, "amplitude")
        return None
    if by_label is not None:
        return by_label, f"by the label {function.ordinate.unit}"
    if stated is None:
        what = "whether amplitudes are peak or rms in a data set 1858"
        if function.kind == FunctionKind.nodal.value:
            what = "whether nodal amplitudes are peak or rms"
        questions.ask(path, "amplitude", "peak", what)
        return None
    scale, entry = stated
    if scale == HALF_PEAK:
        error = entry.wrong(
            file.source,
            entry.first,
            "states half-peak amplitudes, by which programs mean the peak or half of it; say "
            "which with instrument.amplitude=peak or half",
        )
        questions.note(error, path, "amplitude")
        return None
    return SCALES[scale], f"by data set {entry.number} (1858)"
