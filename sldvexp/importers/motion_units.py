"""Units of motion as programs write them: what is measured, and in which unit of length."""

from __future__ import annotations

import re
from typing import NamedTuple

from sldvexp.importers.pointwise import MotionUnit, Quantity

#: ``mm/s^2``, ``(m/s)/N``, ``[in/sec]``: a length and how often it is divided by a time.
UNIT = re.compile(
    r"[\s\[(]*(?P<length>nm|[uµμ]m|mm|cm|m|inch|in|ft|g)"
    r"(?P<time>\s*/\s*s(ec)?\s*(\^\s*2|\*\*\s*2|2|²|/\s*s(ec)?)?)?(?![a-zA-Z²^*])"
)
NAMES = {"in": "inch", "µm": "um", "μm": "um"}
SQUARED = re.compile(r"2|²|/.*/")


class Motion(NamedTuple):
    """What a unit is one of.

    Parameters
    ----------
    quantity : Quantity
    unit : MotionUnit
    rest : str
        What follows, as ``/N`` of a response function.
    """

    quantity: Quantity
    unit: MotionUnit
    rest: str


def motion_in_product(text: str) -> Motion | None:
    """The motion in a cross spectrum's unit, as ``(m/s)*N/Hz``; None unless one factor is one."""
    bare = re.sub(r"\s*/\s*Hz[\s\])]*$", "", text.strip()).replace("**", "^")
    factors = [factor.strip(" ()[]") for factor in re.split(r"[*·⋅×]", bare)]
    found = {motion for factor in factors if (motion := motion_of(factor))}
    others = [factor for factor in factors if not motion_of(factor)]
    return found.pop() if len(found) == 1 and "/" not in "".join(others) else None


def motion_of(text: str) -> Motion | None:
    """The motion that a unit is one of; None if it is none."""
    found = UNIT.match(text)
    if not found:
        return None
    unit = MotionUnit[NAMES.get(found["length"], found["length"])]
    time = found["time"] or ""
    if unit is MotionUnit.g:
        quantity = Quantity.acceleration
    elif not time:
        quantity = Quantity.displacement
    else:
        quantity = Quantity.acceleration if SQUARED.search(time) else Quantity.velocity
    return Motion(quantity, unit, text[found.end() :].strip(" )]"))
