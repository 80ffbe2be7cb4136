"""Data sets 164 and 1858: the units of a file, and the scale of its amplitudes."""

from __future__ import annotations

from dataclasses import dataclass

from sldvexp.io.uff.fortran import Lines
from sldvexp.io.uff.index import Entry
from sldvexp.io.uff.source import Source

#: What data set 1858 calls the scale of amplitudes.
HALF_PEAK, PEAK, RMS = 1, 2, 3


@dataclass(frozen=True)
class Units:
    """Data set 164.

    Parameters
    ----------
    name : str
    length : float
        One of the file's units of length in m.
    """

    name: str
    length: float


def read_units(source: Source, entries: list[Entry]) -> Units | None:
    """The file's units, None if it does not state them.

    Raises
    ------
    UserError
        If two data sets 164 contradict each other, or a factor is not a positive number.
    """
    found: Units | None = None
    for entry in (e for e in entries if e.kind == 164):
        lines = Lines(source, entry)
        head = lines.next("the code of the units")
        factor = lines.numbers("the factors of the units", 1, 25)[0]
        if not factor > 0:
            raise lines.wrong(f"the factor of lengths must be a positive number, not {factor:g}")
        units = Units(head[10:30].decode("utf-8", "replace").strip(), 1.0 / factor)
        if found is not None and found.length != units.length:
            raise lines.wrong(
                f"states one unit of length as {units.length:g} m, an earlier data set 164 as "
                f"{found.length:g} m; a file has one system of units"
            )
        found = units
    return found


def read_amplitude(source: Source, entries: list[Entry]) -> tuple[int, Entry] | None:
    """The scale of amplitudes and where it is stated; None if it is unknown.

    Raises
    ------
    UserError
        If functions of the file differ in it.
    """
    found: tuple[int, Entry] | None = None
    for entry in (e for e in entries if e.kind == 1858):
        lines = Lines(source, entry)
        lines.next("the record's number")
        scale = lines.integers("window, weighting and scale of the amplitudes", 3, 6)[2]
        if scale not in (0, HALF_PEAK, PEAK, RMS):
            raise lines.wrong(f"the scale of amplitudes must be 0, 1, 2 or 3, not {scale}")
        if scale and found and found[0] != scale:
            raise lines.wrong(
                f"states the scale {scale} of amplitudes, data set {found[1].number} the scale "
                f"{found[0]}; functions of different scales must come in different files"
            )
        if scale:
            found = (scale, entry)
    return found
