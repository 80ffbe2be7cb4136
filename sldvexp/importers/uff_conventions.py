"""Conventions of a universal file: from its own words and the settings, or asked for."""

from __future__ import annotations

from enum import Enum

from sldvexp.importers.conventions import (
    Amplitude,
    Conventions,
    Directions,
    MotionUnit,
    Phase,
    Quantity,
    motion_in_product,
    motion_of,
    unstated,
)
from sldvexp.importers.pointwise import PointwiseImport
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
#: How far two statements of one unit may be apart, relatively.
SAME_UNIT = 1e-3
SCALES = {PEAK: Amplitude.peak, RMS: Amplitude.rms}


def decide_conventions(
    settings: PointwiseImport, file: UniversalFile, functions: list[Function]
) -> Conventions:
    """Decide how values of the chosen functions of a file become velocities.

    Raises
    ------
    UserError
        If functions differ, the file contradicts itself, or something is not said anywhere.
    """
    kind = FunctionKind(functions[0].kind)
    each = {f.ordinate: f for f in reversed(functions)}  # the first function of each
    meanings = {_meaning(settings, file, f): f for f in reversed(each.values())}
    if len(meanings) > 1:
        (one, first), (two, second) = list(meanings.items())[:2]
        raise file.wrong(
            second,
            f"has values in {_shown(*two)}, but data set {first.entry.number} in {_shown(*one)}; "
            "functions of mixed units must come in different files, or instrument.containing must "
            "choose among them",
        )
    ((quantity, unit, by),) = meanings
    told = {"quantity": quantity.name, "unit": f"{unit:g} m per unit, {by}"}
    scale, said = _scale(settings, file, kind, functions[0])
    phase = Phase.exp_plus if kind is FunctionKind.time else settings.phase
    if phase is None:
        what = "the sign of the phase (exp_plus or exp_minus)"
        if kind is FunctionKind.cross:
            what += "; a cross spectrum of the response and the conjugate reference is exp_plus"
        raise unstated(file.source.path, "phase", "exp_plus", what)
    sign = 1
    if settings.directions is not Directions.dof:
        if settings.positive is None:
            what = "where a positive velocity points to"
            raise unstated(file.source.path, "positive", "towards", what)
        sign = settings.positive.value
    told |= said | {
        "positive": settings.positive.name if settings.positive else "along the dof",
        "phase": phase.name,
        "function": KINDS[kind.value],
        "directions": settings.directions.name,
    }
    return Conventions(quantity, unit * scale * sign, phase is Phase.exp_minus, told)


def _scale(
    settings: PointwiseImport, file: UniversalFile, kind: FunctionKind, function: Function
) -> tuple[float, dict[str, str]]:
    """Find the factor to peak amplitudes: the reference, or the scale of spectra."""
    if kind is FunctionKind.time:
        return 1.0, {"amplitude": "peak, of the sines of time records"}
    if kind in (FunctionKind.spectrum, FunctionKind.nodal):
        amplitude, by = _amplitude(settings, file, kind)
        return amplitude.value, {"amplitude": f"{amplitude.name}, {by}"}
    if settings.reference is None:
        what = (
            "the reference's peak amplitude, which response functions are multiplied with (1: "
            "velocities per unit of the reference)"
        )
        raise unstated(file.source.path, "reference", "1.0", what)
    unit = function.reference.unit
    return settings.reference, {"reference": f"{settings.reference:g} {unit}".strip()}


def length_unit(settings: PointwiseImport, file: UniversalFile) -> tuple[float, str]:
    """Find one unit of the file's coordinates in m, and who says so."""
    if settings.length_unit is not None:
        return settings.length_unit.value, "as set"
    if file.units is not None:
        return file.units.length, "by data set 164"
    what = "the unit of its coordinates in a data set 164"
    raise unstated(file.source.path, "length_unit", "mm", what)


def _meaning(
    settings: PointwiseImport, file: UniversalFile, f: Function
) -> tuple[Quantity, float, str]:
    """Find quantity and unit of values: by the settings, the function's own words, data set 164."""
    where = f"{file.source.path}, data set {f.entry.number}"
    by_number = BY_NUMBER.get(f.ordinate.kind)
    cross = f.kind == FunctionKind.cross.value
    motion = (motion_in_product if cross else motion_of)(f.ordinate.unit)
    quantity = settings.quantity or by_number or (motion.quantity if motion else None)
    if quantity is None:
        what = "whether its values are a displacement, a velocity or an acceleration"
        raise unstated(where, "quantity", "velocity", what)
    differ = by_number and motion and by_number is not motion.quantity
    if settings.quantity is None and by_number and motion and differ:
        raise file.wrong(
            f,
            f"states the quantity {by_number.name}, but its unit {f.ordinate.unit} is one of "
            f"{motion.quantity.name}; say which with instrument.quantity",
        )
    if settings.unit is not None:
        return quantity, settings.unit.value, "as set"
    if motion is not None:
        if file.units is not None and motion.unit is not MotionUnit.g:
            _check_agree(file, f, motion.unit.value, file.units.length)
        return quantity, motion.unit.value, f"by the label {f.ordinate.unit}"
    if file.units is not None:
        return quantity, file.units.length, "by data set 164"
    raise unstated(where, "unit", "m", "the unit of its values (m of m/s)")


def _check_agree(file: UniversalFile, f: Function, label: float, stated: float) -> None:
    """Complain unless a function's label and data set 164 have the same unit of length."""
    if abs(label / stated - 1) > SAME_UNIT:
        raise file.wrong(
            f,
            f"has values in {f.ordinate.unit}, but data set 164 states a unit of length of "
            f"{stated:g} m; units are mixed, say which with instrument.unit",
        )


def _amplitude(
    settings: PointwiseImport, file: UniversalFile, kind: FunctionKind
) -> tuple[Amplitude, str]:
    """Find the scale of amplitudes of a spectrum, or of nodal values, of which 1858 is silent."""
    if settings.amplitude is not None:
        return settings.amplitude, "as set"
    if kind is FunctionKind.nodal:
        what = "whether nodal amplitudes are peak or rms"
        raise unstated(file.source.path, "amplitude", "peak", what)
    if file.amplitude is not None and file.amplitude[0] == HALF_PEAK:
        entry = file.amplitude[1]
        raise entry.wrong(
            file.source,
            entry.first,
            "states half-peak amplitudes, by which programs mean the peak or half of it; say "
            "which with instrument.amplitude=peak or half",
        )
    if file.amplitude is not None:
        return SCALES[file.amplitude[0]], f"by data set {file.amplitude[1].number} (1858)"
    what = "whether amplitudes are peak or rms in a data set 1858"
    raise unstated(file.source.path, "amplitude", "rms", what)


def _shown(quantity: Quantity, unit: float, by: str) -> str:
    """Name a quantity with its unit, for a message."""
    return f"units of {unit:g} m of {quantity.name} ({by})"
