"""The table of runs in order of merit on the terminal, and what is first in it."""

from __future__ import annotations

import io

import numpy as np
import pytest
import xarray as xr
from rich.console import Console

from sldvexp.sweep import ranking
from sldvexp.sweep.collect import headlines

KEYS = ["reconstruction", "reconstruction.rank_tolerance"]
BY = "examined.truth.relative_error"


def table(by=BY):
    """Four runs as `collect` makes them; the last one failed."""
    numbers = {name: 9.4721e-05 for name, _ in ranking.FIELD_COLUMNS.values()} | {
        "field.dof": 18711.0
    }
    values = np.array([3e-05, 1.2345e-05, 2e-05, np.nan])
    made = {n: ("run", np.full(4, v)) for n, v in numbers.items()} | {by: ("run", values)}
    made |= {
        "state": ("run", ["done", "done", "done", "failed"]),
        "reason": ("run", ["", "", "", "the views do not determine the velocity"]),
        "seconds": ("run", np.full(4, 1.25)),
    }
    coords = {
        KEYS[0]: ("run", ["absolute", "relative", "dissertation", "contravariant"]),
        KEYS[1]: ("run", [1e-05, 1e-05, 1e-05, 1e-05]),
        "folder": ("run", list("abcd")),
    }
    return xr.Dataset(made, coords)


def printed(width, by=BY):
    console = Console(width=width, file=io.StringIO())
    rows = ranking.rows(table(by), KEYS, by)
    console.print(ranking.terminal_table(rows, KEYS, by, "", width))
    return console.file.getvalue()


@pytest.mark.parametrize("width", [80, 132])
def test_numbers_and_keys_are_whole_at_any_width(width):
    told = printed(width)
    assert max(map(len, told.splitlines())) <= width
    for whole in ("dissertation", "contravariant", "1e-05", "1.234e-05", "rank_tolerance"):
        assert whole in told
    words = " ".join(told.replace("│", " ").replace("┃", " ").split())
    assert "relative_error" in words.partition(" first ")[2]
    shown = sum(title in words.partition("more column")[0] for title in ("seconds", "SSE", "cond"))
    assert ("more column" in words) == (shown < 3)
    assert "in sweep.csv: " in words if shown < 3 else True


def test_at_80_columns_some_are_left_out():
    assert "more columns in sweep.csv: " in printed(80)
    assert "18711" in printed(200)  # a count in full
    assert "more column" not in printed(200)


@pytest.mark.parametrize(
    ("by", "order", "said"),
    [
        (BY, ["relative", "dissertation", "absolute", "contravariant"], "the smallest first"),
        ("point.rcond", ["absolute", "dissertation", "relative", "contravariant"], "the largest"),
        ("point.efficiency", ["absolute", "dissertation", "relative", "contravariant"], "largest"),
    ],
)
def test_the_best_is_first(by, order, said):
    assert [row[KEYS[0]] for row in ranking.rows(table(by), KEYS, by)] == order
    assert said in printed(132, by)


def test_pooled_headlines_have_the_units_of_what_they_are_pooled_from():
    attrs = {"residual_std": 1e-5, "sse": 1e-9, "cond": 40.0}
    field = xr.Dataset(
        {
            "residual_std": ("equation", [1e-5], {"units": "m/s", "long_name": "of it"}),
            "sse": ("equation", [1e-9], {"units": "m2/s2"}),
        },
        attrs=attrs,
    )
    found = headlines({"field": field, "compare/relative": field})
    assert {n: found[f"field.{n}"].attrs["units"] for n in attrs} == {
        "residual_std": "m/s",
        "sse": "m2/s2",
        "cond": "1",
    }
    assert found["field.residual_std"].item() == 1e-5
    assert ranking.units(xr.Dataset(found), "field.residual_std") == "m/s"
    assert ranking.units(xr.Dataset(found), "field.cond") == ""
