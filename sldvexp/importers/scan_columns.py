"""Tables with columns for each frequency, as tables with a row for each frequency."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sldvexp.importers.motion_units import motion_of
from sldvexp.importers.scan_table import (
    ANGLES,
    HERTZ,
    NUMBER,
    Table,
    fields,
    hertz,
    of_frequencies,
)

#: Lines above the table in which the columns' frequencies may stand.
HEADINGS = 4
VALUES = ("real", "imag", "magnitude", "phase")


def by_rows(table: Table, given: dict[str, int]) -> tuple[Table, dict[str, int]]:
    """A table whose columns of values have frequencies of their own, with these in rows.

    The frequencies stand above the columns, in a line of their own or in the columns' names.

    Parameters
    ----------
    table : Table
    given : dict of str to int
        Columns that the user named, counted from 1; those of values of one frequency, which the
        others have at the same places.

    Returns
    -------
    table : Table
        With a column ``frequency`` in Hz, or the same.
    roles : dict of str to int
        Of the new table's columns, counted from 1; `given` of the same table.

    Raises
    ------
    UserError
        If the columns of a frequency are not one value, two parts, or a magnitude and a phase.
    """
    named = table.checked(given)
    values = {role: i for role, i in named.items() if role in VALUES}
    roles = {r: i for r, i in named.items() if r not in values} if given else table.places()
    frequency = {} if "frequency" in roles else _frequencies(table, roles, bool(given))
    if len(set(frequency.values())) < 2 or not set(values.values()) <= set(frequency):
        return table, given
    groups = {f: [i for i, g in frequency.items() if g == f] for f in frequency.values()}
    if values:
        parts = _alike(table, groups, values, {frequency[i] for i in values.values()})
    else:
        parts = {f: _parts(table, f, columns) for f, columns in groups.items()}
    kinds = {f: [(role, table.units[i]) for role, i in p.items()] for f, p in parts.items()}
    first = next(iter(kinds))
    other = next((f for f in kinds if kinds[f] != kinds[first]), None)
    if other is not None:
        raise table.wrong(
            f"has the columns {table.listed(groups[first])} of {first:g} Hz but "
            f"{table.listed(groups[other])} of {other:g} Hz; all frequencies need the same columns "
            "in the same units"
        )
    return _stacked(table, roles, parts)


def _stacked(
    table: Table, roles: dict[str, int], parts: dict[float, dict[str, int]]
) -> tuple[Table, dict[str, int]]:
    """The rows of one frequency below those of another."""
    rows = len(table.values)
    index = roles.get("index")
    number = np.arange(1, rows + 1) if index is None else table.values[:, index]
    kept = [role for role in roles if role != "index"]
    names = ["index", *kept, "frequency", *next(iter(parts.values()))]
    blocks = [
        np.column_stack(
            [
                number,
                table.values[:, [roles[role] for role in kept]],
                np.full(rows, frequency),
                table.values[:, list(columns.values())],
            ]
        )
        for frequency, columns in parts.items()
    ]
    of_values = [[p[role] for p in parts.values()] for role in next(iter(parts.values()))]
    columns = [[] if index is None else [index], *([roles[role]] for role in kept), [], *of_values]
    units = [table.units[c[0]] if c else "" for c in columns]
    units[1 + len(kept)] = "Hz"
    long = replace(
        table,
        values=np.concatenate(blocks),
        line=table.line * len(blocks),
        names=names,
        units=units,
        place=[" ".join(str(i + 1) for i in c) or "heading" for c in columns],
    )
    return long, {role: i for i, role in enumerate(names, 1)}


def _parts(table: Table, frequency: float, columns: list[int]) -> dict[str, int]:
    """What the columns of one frequency are."""
    units = [table.units[i] for i in columns]
    angles = [unit.lower() in ANGLES for unit in units]
    if angles == [False]:
        return {"real": columns[0]}
    if angles == [False, True]:
        return {"magnitude": columns[0], "phase": columns[1]}
    if angles == [False, False] and units[0] == units[1] != "":
        return {"real": columns[0], "imag": columns[1]}
    raise table.wrong(
        f"the columns of {frequency:g} Hz are {table.listed(columns)}; needed is one, two in one "
        "unit (real and imaginary part), or a magnitude and a phase in deg or rad; say which, of "
        "one frequency, with instrument.columns={index: 1, x: 2, y: 3, z: 4, real: 5, imag: 6}"
    )


def _alike(
    table: Table,
    groups: dict[float, list[int]],
    values: dict[str, int],
    frequencies: set[float],
) -> dict[float, dict[str, int]]:
    """Columns of each frequency, at the places of the named ones among those of theirs."""
    if len(frequencies) > 1:
        wanted = table.listed(list(values.values()))
        raise table.wrong(f"instrument.columns names {wanted} of different frequencies")
    place = {role: groups[next(iter(frequencies))].index(i) for role, i in values.items()}
    for f, columns in groups.items():
        if len(columns) <= max(place.values()):
            raise table.wrong(
                f"has only the columns {table.listed(columns)} of {f:g} Hz, fewer than of the "
                "frequency whose columns instrument.columns names"
            )
    return {f: {r: columns[k] for r, k in place.items()} for f, columns in groups.items()}


def _frequencies(table: Table, roles: dict[str, int], named: bool) -> dict[int, float]:
    """Frequency in Hz of each column of values, by the nearest line above that has one for each.

    Where the user named the others, `named`, values need no unit.
    """
    columns = [
        i
        for i, unit in enumerate(table.units)
        if i not in roles.values() and (named or motion_of(unit) or unit.lower() in ANGLES)
    ]
    above = [line for line in table.before.splitlines() if line.strip()]
    for line in reversed(above[-HEADINGS:]):
        found = _above(fields(line, table.delimiter), columns, table.values.shape[1])
        if found:
            return found
    return {}


def _above(cells: list[str], columns: list[int], width: int) -> dict[int, float]:
    """The columns' frequencies in one line of cells; empty unless there is one for each.

    A cell with a frequency also is of the blank ones behind it, as where cells were joined.
    """
    if not columns or not columns[0] < len(cells) <= width:
        return {}
    bare = of_frequencies(cells)
    factor = 1000.0 if bare and any("khz" in cell.lower() for cell in cells) else 1.0
    found: dict[int, float] = {}
    last: float | None = None
    for i in columns:
        cell = cells[i] if i < len(cells) else ""
        stated = [hertz(m) for m in HERTZ.finditer(cell)]
        if bare and NUMBER.fullmatch(cell):
            stated = [factor * float(cell.replace(",", "."))]
        if len(stated) > 1 or (cell and not stated) or (not cell and last is None):
            return {}
        last = stated[0] if stated else last
        found[i] = last  # type: ignore[assignment]
    return found
