"""Numbers as a person reads them."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.dataset import group
from sldvexp.report import number, with_bound
from sldvexp.report.numbers import angle_text
from sldvexp.report.tables import hot_spot_table, strain_table


@pytest.mark.parametrize(
    ("value", "bound", "text"),
    [
        (-0.07263, 0.1934, "-0.07 ± 0.19"),
        (1.5, 0.003, "1.5000 ± 0.0030"),
        (1234.5678, 12.3, "1235 ± 12"),
        (0.5 - 0.25j, 0.1, "0.50 - 0.25i ± 0.10"),
        (2.0, float("nan"), "2 (no bound)"),
        (2.0, float("inf"), "2 (no bound)"),
        (2.0, 0.0, "2"),
    ],
)
def test_a_bound_decides_the_digits(value, bound, text):
    assert with_bound(value, bound) == text


def test_numbers():
    assert number(float("nan")) == "-"
    assert number(-0.0726 - 0.0288j) == "-0.0726-0.0288i"
    assert number(5.3002e-05, 5) == "5.3002e-05"


def test_rounding_is_told_as_nothing_in_tables_of_strain():
    strain = group(
        "strain",
        {"strain_component": ["ss", "tt", "st"]},
        strain=[[4e-6, 1e-6, 1.388e-20]],
        confidence=[[1e-7, 1e-7, 1e-7]],
        principal_strain=[[4e-6, 1e-6]],
        principal_confidence=[[1e-7, 1e-7]],
        principal_direction=[30.000000012],
        principal_direction_std=[1e-9],
        position=[[0.42, 1.388e-17, -0.0]],
        coordinate=[[-1.388e-17, 0.105]],
        triangle=[[0, 0, 0]],
    )
    spots = [next(iter(column.cells)) for column in hot_spot_table(strain, [np.nan]).columns]
    assert spots[2:4] == ["420, 0, 0", "0, 105"]
    assert spots[-1] == "30.00 ± 0.01"
    sizes = strain_table(strain, [np.nan]).columns[2]
    assert list(sizes.cells) == ["4", "1", "0"]


def test_no_zero_has_a_sign():
    assert with_bound(-0.0004, 0.19) == "0.00 ± 0.19"


def test_an_angle_without_a_bound_has_none():
    assert angle_text(88.5, float("nan")) == "88.5 (no bound)"
