"""Tables whose rows are read at once: the cells and numbers that reading them one by one gives."""

from __future__ import annotations

import random

import numpy as np
import pandas as pd
import pytest

from sldvexp.errors import UserError
from sldvexp.io import read_table, tables

ODD = (
    "", "-", "+", "nan", "inf", "1e5", "-1.5E-3", ".5", "5.", "-.5", "+3", "--1", "1-", "1.2.3",
    "abc", "-0", "0x1", "1_0", "00012.5", ".", "0.1234567890123456789", "9007199254740993",
    "Infinity", "-iNF", "1e999", "***", "NULL", "True", "FALSE", "1e", "1d5", "1" * 5000,
    "0." + 400 * "0" + "1", "4.9e-324", "2.2250738585072011e-308", "+nan", "<NA>", "1f", "\x7f",
)  # fmt: skip


def one_by_one(cell):
    try:
        return np.nan if "_" in cell or "infinity" in cell.lower() else float(cell)
    except ValueError:
        return np.nan


@pytest.mark.parametrize("rows", [1, 9000, pytest.param(40_000, marks=pytest.mark.whole)])
def test_cells_and_numbers_are_those_of_the_text(tmp_path, rows):
    """To the last bit, in columns of numbers alone and in those with anything else."""
    draw = random.Random(1)
    kinds = (
        lambda: f"{draw.uniform(-9, 9):.{draw.randrange(14)}f}",
        lambda: repr(draw.gauss(0, 1e3)),
        lambda: f"{draw.gauss(0, 1):.6e}",
        lambda: str(draw.randrange(10 ** draw.randrange(1, 19))),
        lambda: draw.choice(ODD),
    )
    cells = [[kinds[0](), kinds[3](), draw.choice(kinds)()] for _ in range(rows)]
    path = tmp_path / "rows.csv"
    path.write_text("a,b,c\n" + "".join(",".join(row) + "\n" for row in cells))
    table = read_table(path)
    assert list(table.rows) == [tuple(row) for row in cells]
    for k, name in enumerate("abc"):
        column = [row[k] for row in cells]
        assert table.column(name) == column
        expected = np.array([one_by_one(cell) for cell in column])
        found = table.floats([name])[:, 0]
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(np.signbit(found), np.signbit(expected))


@pytest.mark.parametrize("others", [["-0.1", "1e-7"], ["", "1"], []])
@pytest.mark.parametrize("cell", ODD)
def test_an_odd_cell_is_the_same_whatever_else_its_column_has(tmp_path, cell, others):
    path, cells = tmp_path / "rows.csv", [cell, *others, cell]
    path.write_text("a,b\n" + "".join(f"1,{own}\n" for own in cells))
    table = read_table(path)
    assert isinstance(table.rows, tables.EvenRows)
    found, expected = table.floats(["b", "a"]), np.array([one_by_one(own) for own in cells])
    np.testing.assert_array_equal(found, np.stack([expected, np.ones(len(cells))], axis=1))
    np.testing.assert_array_equal(np.signbit(found[:, 0]), np.signbit(expected))


@pytest.mark.parametrize(
    "text", ["a\n1\n2\t3\n", "a,b\n1\n2,3,4\n", "a,b\n1,2\n3\n", "a,b\n1,2,3\n"]
)
def test_rows_of_other_lengths_are_not_read_at_once(tmp_path, text):
    path = tmp_path / "rows.csv"
    path.write_text(text)
    with pytest.raises(UserError, match="values under"):
        read_table(path).floats(["a"])


@pytest.mark.parametrize("number", ["1.5", "abc"])
def test_labels_and_numbers_are_read_at_once(tmp_path, monkeypatch, number):
    """Labels are text, whatever numbers or gaps they look like, and come in the file's order."""
    names = ["007", "7", "NA", "b", "", "NULL", "7", "True", "b", "1e3", "nan", "007"]
    rows = "".join(f"1,{own},{own}x,{number},\n" for own in names)
    path = tmp_path / "rows.csv"
    path.write_text(f"b,a,c,d,e\n{rows}")
    table, calls, read_csv = read_table(path), [], pd.read_csv

    def counted(*args, **kwargs):
        calls.append(kwargs)
        return read_csv(*args, **kwargs)

    monkeypatch.setattr(pd, "read_csv", counted)
    labels, values = table.labels_and_floats(["c", "a"], ["e", "b", "d"])
    assert len(calls) == 1 or number == "abc"
    for found, expected in zip(labels, ([own + "x" for own in names], names), strict=True):
        assert found.texts == list(dict.fromkeys(expected))
        assert [found.texts[k] for k in found.which] == expected
    expected = [np.nan, 1.0, one_by_one(number)]
    np.testing.assert_array_equal(values, np.tile(expected, (len(names), 1)))


def test_lines_that_end_as_in_dos_are_read_at_once(tmp_path):
    path = tmp_path / "rows.csv"
    path.write_bytes(b"a,b\r\n1,2\r\n3,4\r\n")
    table = read_table(path)
    assert isinstance(table.rows, tables.EvenRows)
    assert list(table.rows) == [("1", "2"), ("3", "4")]
    assert table.where(1) == f"{path}, line 3"
