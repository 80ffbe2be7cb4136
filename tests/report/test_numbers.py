"""Numbers as a person reads them."""

from __future__ import annotations

import pytest

from sldvexp.report import number, with_bound


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
