"""Units of length, angle and velocity: the one place where numbers become SI, and come back."""

from __future__ import annotations

import math
from contextlib import suppress
from enum import Enum
from typing import TypeVar

from sldvexp.errors import UserError, nearest
from sldvexp.unit_labels import SpectralForm, UnitNotUnderstoodError, read_unit


class LengthUnit(Enum):
    """Units in which a configuration or a file may state lengths; the value is one in m."""

    m = 1.0
    cm = 0.01
    mm = 0.001
    inch = 0.0254
    ft = 0.3048


class AngleUnit(Enum):
    """Units in which a configuration or a file may state angles; the value is one in rad."""

    rad = 1.0
    deg = math.pi / 180.0


class VelocityUnit(Enum):
    """Units in which a file may state velocities; the value is one of them in m/s."""

    m_per_s = 1.0
    mm_per_s = 1e-3
    um_per_s = 1e-6
    inch_per_s = 0.0254


class StrainUnit(Enum):
    """Units in which a file may state strains; the value is one of them as a pure number."""

    strain = 1.0
    percent = 1e-2
    millistrain = 1e-3
    microstrain = 1e-6
    nanostrain = 1e-9


#: Quantity of each kind of unit, as `sldvexp.unit_labels` names it.
QUANTITIES = {LengthUnit: "displacement", AngleUnit: "angle", VelocityUnit: "velocity"}

#: Distance that no beam of a scanning vibrometer is sent to, and no object of one is as large, m.
FARTHEST = 100.0

Unit = TypeVar("Unit", LengthUnit, AngleUnit, VelocityUnit)


def unit_named(kind: type[Unit], name: str, where: str) -> Unit:
    """Find the unit of that name, in any case of letters, or of another spelling of it.

    Parameters
    ----------
    where : str
        What stated it, for the message.

    Raises
    ------
    UserError
        If there is no such unit; lists the valid ones.

    Examples
    --------
    >>> unit_named(LengthUnit, "millimetres", "a.nc")
    <LengthUnit.mm: 0.001>
    """
    own = name.strip()
    for plain in (own.lower(), own.replace("/", "_per_")):
        if plain in kind.__members__:
            return kind[plain]
    with suppress(UnitNotUnderstoodError):
        label = read_unit(name)
        same = [unit for unit in kind if math.isclose(unit.value, label.factor, rel_tol=1e-9)]
        bare = label.amplitude is None and label.form is SpectralForm.linear
        if same and bare and not label.reference and label.quantity == QUANTITIES[kind]:
            return same[0]
    raise UserError(f"{where}: unknown unit {name!r}; {nearest(name, kind.__members__)}")


def beyond_belief(unit: LengthUnit, *lengths: float, most: float = FARTHEST) -> str:
    """Say that a length is one of another unit; empty if all can be.

    Parameters
    ----------
    most : float, m
        Above which a length is not believed.

    Examples
    --------
    >>> beyond_belief(LengthUnit.m, 40, -260)
    'is -260 m, which no scanning vibrometer measures: is the unit m right, or is it mm?'
    >>> beyond_belief(LengthUnit.mm, 40, -260)
    ''
    """
    far = max((x for x in lengths if math.isfinite(x)), key=abs, default=0.0)
    if abs(far) * unit.value <= most:
        return ""
    smaller = "mm" if unit is not LengthUnit.mm else "um"
    return (
        f"is {far:g} {unit.name}, which no scanning vibrometer measures: is the unit {unit.name} "
        f"right, or is it {smaller}?"
    )


def decimal_in(unit: LengthUnit | AngleUnit, value: float) -> str:
    """Find the shortest decimal of an SI value in `unit` that converts back to the same float.

    Short of subnormal numbers, a decimal of up to 15 digits comes back as it was written, and any
    number that was once read in `unit` comes back to the last bit of its SI value. Other SI values
    may have no decimal that hits them exactly (the last bit of an inch is up to 1.6 last bits of a
    metre); those come back to within one unit in the last place.
    """
    quotient = value / unit.value
    neighbours = (quotient, math.nextafter(quotient, math.inf), math.nextafter(quotient, -math.inf))
    for digits in (15, 16, 17):
        for candidate in neighbours:
            text = f"{candidate:.{digits}g}"
            if float(text) * unit.value == value:
                return text
    return repr(quotient)
