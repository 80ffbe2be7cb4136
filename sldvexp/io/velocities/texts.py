"""Free text in files of velocities, as comments and strings, against what values are read as.

A contradiction of what the program would take, or of a heading, is a question; a setting that
somebody chose wins, and a sentence says so.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.io.questions import Questions
from sldvexp.io.statements import Known, distinct, shown, statement_in
from sldvexp.io.velocities.headings import HeadingUnits
from sldvexp.io.velocities.table import UNSTATED_LENGTH, UNSTATED_VELOCITY, FileLayout
from sldvexp.lazy import xarray as xr
from sldvexp.unit_labels import Amplitude, same_unit
from sldvexp.units import LengthUnit, VelocityUnit

#: Attributes of a run that say how it was imported, and those that are compared elsewhere.
OWN = ("import_", "findings", "units")
#: Texts of an array that are looked at, more are names.
MOST_TEXTS = 20


def texts_of_arrays(
    found: Mapping[str, NDArray], names: Mapping[str, str]
) -> Iterator[tuple[str, str]]:
    """List texts of a MATLAB file with the array's name, but those that `names` map to labels."""
    for name, array in found.items():
        if np.asarray(array).dtype.kind != "U" or names.get(name, name) in ("view", "point"):
            continue
        for text in np.ravel(array)[:MOST_TEXTS]:
            yield f", {name}", f"{name.replace('.', ' ')}: {text}"


def texts_of_attributes(data: xr.Dataset) -> Iterator[tuple[str, str]]:
    """List attributes of a group, its velocities and its positions, with where they stand."""
    parts = [n for n in ("velocity", "real", "imag", "position", "x") if n in data.variables]
    for where, attrs in (("", data.attrs), *((n, data[n].attrs) for n in parts)):
        for key, text in attrs.items():
            if isinstance(text, str) and not str(key).startswith(OWN):
                of = f" of {where}" if where else ""
                yield f", attribute {key}{of}", f"{key}: {text}"


def compare_texts(
    texts: Iterable[tuple[str, str]],
    unit: VelocityUnit | None,
    units: HeadingUnits,
    layout: FileLayout,
    path: Path,
    questions: Questions,
) -> tuple[str, ...]:
    """Ask where texts, each with its place, contradict what is read; tell where settings win.

    Parameters
    ----------
    units : HeadingUnits
        By headings or attributes; what they leave open is as set, or as nobody told.
    """
    known = Known(
        "velocity",
        units.velocity or UNSTATED_VELOCITY.value,
        layout.amplitude or units.amplitude or Amplitude.peak,
        units.length or (layout.length or UNSTATED_LENGTH).value,
        phase=layout.senses.get("phase"),
        positive=layout.senses.get("positive"),
    )
    given = {"unit": unit, "amplitude": layout.amplitude, "length_unit": layout.length}
    given["quantity"] = unit
    stated_there = {"unit": units.velocity and not unit, "amplitude": units.amplitude}
    stated_there["length_unit"] = units.length
    odd = []
    for place, text, setting, stated in _contradictions(texts, known):
        where, line = f"{path}{place}", f"{shown(text)} states {stated}"
        if setting in layout.senses:
            value = layout.senses[setting]
            odd.append(f"{where}: instrument.{setting}={value} wins, although {line}")
        elif (one := given[setting]) is not None:
            key = "unit" if setting == "quantity" else setting
            odd.append(f"{where}: instrument.{key}={one.name} wins, although {line}")
        else:
            message = (
                f"{where}: {line}, but {_remedy(setting, known, bool(stated_there.get(setting)))}"
            )
            questions.note(UserError(message), path, setting)
    return tuple(odd)


def _contradictions(
    texts: Iterable[tuple[str, str]], known: Known
) -> Iterator[tuple[str, str, str, str]]:
    """List place, text, setting and what is stated of contradictions, each of these once."""
    seen = set()
    for place, text in distinct(texts):
        for setting, stated in known.contradictions(statement_in(text)).items():
            if (setting, stated) not in seen:
                seen.add((setting, stated))
                yield place, text, setting, stated


def _remedy(setting: str, known: Known, by_heading: bool) -> str:
    """Say what values are read as, and which ways on there are."""
    if setting == "quantity":
        return (
            "velocities are needed; convert the values, or say instrument.unit if they are "
            "velocities"
        )
    if setting == "amplitude" and known.amplitude is not None:
        own = value = known.amplitude.name
    elif setting == "unit":
        own, value = _named(VelocityUnit, known.factor)
    else:
        own, value = _named(LengthUnit, known.length)
    if not by_heading:
        return f"would be read as {own}; say which with instrument.{setting}"
    confirm = f", or say instrument.{setting}={value} if that is it" if value else ""
    return f"the heading or attribute of the values {own}; correct the one that is wrong{confirm}"


def _named(kind: type[VelocityUnit] | type[LengthUnit], factor: float | None) -> tuple[str, str]:
    """Name a unit for a message, and as a setting has it, empty if it has it not."""
    for one in kind:
        if factor is not None and same_unit(one.value, factor):
            return one.name.replace("_per_", "/"), one.name
    return f"units of {factor:g} in SI", ""
