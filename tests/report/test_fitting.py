"""Tables on narrow terminals."""

from __future__ import annotations

import io

import pytest
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from sldvexp.report import fitted

QUANTITY = "truth: examined/truth/relative_error[component=z]"


def printed(table, width):
    console = Console(width=width, file=io.StringIO())
    console.print(table)
    return console.file.getvalue().splitlines()


def expected():
    table = Table(title="Expected")
    for column in ("quantity", "source"):
        table.add_column(column)
    for column in ("computed", "tolerance", "met"):
        table.add_column(column, no_wrap=True)
    table.add_row(escape(QUANTITY), "Section 5.4", "-1.8153e-05", "0.0024", "[green]yes[/]")
    return table


@pytest.mark.parametrize("width", [60, 80, 132])
def test_numbers_and_parts_of_names_are_never_broken(width):
    lines = printed(fitted(expected(), width), width)
    assert max(map(len, lines)) <= width
    told = "\n".join(lines)
    for whole in ("-1.8153e-05", "0.0024", "tolerance", "yes", "relative_error", "[component=z]"):
        assert whole in told
    assert ("Section 5.4" in told) or ("Section" in told and "5.4" in told)
    assert (QUANTITY in told) == (width == 132)


def test_columns_at_the_right_are_left_out_and_counted():
    table = Table("kept", title="Runs")
    for i in range(9):
        table.add_column(f"number.{i}", no_wrap=True)
    table.add_column("state")
    table.add_row("a", *["9.472e-05"] * 9, "failed: for a reason of many words")
    lines = printed(fitted(table, 60, {"kept", "state"}, "sweep.csv"), 60)
    assert max(map(len, lines)) <= 60
    told = " ".join(" ".join(lines).split())
    assert told.count("9.472e-05") == 3
    assert "6 more columns in sweep.csv: number.3; number.4" in told
    assert "state" in told


def test_a_table_that_fits_is_as_it_was():
    assert printed(fitted(expected(), 132), 132)[1:] == printed(expected(), 132)[1:]


def test_a_unit_is_no_name_with_parts():
    table = Table("r.m.s. error, mm/s")
    table.add_row("0.106")
    assert "mm/s" in "".join(printed(fitted(table, 21), 21))
