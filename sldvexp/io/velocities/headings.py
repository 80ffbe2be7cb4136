"""Units in headings of columns and names of arrays, as ``Realteil [mm/s]`` and ``v_mm_s``.

A heading's unit stands in brackets at its end, or after a comma, slash, blank or underscore. In
brackets it must be understood, or be replaced by a setting; elsewhere words are no unit unless they
are understood as one of the column's quantity. Settings that contradict a heading are refused. The
name of a field of a struct is read as any other; a unit in the name of the struct itself, which may
be of other fields, is asked about.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from sldvexp.errors import UserError
from sldvexp.io.questions import OpenQuestionError
from sldvexp.io.tables import AXES
from sldvexp.io.velocities.table import FileLayout
from sldvexp.unit_labels import (
    Amplitude,
    SpectralForm,
    UnitLabel,
    UnitNotUnderstoodError,
    read_unit,
)
from sldvexp.units import VelocityUnit

#: Columns of each quantity; those of one are in one unit.
QUANTITIES = {
    "velocity": ("real", "imag", "std", "velocity", "velocity_std"),
    "displacement": (*AXES, "position"),
    "frequency": ("frequency",),
    "": ("dx", "dy", "dz", "direction_cosines"),
}
#: How a length is called.
SHOWN = {"displacement": "length", "": "number without unit"}
BRACKETS = re.compile(r"[\[({<]\s*(?P<unit>[^\[\]<>{}]*?)\s*[\])}>]\s*$")
#: Name of a field of a struct.
FIELD = re.compile(r"[A-Za-z]\w*(\.[A-Za-z]\w*)+")
#: Units of pure numbers.
NONE = ("", "-", "–", "1", "ohne")
#: How far a unit may be from one that is set.
SAME = 1e-9


@dataclass(frozen=True)
class HeadingUnits:
    """Meaning of the units that headings state.

    Parameters
    ----------
    velocity : float or None
        One of the velocities' unit in m/s, without what the amplitude's measure makes of it; None
        if neither headings nor settings say it.
    length : float or None
        One of the coordinates' unit in m; None if no heading says it.
    frequency : float or None
        One of the frequencies' unit in Hz; None if no heading says it.
    amplitude : Amplitude or None
        None if headings say nothing of it.
    """

    velocity: float | None = None
    length: float | None = None
    frequency: float | None = None
    amplitude: Amplitude | None = None


def read_headings(
    mapping: Mapping[str, str], unit: VelocityUnit | None, layout: FileLayout, path: Path
) -> HeadingUnits:
    """Find the units that a file's headings state.

    Parameters
    ----------
    mapping : mapping of str to str
        From the headings of the file to the names of columns.
    unit : VelocityUnit or None
        That of the settings.

    Raises
    ------
    UserError
        If a unit is not understood and no setting replaces it, is of another quantity, differs
        between columns of one quantity, or contradicts a setting.
    """
    stated = {q: _common(mapping, q, path, layout, unit) for q in QUANTITIES}
    velocity, length, frequency = (stated[q] for q in ("velocity", "displacement", "frequency"))
    for name, setting, label in (
        ("unit", unit, velocity),
        ("length_unit", layout.length, length),
    ):
        if setting and label and label.factor and abs(label.factor / setting.value - 1) > SAME:
            raise _contradiction(path, label, name, setting.name)
    amplitude = velocity.amplitude if velocity else None
    if amplitude and velocity and layout.amplitude not in (None, amplitude):
        raise _contradiction(path, velocity, "amplitude", layout.amplitude.name)
    return HeadingUnits(
        (velocity and velocity.factor) or (unit and unit.value),
        length.factor if length else None,
        frequency.factor if frequency else None,
        amplitude,
    )


def _contradiction(path: Path, label: UnitLabel, name: str, setting: str) -> UserError:
    return UserError(
        f"{path}: a heading states {label.text}, the configuration instrument.{name}={setting}; "
        "they must agree"
    )


def _common(
    mapping: Mapping[str, str],
    quantity: str,
    path: Path,
    layout: FileLayout,
    unit: VelocityUnit | None,
) -> UnitLabel | None:
    """Find the one unit of the columns of a quantity; None if no heading has one."""
    settings = {
        "velocity": unit and layout.amplitude and "instrument.unit and instrument.amplitude",
        "displacement": layout.length and "instrument.length_unit",
    }
    columns = [(k, v) for k, v in mapping.items() if v in QUANTITIES[quantity]]
    found = {}
    for heading, own in columns:
        try:  # the program's own names, as velocity_std, have no unit
            found[heading] = None if heading == own else _unit_of(heading, own, quantity)
        except UserError as error:
            if isinstance(error, UnitNotUnderstoodError) and settings.get(quantity):
                found[heading] = None  # the settings say it
                continue
            message = f"{path}: the heading {heading!r}, {own}: {error}{_remedy(quantity)}"
            raise OpenQuestionError(message) from None
    _require_same(found, path)
    return next(iter(found.values()), None)


def _unit_of(heading: str, own: str, quantity: str) -> UnitLabel | None:
    """Read the unit in a heading, or in a field's name of a struct, as ``data.v_mm_s``.

    Raises
    ------
    UnitNotUnderstoodError
        If the name of the struct itself may state the unit of the column's quantity.
    """
    if not FIELD.fullmatch(heading):
        return unit_in(heading, quantity)
    *structs, name = heading.split(".")
    label = None if name == own else unit_in(f"_{name}", quantity)  # it may be no more than a unit
    if label is not None:
        return label
    for struct in structs:
        try:
            stated = unit_in(f"_{struct}", quantity)
        except UserError:  # of another quantity, as of another field
            continue
        if stated and quantity and (stated.factor not in (0.0, 1.0) or _scales(stated)):
            raise UnitNotUnderstoodError(f"the name of {struct} may state {stated.text!r}")
    return None


def _scales(label: UnitLabel) -> bool:
    """Tell whether values in a unit are no peak amplitudes."""
    return label.amplitude not in (None, Amplitude.peak)


def require_bracket_understood(
    heading: str, unit: VelocityUnit | None, layout: FileLayout, path: Path
) -> None:
    """Ask for the unit in a heading whose bracket is not understood, of a column of any quantity.

    Raises
    ------
    OpenQuestionError
        If nothing else may say it.
    """
    bracket = BRACKETS.search(heading)
    if not bracket or bracket["unit"] in NONE or (unit and layout.amplitude) or layout.length:
        return
    try:
        read_unit(bracket["unit"])
    except UnitNotUnderstoodError as error:
        ways = [_remedy("velocity")[2:], _remedy("displacement")[2:]]
        raise OpenQuestionError(
            f"{path}: the heading {heading!r}: {error}; of velocities {ways[0]}; of coordinates "
            f"{ways[1]}"
        ) from None


def _remedy(quantity: str) -> str:
    """Say how a unit becomes known."""
    if quantity == "velocity":
        return "; say it with both instrument.unit and instrument.amplitude, or correct the heading"
    if quantity == "displacement":
        return "; say it with instrument.length_unit, or correct the heading"
    return "; correct the heading in the file and in instrument.mapping"


def _require_same(found: Mapping[str, UnitLabel | None], path: Path) -> None:
    """Refuse columns of one quantity in different units, or of which some have none."""
    meanings = {h: u and (u.factor, u.amplitude) for h, u in found.items()}
    if len(set(meanings.values())) > 1:
        units = ", ".join(f"{h!r} ({u.text if u else 'no unit'})" for h, u in found.items())
        raise UserError(f"{path}: the columns {units} must state the same unit")


def unit_in(heading: str, quantity: str) -> UnitLabel | None:
    """Read the unit in a heading of a column; None if there is none.

    Parameters
    ----------
    quantity : str
        Of the column: velocity, displacement (a length), frequency, or empty for pure numbers.

    Raises
    ------
    UserError
        If a unit in brackets is not understood, or a unit is of another quantity.

    Examples
    --------
    >>> unit_in("Realteil [µm/s eff]", "velocity").amplitude.name
    'rms'
    >>> unit_in("Frequenz, kHz", "frequency").factor, unit_in("x_mm", "displacement").factor
    (1000.0, 0.001)
    >>> unit_in("v_rms", "velocity").amplitude.name
    'rms'
    >>> unit_in("Realteil Kanal 1", "velocity")
    """
    bracket = BRACKETS.search(heading)
    if bracket and bracket["unit"] not in NONE:
        if measure := _measure_alone(bracket["unit"], quantity):
            return measure
        return of_quantity(read_unit(bracket["unit"]), quantity)
    if bracket and quantity:
        raise UnitNotUnderstoodError(
            f"the unit {bracket['unit']!r} is none of a {_shown(quantity)}"
        )
    return None if bracket else _after_a_sign(heading, quantity)


def _after_a_sign(heading: str, quantity: str) -> UnitLabel | None:
    """Read the longest end of a heading that is a unit, or a measure of amplitudes."""
    for sign in re.finditer(r"[,;/_\s]+", heading):
        rest = heading[sign.end() :]
        if measure := _measure_alone(rest, quantity):
            return measure
        for text in _spellings(rest):
            try:
                label = read_unit(text)
            except UnitNotUnderstoodError:
                continue
            if len(rest) > 1 or label.quantity == quantity:  # v_m, f_s, Richtung X: a letter
                return of_quantity(label, quantity)
    return None


def _measure_alone(text: str, quantity: str) -> UnitLabel | None:
    """Read a measure of velocities' amplitudes without a unit, as ``rms``; its factor is 0."""
    if quantity != "velocity":
        return None
    with suppress(UnitNotUnderstoodError):
        label = read_unit(f"m/s {text.replace('_', ' ')}")
        if label.amplitude and label.factor == 1.0 and label.quantity == quantity:
            plain = label.form is SpectralForm.linear and not label.reference
            return replace(label, text=text, factor=0.0) if plain else None
    return None


def _spellings(text: str) -> Sequence[str]:
    """Write the underscores of ``mm_per_s``, ``mm_s`` and ``mm_s_rms`` as signs of units."""
    text = re.sub(r"(?i)\bkhz\b", "kHz", text.strip())
    per = re.sub(r"_per_", "/", text)
    over = re.sub(r"(?<=[^\W_])_(?=s(2?)(_|\b))", "/", per)
    return list(dict.fromkeys(t.replace("_", " ") for t in (text, over)))


def of_quantity(label: UnitLabel, quantity: str) -> UnitLabel:
    """Refuse a unit of another quantity, or that is no plain one of it."""
    plain = label.form is SpectralForm.linear and not label.reference and not label.product
    if label.quantity != quantity or not plain or (label.amplitude and quantity != "velocity"):
        shown = SHOWN.get(label.quantity, label.quantity)
        raise UserError(f"the unit {label.text!r} ({shown}) is none of a {_shown(quantity)}")
    return label


def _shown(quantity: str) -> str:
    return SHOWN.get(quantity, quantity)
