"""Reference of response functions: its amplitude, and the unit that a file's functions divide by.

A response function H is a motion per unit u of its reference, so that the motion of a reference of
amplitude A, a quantity with its own unit, is ``H A / u``. Assumed is that views whose functions
are multiplied with one number have one unit; where they have not, the number's unit is asked for.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

from sldvexp.dataset import Finding
from sldvexp.errors import UserError
from sldvexp.unit_labels import SpectralForm, UnitNotUnderstoodError, read_unit, same_unit

#: Number and unit of a setting, as ``2 N``.
AMOUNT = re.compile(r"\s*(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)\s*(.*?)\s*")


class ReferenceUnit(NamedTuple):
    """Unit of a reference.

    Parameters
    ----------
    text : str
        As somebody named it; empty if nobody did.
    quantity : str
        As `sldvexp.unit_labels` names it; empty if the unit is not known.
    factor : float
        One of it in SI.
    """

    text: str = ""
    quantity: str = ""
    factor: float = 1.0

    def is_same(self, other: ReferenceUnit) -> bool:
        """Tell whether two units are one, by their meaning, or by their text if they have none."""
        if not self.quantity or not other.quantity:
            return (self.quantity, self.text) == (other.quantity, other.text)
        return self.quantity == other.quantity and same_unit(self.factor, other.factor)


class Reference(NamedTuple):
    """Peak amplitude of the reference, as set.

    Parameters
    ----------
    amount : float
    unit : ReferenceUnit or None
        None of a bare number, which is in the file's unit.
    """

    amount: float
    unit: ReferenceUnit | None = None

    def per(self, unit: ReferenceUnit) -> float:
        """Give the amplitude in a file's unit; the amount itself if either is not known.

        Raises
        ------
        UserError
            If the file's reference is another quantity.
        """
        if self.unit is None or not unit.quantity:
            return self.amount
        if self.unit.quantity != unit.quantity:
            raise UserError(
                f"has a reference in {unit.text}, a {unit.quantity}, but instrument.reference is "
                f"in {self.unit.text}, a {self.unit.quantity}; give it in units of the file's"
            )
        return self.amount * self.unit.factor / unit.factor


def unit_of_reference(text: str) -> ReferenceUnit:
    """Understand the label of a reference's unit; one that is not understood has no quantity."""
    try:
        label = read_unit(text)
    except UnitNotUnderstoodError:
        return ReferenceUnit(text)
    if label.reference or label.form is not SpectralForm.linear or label.amplitude is not None:
        return ReferenceUnit(text)
    return ReferenceUnit(text, label.quantity, label.factor)


def reference_of(setting: float | str) -> Reference:
    """Read the setting: a number, or a number with its unit.

    Raises
    ------
    UserError
        If it is neither, or not above zero.
    """
    found = AMOUNT.fullmatch(str(setting))
    amount = float(found[1]) if found else 0.0
    if not found or not 0 < amount < float("inf"):
        raise UserError(f"must be a positive number, or one with its unit as 2 N, not {setting}")
    if not found[2]:
        return Reference(amount)
    unit = unit_of_reference(found[2])
    if not unit.quantity:
        raise UserError(f"has the unit {unit.text}, which is not known; write it as N, lbf or V")
    return Reference(amount, unit)


def ask_unit(setting: float | str | None, units: Mapping[str, ReferenceUnit]) -> UserError | None:
    """Ask in which unit a bare number is if views have several; None if there is no question.

    Parameters
    ----------
    setting : float or str, optional
        As `reference_of` reads it.
    units : mapping of str to ReferenceUnit
        Of each view whose functions have a reference.
    """
    if setting is None or reference_of(setting).unit is not None:
        return None
    known = [unit for unit in units.values() if unit.quantity]
    if all(unit.is_same(known[0]) for unit in known):
        return None
    return UserError(
        f"instrument.reference: {setting} is a number without a unit, but references of the views "
        f"are in {_listed(units)}; say in which unit it is, for example "
        f"instrument.reference='{setting} {known[0].text}'"
    )


def unknown_units(setting: float | str | None, units: Mapping[str, ReferenceUnit]) -> list[Finding]:
    """Find views whose reference may be in another unit than the amplitude, or that of the others.

    A bare number is in the unit of the files, whichever that is, if they have one.
    """
    unknown = {view: unit for view, unit in units.items() if not unit.quantity}
    if setting is None or not unknown:
        return []
    reference, first = reference_of(setting), next(iter(unknown.values()))
    one = all(unit.is_same(first) for unit in units.values())
    if one and reference.unit is None:
        return []
    return [
        Finding(
            "reference",
            f"view {', '.join(unknown)}",
            f"units of the references are {_listed(units)}; where that is not known, the number of "
            f"instrument.reference={setting} was taken to be in it",
            remedy=f"instrument.reference={reference.amount:g}" if one else "",
        )
    ]


def _listed(units: Mapping[str, ReferenceUnit]) -> str:
    """List units with the views that have them."""
    views: dict[str, list[str]] = {}
    for view, unit in units.items():
        views.setdefault(unit.text or "not stated", []).append(view)
    return ", ".join(f"{text} ({', '.join(names)})" for text, names in views.items())
