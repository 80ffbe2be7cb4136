"""The table of units, against a library of all units there are."""

from __future__ import annotations

import sys

import pytest

from sldvexp.unit_table import DIMENSIONS, PREFIXES, UNITS, PrefixedUnit, UnitProduct, readings

pint = pytest.importorskip("pint")
#: A library rounds a foot on its way over yards, and a pound per square inch three times.
ROUNDING = 3 * sys.float_info.epsilon
NAMES = [said for name, (*_, more) in UNITS.items() for said in (name, *more.split())]
BEFORE = [said for name, (_, more) in PREFIXES.items() for said in (name, *more.split())]


@pytest.fixture(scope="module")
def registry():
    return pint.UnitRegistry()


@pytest.mark.parametrize("unit", UNITS)
def test_sizes_and_dimensions_are_those_of_a_library(registry, unit):
    one, same = UnitProduct.from_unit(PrefixedUnit("", unit)), registry.Quantity(1.0, unit)
    assert one.size == pytest.approx(float(same.to_base_units().magnitude), rel=ROUNDING)
    powers = {name.strip("[]"): power for name, power in same.dimensionality.items()}
    assert one.powers == powers
    assert set(powers) <= set(DIMENSIONS)


@pytest.mark.parametrize("prefix", [*PREFIXES][1:])
def test_prefixes_are_those_of_a_library(registry, prefix):
    theirs = registry.Quantity(1.0, f"{prefix}meter").to_base_units().magnitude
    assert UnitProduct.from_unit(PrefixedUnit(prefix, "meter")).size == theirs


def test_names_mean_what_a_library_says(registry):
    """Of the units of the table: others, as pints, are none here."""
    wrong = []
    for name in {f"{b}{n}{s}" for b in BEFORE for n in NAMES for s in ("", "s")}:
        theirs = [(p, u) for p, u, _ in pint.UnitRegistry.parse_unit_name(registry, name)]
        known = [(p, u) for p, u in theirs if u in UNITS and (p in PREFIXES)]
        if [tuple(r) for r in readings(name)] != known:
            wrong.append((name, readings(name), known))
    assert not wrong


def test_an_hour_divides_as_a_number_would():
    """No digit is lost on the way: 1000 / 3600 is not 1000 times a rounded 1 / 3600."""
    unit = UnitProduct.from_unit
    speed = unit(PrefixedUnit("kilo", "meter")) * unit(PrefixedUnit("", "hour")) ** -1
    assert speed.size == 1000 / 3600
    assert speed.powers == {"length": 1, "time": -1}
    assert (speed * speed**-1).powers == {}
