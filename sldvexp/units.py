"""Units of length, angle and velocity: the one place where numbers become SI, and come back."""

from __future__ import annotations

import math
from enum import Enum
from typing import TypeVar

from sldvexp.errors import UserError, nearest


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


Unit = TypeVar("Unit", LengthUnit, AngleUnit)


def unit_named(kind: type[Unit], name: str, where: str) -> Unit:
    """Find the unit of that name, in any case of letters.

    Parameters
    ----------
    where : str
        What stated it, for the message.

    Raises
    ------
    UserError
        If there is no such unit; lists the valid ones.
    """
    try:
        return kind[name.strip().lower()]
    except KeyError:
        raise UserError(
            f"{where}: unknown unit {name!r}; {nearest(name, kind.__members__)}"
        ) from None


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
