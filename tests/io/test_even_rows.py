"""Tables whose rows are read at once: the cells and numbers that reading them one by one gives."""

from __future__ import annotations

import random

import numpy as np
import pytest

from sldvexp.io import read_table, tables

ODD = (
    "", "-", "+", "nan", "inf", "1e5", "-1.5E-3", ".5", "5.", "-.5", "+3", "--1", "1-", "1.2.3",
    "abc", "-0", "0x1", "1_0", "00012.5", ".", "0.1234567890123456789", "9007199254740993",
    "Infinity", "-iNF", "1e999", "***", "NULL", "True", "1e", "1d5",
)  # fmt: skip


def one_by_one(cell):
    try:
        return np.nan if "_" in cell or "infinity" in cell.lower() else float(cell)
    except ValueError:
        return np.nan


@pytest.mark.parametrize("rows", [1, 40_000])
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
        found = table.floats(name)
        np.testing.assert_array_equal(found, expected)
        np.testing.assert_array_equal(np.signbit(found), np.signbit(expected))


@pytest.mark.parametrize("cell", ODD)
def test_one_odd_cell_among_numbers_is_what_it_is_by_itself(tmp_path, cell):
    path = tmp_path / "rows.csv"
    path.write_text(f"a,b\n1,-0.1\n2,{cell}\n3,1e-7\n")
    table = read_table(path)
    assert isinstance(table.rows, tables.EvenRows)
    found, expected = table.floats("b"), np.array([-0.1, one_by_one(cell), 1e-7])
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(np.signbit(found), np.signbit(expected))


def test_places_of_a_long_text_are_wide_numbers(monkeypatch):
    """A text of more than two gigabytes has places that 32 bits do not hold."""
    monkeypatch.setattr(tables, "LARGEST_SMALL", 4)
    _, _, rows = tables._even_rows("a,b\n1,2\n3,4\n", ",")
    assert rows.ends.dtype == np.int64
    np.testing.assert_array_equal(rows.floats(1), [2.0, 4.0])
