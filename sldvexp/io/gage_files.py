r"""Strains that gages showed, as CSV: one line a gage and frequency, with units in the header.

::

    gage,frequency_Hz,amplitude_microstrain,phase_deg,std_microstrain

Instead of amplitude and phase there may be ``real`` and ``imag``, and the standard uncertainty of
each part may be left out. Units stand behind the name, as ``amplitude_um_per_m`` or in brackets, as
``amplitude [µm/m rms]``; strains must state one, of frequencies it is Hz without. Amplitudes are
peak ones unless the unit says otherwise, and phases those of ``exp(+i omega t)`` to the reference
channel of the images.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sldvexp.errors import UserError, nearest
from sldvexp.io.tables import MISSING, TextTable, number, read_table
from sldvexp.typing import Array, ComplexArray
from sldvexp.unit_labels import Amplitude, read_unit, without_amplitude
from sldvexp.units import AngleUnit, StrainUnit, unit_named

NAMES = ("gage", "frequency", "amplitude", "phase", "real", "imag", "std")
#: A column's name, and the unit behind it.
HEADING = re.compile(rf"({'|'.join(NAMES)})(?:[\s_,]+(.*)|\s*[\[({{](.*)[\])}}])?", re.I)
NEEDED = (
    "needed are gage, frequency and either amplitude_U, phase_deg or real_U, imag_U with U one of "
    f"{', '.join(StrainUnit.__members__)}, um_per_m, m_per_m"
)
#: Lengths over lengths, and other spellings.
SPELLINGS = {
    **dict.fromkeys(("m/m", "mm/mm", "in/in", "ε"), StrainUnit.strain),
    "%": StrainUnit.percent,
    **dict.fromkeys(("mm/m", "mε"), StrainUnit.millistrain),
    **dict.fromkeys(("um/m", "ustrain", "ue", "uε", "uin/in", "ustr"), StrainUnit.microstrain),
    "nm/m": StrainUnit.nanostrain,
}
#: Strain beyond which a unit is taken for wrong: gages that vibrate so much soon break.
LARGEST = 0.02


@dataclass(frozen=True, eq=False)
class GageTable:
    """Strains that gages showed.

    Parameters
    ----------
    path : Path
    gage : list of str, one a row
    frequency : ndarray, shape (row,), Hz
    strain : ndarray of complex, shape (row,)
        Peak, NaN where the file has no number.
    std : ndarray, shape (row,)
        Standard uncertainty of each part, 0 where the file has none.
    has_std : bool
    ignored : list of str
        Columns of other names.
    """

    path: Path
    gage: list[str]
    frequency: Array
    strain: ComplexArray
    std: Array
    has_std: bool
    ignored: list[str]

    def __repr__(self) -> str:
        return f"<GageTable of {len(self.gage)} strains: {self.path}>"


def read_gages(path: Path) -> GageTable:
    r"""Read a file of strains that gages showed.

    Raises
    ------
    UserError
        If the file is missing, is no such table, lacks a column or a unit, a unit is none of its
        quantity, a number is none, or a gage has two of one frequency.

    Examples
    --------
    >>> import tempfile
    >>> path = Path(tempfile.mkdtemp(), "gages.csv")
    >>> _ = path.write_text("gage;frequency;real [µm/m];imag [µm/m]\na;197,0;1,5;-2\n")
    >>> found = read_gages(path)
    >>> found.gage, found.frequency.tolist(), (1e6 * found.strain).round(9).tolist()
    (['a'], [197.0], [(1.5-2j)])
    """
    table = read_table(path)
    columns = _columns(table)
    if not table.rows:
        raise UserError(f"{path}: has a header but no strains")
    gage, frequency = table.column(columns["gage"][0]), _frequency(table, *columns["frequency"])
    _require_distinct(table, gage, frequency)
    factors, measure = _strain_factors(table, columns)
    value = {name: _cells(table, columns[name][0]) * factors[name] for name in factors}
    if "amplitude" in columns:
        for row in np.flatnonzero(value["amplitude"] < 0)[:1]:
            raise UserError(f"{table.where(row)}: the amplitude must be zero or more")
        heading, text = columns["phase"]
        unit = unit_named(AngleUnit, text, f"{path}: {heading}")
        strain = value["amplitude"] * np.exp(1j * unit.value * _cells(table, heading))
    else:
        strain = value["real"] + 1j * value["imag"]
    for row in np.flatnonzero(np.abs(strain) > LARGEST)[:1]:
        raise UserError(
            f"{table.where(row)}: a strain of {abs(strain[row]):.3g} is more than a gage shows: is "
            f"its unit that of the header?"
        )
    std = value.get("std", np.zeros(len(strain)))
    for row in np.flatnonzero(~(std >= 0) & ~np.isnan(strain))[:1]:
        raise UserError(f"{table.where(row)}: std must be a number of zero or more")
    known = {heading for heading, _ in columns.values()}
    ignored = [heading for heading in table.header if heading not in known]
    peak, uncertain = strain * measure, std * measure
    return GageTable(path, gage, frequency, peak, uncertain, "std" in columns, ignored)


def _columns(table: TextTable) -> Mapping[str, tuple[str, str]]:
    """Find the heading of every column by its name, with the unit that it states."""
    found: dict[str, tuple[str, str]] = {}
    for heading in table.header:
        if match := HEADING.fullmatch(heading):
            name = match[1].lower()
            if name in found:
                raise UserError(f"{table.path}: has two columns {name}")
            found[name] = heading, (match[2] or match[3] or "").strip(" [](){}")
    parts = ("amplitude", "phase") if {"amplitude", "phase"} & found.keys() else ("real", "imag")
    for name in ("gage", "frequency", *parts):
        if name not in found:
            raise UserError(f"{table.path}: the column {name} is missing; {NEEDED}")
    if {"amplitude", "real"} <= found.keys():
        raise UserError(f"{table.path}: has amplitude and real, which must not both be there")
    return found


def _strain_factors(
    table: TextTable, columns: Mapping[str, tuple[str, str]]
) -> tuple[dict[str, float], float]:
    """Find the unit of every column of strains, and the peak of a sine over what they measure."""
    factors, measures = {}, {}
    for name in ("amplitude", "real", "imag", "std"):
        if name in columns:
            unit, measures[name] = _strain_unit(
                f"{table.path}: {columns[name][0]}", columns[name][1]
            )
            factors[name] = unit.value
    stated = {m for m in measures.values() if m is not None}
    values = {m for name, m in measures.items() if name != "std"}
    if len(stated) > 1 or len(values) > 1:
        raise UserError(f"{table.path}: the columns of strain mix peak, rms and peak-to-peak")
    return factors, max((m.value for m in stated), default=1.0)


def _strain_unit(where: str, text: str) -> tuple[StrainUnit, Amplitude | None]:
    """Read a unit of strain, and which measure of the amplitude it names."""
    if not text:
        raise UserError(f"{where}: states no unit of strain, as microstrain or um/m")
    spelt = text.replace("_per_", "/").replace("_", " ")
    bare, measure = without_amplitude(spelt)
    plain = re.sub(r"\s+", "", bare).replace("μ", "u").replace("µ", "u").lower()
    unit = SPELLINGS.get(plain) or StrainUnit.__members__.get(plain.replace("micro-", "micro"))
    if unit is None:
        raise UserError(
            f"{where}: unknown unit of strain {text!r}; {nearest(plain, [*StrainUnit.__members__])}"
        )
    return unit, measure


def _frequency(table: TextTable, heading: str, text: str) -> Array:
    """Convert frequencies to Hz."""
    values = table.numbers([heading])[:, 0]
    for row in np.flatnonzero(values <= 0)[:1]:
        raise UserError(f"{table.where(row)}: the frequency must be positive")
    if not text:
        return values
    label = read_unit("kHz" if text.lower() == "khz" else text)
    if label.quantity != "frequency":
        raise UserError(f"{table.path}: {heading}: the unit {text!r} is none of a frequency")
    return values * label.factor


def _cells(table: TextTable, heading: str) -> Array:
    """Convert a column to numbers, NaN where a cell says that there is none."""

    def values() -> Iterator[float]:
        for row, cell in enumerate(table.column(heading)):
            absent = cell.lower() in MISSING
            yield np.nan if absent else number(cell, heading, table.where(row))

    return np.array(list(values()))


def _require_distinct(table: TextTable, gage: list[str], frequency: Array) -> None:
    """Complain about a row without a gage, and about the second of one frequency."""
    seen: dict[tuple[str, float], int] = {}
    for row, key in enumerate(zip(gage, frequency.tolist(), strict=True)):
        if not key[0]:
            raise UserError(f"{table.where(row)}: the gage has no name")
        if key in seen:
            raise UserError(
                f"{table.where(row)}: gage {key[0]} at {key[1]:g} Hz stands on line {seen[key]} "
                "already"
            )
        seen[key] = table.lines[1 + row]
