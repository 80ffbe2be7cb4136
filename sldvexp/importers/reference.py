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
from sldvexp.importers.questions import key_of_view
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
                f"has a reference in {unit.text}, a {unit.quantity}, but the one that is set is "
                f"in {self.unit.text}, a {self.unit.quantity}; give it in units of the file's with "
                "instrument.reference"
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


def ask_unit(
    key: str, setting: float | str, units: Mapping[str, ReferenceUnit]
) -> UserError | None:
    """Ask in which unit a bare number is if views have several; None if there is no question.

    Parameters
    ----------
    key : str
        Name of the setting.
    setting : float or str
        As `reference_of` reads it.
    units : mapping of str to ReferenceUnit
        Of each view whose functions are multiplied with it.
    """
    if reference_of(setting).unit is not None:
        return None
    known = {view: unit for view, unit in units.items() if unit.quantity}
    first = next(iter(known.values()), ReferenceUnit())
    others = {view: unit for view, unit in known.items() if not unit.is_same(first)}
    if not others:
        return None
    remedy = f"for example {key}='{setting} {first.text}'"
    for view, unit in others.items():
        if unit.quantity != first.quantity:
            own = f"{key_of_view(view, 'reference')}='{setting} {unit.text}'"
            remedy = f"of a view of another quantity for itself, for example {own}"
    return UserError(
        f"{key}: {setting} is a number without a unit, but references of the views are in "
        f"{_listed(units)}; say in which unit it is, {remedy}"
    )


def unknown_units(
    key: str, setting: float | str, units: Mapping[str, ReferenceUnit]
) -> list[Finding]:
    """Find views whose reference may be in another unit than the amplitude, or that of the others.

    A bare number is in the unit of the files, whichever that is, if they have one.
    """
    unknown = {view: unit for view, unit in units.items() if not unit.quantity}
    if not unknown:
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
            f"{key}={setting} was taken to be in it",
            remedy=f"{key}={reference.amount:g}" if one else "",
            views=tuple(unknown),
        )
    ]


def _listed(units: Mapping[str, ReferenceUnit]) -> str:
    """List units with the views that have them."""
    views: dict[str, list[str]] = {}
    for view, unit in units.items():
        views.setdefault(unit.text or "not stated", []).append(view)
    return ", ".join(f"{text} ({', '.join(names)})" for text, names in views.items())
