"""Checks against the truth of a virtual lab or a publication, and what else was examined."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from sldvexp.lazy import xarray as xr
from sldvexp.report.field_tables import strongest, truth_table
from sldvexp.report.html.blocks import HtmlTable, More, Section, Text
from sldvexp.report.html.page_data import Subject
from sldvexp.report.numbers import number
from sldvexp.report.terminal import published

#: Numbers of one check that a page shows; the dataset has all.
MOST_NUMBERS = 200


def section(run: Subject) -> Section | None:
    """Expectations met and missed, then every check's findings."""
    examined = run.below("examined")
    if "check" not in run.groups and not examined:
        return None
    blocks: list[Any] = []
    if "check" in run.groups:
        check = run.groups["check"]
        met, of = int(check["passed"].sum()), check.sizes["quantity"]
        told = f"{met} of {of} expectations are met."
        if met == of:
            told = f"All {of} expectations are met." if of > 1 else "The one expectation is met."
        blocks.append(Text(told, "good" if met == of else "warning"))
        blocks.append(replace(HtmlTable.from_table(published(check)), caption=""))
    for field in list(run.fields.values())[:1]:
        own = [g for g in examined.values() if "rms_bound" in g]
        blocks += [HtmlTable.from_table(truth_table(g, strongest(field))) for g in own]
    tables = [
        HtmlTable(["what", "where", "value", "unit"], list(_numbers(name, g)), name)
        for name, g in examined.items()
    ]
    if tables:
        blocks.append(More("What the checks found, number by number", tables))
    return Section("Checks", blocks)


def _numbers(name: str, group: xr.Dataset) -> Iterator[list[str]]:
    """A check's numbers by name, the first of many."""
    left = MOST_NUMBERS
    for variable in group.data_vars.values():
        told = str(variable.attrs.get("long_name", variable.name))
        for index in np.ndindex(*variable.shape):
            if not left:
                rest = sum(v.size for v in group.data_vars.values()) - MOST_NUMBERS
                yield [f"{rest} more", f"in run.nc, group examined/{name}", "", ""]
                return
            left -= 1
            at = zip(variable.dims, index, strict=True)
            where = ", ".join(
                f"{d} {_label(variable[d].values[i])}" if d in variable.coords else f"{d} {i}"
                for d, i in at
            )
            yield [
                told,
                where,
                _value(variable.values[index]),
                str(variable.attrs.get("units", "")),
            ]


def _label(label: object) -> str:
    return f"{label:.4g}" if isinstance(label, float | np.floating) else str(label)


def _value(value: Any) -> str:
    return (
        number(complex(value))
        if isinstance(value, complex | float | int | np.number)
        else str(value)
    )
