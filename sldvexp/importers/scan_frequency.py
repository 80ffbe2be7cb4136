"""Frequencies that lines above a table state, and which of them is that of its values.

A line tells it if nothing but a word for frequency, or nothing at all, stands before one number in
Hz, as ``Frequency: 195 Hz`` or ``Frequenz [Hz]: 195``, and a column's name if it has one, as
``Real @ 195 Hz [m/s]``. Every other number in Hz, as of ``Sample Freq.: 5.12 kHz``, is only named
in the question for the frequency: words that are not known here may make it anything.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field

from sldvexp.importers.scan_table import (
    DECIMAL,
    FREQUENCY,
    HERTZ,
    IN_BRACKETS,
    fields,
    hertz,
    is_angle,
    is_motion,
    number,
)

#: Words for a frequency; others may stand beside them.
WORDS = {
    *("frequency", "freq", "f", "frequenz", "fréquence", "frequence", "frecuencia", "frequenza"),
    *("frequência", "frequencia", "frequentie", "frekvens", "частота", "周波数", "频率", "頻率"),
    *("eigenfrequenz", "anregungsfrequenz"),
}
BESIDE = {
    *("of", "the", "at", "line", "selected", "current", "excitation", "value"),
    *("der", "linie", "de", "la", "bei", "in", "hz", "khz"),
}
#: A number with its unit behind it, or before it as in ``[Hz]: 195``.
STATED = re.compile(
    rf"{HERTZ.pattern}|(?<![^\W\d_])(?P<before>k?)Hz\b[\s\])}}\"]*[:=;,\s\"]*(?P<bare>{DECIMAL})"
    r"(?![\d.,]*\s*k?Hz\b)"
)
#: Another number of a range beside one, before it and behind it.
_TO = r"\s*(?:[-–—…~±,;\t/]|\.\.+|\+/-|to|bis|and|und|à|a|\s)\s*"
RANGE_BEFORE = re.compile(rf"\d{_TO}$")
#: The other end of a range that is surely one.
_DASH = r"\s*(?:-|–|—|…|\.\.+|to|bis)\s*"
FROM, UP_TO = (
    re.compile(rf"({DECIMAL}){_DASH}$"),
    re.compile(rf"{_DASH}({DECIMAL})(?!\S*\s*k?Hz\b)"),
)
RANGE_BEHIND = re.compile(rf"{_TO}{DECIMAL}")


@dataclass
class Stated:
    """Frequencies, Hz, that lines state.

    Parameters
    ----------
    own : list of float
        Those that lines say to be that of the values.
    other : list of float
        Those of unknown meaning.
    doubtful : bool
        Whether a line for the values' frequency has several numbers.
    """

    own: list[float] = field(default_factory=list)
    other: list[float] = field(default_factory=list)
    doubtful: bool = False

    @property
    def all(self) -> list[float]:
        """Every number, once."""
        return list(dict.fromkeys([*self.own, *self.other]))

    @property
    def one(self) -> float | None:
        """The one frequency of the values; None if none or several may be it."""
        return self.own[0] if len(set(self.own)) == 1 and not self.doubtful else None


def stated_in(lines: Sequence[str], delimiter: str | None = None) -> Stated:
    """Find the frequencies that lines state.

    Examples
    --------
    >>> stated_in(["Sample Freq.: 5.12 kHz", "Frequenz [Hz]: 195.0"])
    Stated(own=[195.0], other=[5120.0], doubtful=False)
    >>> stated_in(["Band: 190 - 200 Hz"]).one
    """
    found = Stated()
    for line in lines:
        _read(line, delimiter, found)
    return found


def _read(line: str, delimiter: str | None, found: Stated) -> None:
    """Add the frequencies of one line."""
    matches = list(STATED.finditer(line))
    if not matches:
        return
    values = [_hertz(m) for m in matches]
    if len(set(values)) == 1 and _of_columns(fields(line, delimiter)):
        found.own.append(values[0])
        return
    behind, of_values = 0, False
    for k, (match, value) in enumerate(zip(matches, values, strict=True)):
        key = line[behind : match.start()]
        starts = k == 0 or re.search(r"[^\W\d_].*[:=\t;]", key) is not None
        many = RANGE_BEFORE.search(line[: match.start()]) if match["number"] else None
        many = many or RANGE_BEHIND.match(line, match.end())
        of_values = _says_frequency(key, line if len(matches) == 1 else "") if starts else of_values
        to = found.own if of_values else found.other
        ends = [*_other_end(line, match), value]
        to += ends if match["number"] else ends[::-1]
        differs = not starts and value != values[k - 1]
        found.doubtful |= of_values and (many is not None or differs)
        behind = match.end()


def _other_end(line: str, match: re.Match[str]) -> list[float]:
    """Find the other end of a range whose unit stands at one of them, for a message."""
    unit = 1000.0 if match["kilo"] or match["before"] else 1.0
    begin, end = FROM.search(line[: match.start()]), UP_TO.match(line, match.end())
    other = begin if match["number"] else end
    return [number(other[1]) * unit] if other else []


def _hertz(match: re.Match[str]) -> float:
    """Convert a match of `STATED` to Hz."""
    if match["number"]:
        return hertz(match)
    return number(match["bare"]) * (1000.0 if match["before"] else 1.0)


def _says_frequency(key: str, alone: str) -> bool:
    """Tell whether the text before a number names a frequency and nothing else.

    Without any text before it, the number must be `alone` in its line.
    """
    pieces = [p for p in re.split(r"[\t;|]", key) if re.search(r"[^\W\d_]", p)]
    if not pieces:
        return bool(alone) and not re.search(r"[^\W\d_]", STATED.sub("", alone))
    words = re.findall(r"[^\W\d_]+", pieces[-1].lower())
    return bool(WORDS & set(words)) and set(words) <= WORDS | BESIDE


def _of_columns(cells: Sequence[str]) -> bool:
    """Tell whether frequencies stand in the names of columns, or alone in each cell."""
    with_it = [cell for cell in cells if HERTZ.search(cell)]
    units = [IN_BRACKETS.search(FREQUENCY.sub("", cell)) for cell in with_it]
    named = [u is not None and (is_motion(u["unit"]) or is_angle(u["unit"])) for u in units]
    bare = [not re.search(r"\w", FREQUENCY.sub("", cell)) for cell in with_it]
    return bool(with_it) and (
        all(named) or (all(bare) and not any(re.search(r"\w", HERTZ.sub("", c)) for c in cells))
    )
