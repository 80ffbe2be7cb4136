"""Findings on a text table of points: what it lacks, what is left out, what settings win over."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np

from sldvexp.dataset import Finding, Severity
from sldvexp.importers.head_lines import HeadLines
from sldvexp.importers.pointwise import PointwiseImport
from sldvexp.importers.questions import ViewQuestions
from sldvexp.importers.scan_table import ScanTable, label_of_values, meaning, motion_of
from sldvexp.io.statements import Known
from sldvexp.typing import IntArray
from sldvexp.unit_labels import same_unit

#: Beyond such point numbers gaps mean nothing, as they are names then.
MOST_NUMBERS = 10**7


def absent_numbers(name: str, roles: dict[str, int], node: IntArray) -> list[Finding]:
    """Tell which point numbers there are not, of which a file may have lost the rows."""
    if "index" not in roles or node[-1] - node[0] > MOST_NUMBERS:
        return []
    absent = np.setdiff1d(np.arange(node[0], node[-1] + 1), node)
    if not len(absent):
        return []
    shown = ", ".join(str(n) for n in absent[:5]) + (" and more" if len(absent) > 5 else "")
    text = (
        f"the table of view {name} has no rows for {len(absent)} of the point numbers {node[0]} to "
        f"{node[-1]}: {shown}"
    )
    size = float(len(absent))
    return [Finding("missing_rows", f"view {name}", text, Severity.note, size=size, views=(name,))]


#: Different words in a column that may be a point's status; of more, it is a remark.
FEW_WORDS = range(2, 7)


def left_out(
    columns: Mapping[str, int], name: str, table: ScanTable, roles: dict[str, int]
) -> list[Finding]:
    """Tell which columns `instrument.columns` leaves out, and if one may say what is valid."""
    others = [i for i in range(table.values.shape[1]) if i not in roles.values()]
    if not columns or not others:
        return []
    named = f"{table.path}: instrument.columns leaves out {table.listed(others)}"
    few = {i: sorted(set(table.words[i])) for i in others if i in table.words}
    few = {i: words for i, words in few.items() if len(words) in FEW_WORDS}
    if not few or "status" in roles:
        return [Finding("left_out", f"view {name}", named, Severity.note, views=(name,))]
    column, words = next(iter(few.items()))
    text = (
        f"{named}; column {table.place[column]} is {', '.join(words)}: if that tells which values "
        "are good, points of bad ones are used"
    )
    remedy = f"instrument.columns.status={table.place[column]}"
    return [
        Finding("left_out", f"view {name}", text, Severity.doubtful, remedy=remedy, views=(name,))
    ]


def overruled(
    settings: PointwiseImport, name: str, table: ScanTable, roles: dict[str, int]
) -> list[Finding]:
    """Tell where settings win over labels that are understood."""
    text, length = label_of_values(table, roles), table.units[roles["x"]]
    values, places = meaning(text), meaning(length)
    if values is not None and not values.is_motion:
        values = None
    differs = {
        ("quantity", text): values is not None
        and settings.quantity is not None
        and settings.quantity.name != values.quantity,
        ("unit", text): values is not None
        and settings.unit is not None
        and not same_unit(values.factor, settings.unit.value),
        ("amplitude", text): values is not None
        and None not in (settings.amplitude, values.amplitude)
        and settings.amplitude is not values.amplitude,
        ("length_unit", length): places is not None
        and settings.length_unit is not None
        and places.quantity == "displacement"
        and not same_unit(places.factor, settings.length_unit.value),
    }
    return [
        Finding(
            "unit",
            f"view {name}",
            f"{table.path}: {settings.key(setting)}={getattr(settings, setting).name} wins, "
            f"although the file says {label}",
            views=(name,),
        )
        for (setting, label), so in differs.items()
        if so
    ]


def contradicted_lines(
    settings: PointwiseImport,
    table: ScanTable,
    roles: dict[str, int],
    length: float | None,
    questions: ViewQuestions,
) -> list[str]:
    """Compare lines that are no rows with what values are read as; tell where settings win."""
    text = label_of_values(table, roles)
    label = motion_of(table, text)
    phase = meaning(table.units[roles["phase"]]) if "phase" in roles else None
    amplitude = settings.amplitude or (label.amplitude if label else None)
    quantity = settings.quantity.name if settings.quantity else label.quantity if label else None
    known = Known(
        quantity,
        settings.unit.value if settings.unit else label.factor if label else None,
        None if label is not None and label.reference else amplitude,
        length,
        None if phase is None else "radian" if phase.factor == 1.0 else "degree",
        settings.phase.name if settings.phase else None,
        settings.positive.name if settings.positive else None,
    )
    by = dict.fromkeys(("quantity", "unit", "amplitude"), f"the column of values says {text}")
    by["length_unit"] = f"the columns of coordinates say {table.units[roles['x']]}"
    by["angle"] = f"the column of phases says {table.units[roles.get('phase', 0)]}"
    lines = HeadLines(settings, str(table.path), known, by)
    places = (partial("{}, line {}".format, table.path, i) for i, _ in table.said)
    lines.compare(zip(places, (line for _, line in table.said), strict=True), questions)
    return lines.odd
