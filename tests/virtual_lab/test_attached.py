"""Masses and ribs on a plate: their characteristic equations, limits, shapes, and refusals."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq

from sldvexp.errors import Checks
from sldvexp.units import LengthUnit
from sldvexp.virtual_lab.attached import Along, LoadedPlate, PointMass, Rib
from sldvexp.virtual_lab.modes import Direction, EdgeSupport, Mode
from sldvexp.virtual_lab.motion import Sheet
from sldvexp.virtual_lab.plate import Plate, VibratingPlate

SIZE = (0.3, 0.25)
A, B = SIZE
SHEET = Sheet(70e9, 0.33, 2700.0, 0.003)
WHOLE = SHEET.mass * A * B
#: What 32 terms leave out of what the attached changes.
OF_MASS, OF_RIB = 1e-3, 3e-5


def stiffness(terms, y=None):
    """D k^4 of many terms, of both half waves or of one along x."""
    n = np.arange(1, terms + 1)
    m = n[:, None] if y is None else y
    return SHEET.bending * ((np.pi * m / A) ** 2 + (np.pi * n / B) ** 2) ** 2


@pytest.mark.one_in(2)
@pytest.mark.parametrize("place", [(0.15, 0.125), (0.07, 0.1)])
def test_frequency_with_a_mass_solves_its_characteristic_equation(place):
    kg, terms = 0.3 * WHOLE, 600
    n = np.pi * np.arange(1, terms + 1)
    there = np.outer(np.sin(n * place[0] / A), np.sin(n * place[1] / B)) ** 2
    bare = stiffness(terms)

    def equation(omega2):
        return kg * omega2 * (there / (bare - SHEET.mass * omega2)).sum() * 4 / (A * B) - 1

    lowest = bare[0, 0] / SHEET.mass
    exact = brentq(equation, 0.01 * lowest, 0.9999 * lowest, xtol=1e-9 * lowest)
    found, _ = LoadedPlate(SIZE, SHEET, ((*place, kg),), ()).lowest(1)
    assert exact < 0.8 * lowest
    assert found[0] == pytest.approx(exact, abs=OF_MASS * (lowest - exact))


def test_frequency_with_a_rib_solves_its_characteristic_equation():
    across, bending, line, terms = 0.08, 150.0, 0.1, 4000
    k = np.pi / A
    there = np.sin(np.pi * np.arange(1, terms + 1) * across / B) ** 2
    bare = stiffness(terms, 1)

    def equation(omega2):
        added = bending * k**4 - line * omega2
        return 1 + added * (there / (bare - SHEET.mass * omega2)).sum() * 2 / B

    first, second = bare[0] / SHEET.mass, bare[1] / SHEET.mass
    exact = brentq(equation, first * 1.0001, second * 0.9999, xtol=1e-9 * first)
    found, shape = LoadedPlate(SIZE, SHEET, (), ((0, across, bending, line),)).lowest(4)
    at = np.argmin(np.abs(found - exact))
    assert exact > 1.2 * first
    assert found[at] == pytest.approx(exact, abs=OF_RIB * (exact - first))
    assert np.abs(shape[at][1:]).max() < 1e-9


def test_along_y_is_along_x_of_the_turned_plate():
    turned, _ = LoadedPlate(SIZE[::-1], SHEET, (), ((1, 0.08, 40.0, 0.1),)).lowest(5)
    found, _ = LoadedPlate(SIZE, SHEET, (), ((0, 0.08, 40.0, 0.1),)).lowest(5)
    assert turned == pytest.approx(found, rel=1e-8)


def test_nothing_attached_is_the_bare_plate():
    found, shape = LoadedPlate(SIZE, SHEET, (), ()).lowest(5)
    assert found == pytest.approx(np.sort(stiffness(10).ravel())[:5] / SHEET.mass)
    assert np.abs(shape).max(axis=(1, 2)) == pytest.approx(1.0, rel=1e-3)


def loaded(**settings):
    modes = {
        "first": Mode(1, 1),
        "second": Mode(2, 1, velocity=-0.01),
        "given": Mode(1, 2, 600.0),
        "along": Mode(1, 0, 9000.0, direction=Direction.x),
    }
    attached = {"masses": {"m": PointMass([0.03, 0.02], 0.1)}, "ribs": {"r": Rib(offset=-0.05)}}
    return Plate(**({"modes": modes} | attached | settings))


def test_modes_of_the_configuration_take_their_places():
    made = loaded().vibration()
    assert made.frequency.tolist()[2:] == [600.0, 9000.0]
    assert made.frequency[0] < made.frequency[1]
    s, t = np.meshgrid(np.linspace(0, A, 101), np.linspace(0, B, 101))
    u, _, w = made.derivatives(np.column_stack([s.ravel(), t.ravel()]))
    assert np.abs(w(0, 0)).max(axis=0)[:3] == pytest.approx(1.0, abs=1e-3)
    assert np.abs(w(0, 0))[:, 3].max() == 0.0
    assert np.abs(u(0, 0))[:, 3].max() == pytest.approx(1.0)


def test_units_scale_what_is_attached():
    in_mm = loaded(
        unit=LengthUnit.mm,
        size=[300.0, 250.0],
        thickness=3.0,
        masses={"m": PointMass([30.0, 20.0], 0.1)},
        ribs={"r": Rib(Along.y, -50.0, 5.0, 12.0)},
    )
    in_m = loaded().vibration()
    assert in_mm.vibration().frequency == pytest.approx(in_m.frequency, rel=1e-9)


def test_strain_is_the_gradient_of_the_displacement():
    ours, f, step = VibratingPlate.built(loaded(thickness=0.01)), 450.0, 1e-5
    places = np.random.default_rng(2).uniform(0.01, np.array(SIZE) - 0.01, (40, 2))
    by = [
        (ours.velocity(ours.position(places + d), f) - ours.velocity(ours.position(places - d), f))
        / (step * 2j * np.pi * f)
        for d in step / 2 * np.eye(2)
    ]
    e = np.array([[by[i][:, j] for j in (0, 1)] for i in (0, 1)])
    expected = np.stack([e[0, 0], e[1, 1], (e[0, 1] + e[1, 0]) / 2], axis=1)
    found = ours.strain(ours.position(places), f)
    np.testing.assert_allclose(found, expected, atol=2e-5 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"radius": 0.5, "modes": {"m": Mode(1, 1, 200.0)}}, "masses: need a flat plate on"),
        ({"edges": EdgeSupport.free}, "masses: need a flat plate on supported edges without shear"),
        ({"shear": True}, "masses: need a flat plate on supported edges without shear"),
        ({"masses": {"m": PointMass([0.2, 0.0])}}, "masses.m.center: lies beside the plate"),
        ({"masses": {"m": PointMass([0.1])}}, "masses.m.center: must be 2 numbers, not 1"),
        ({"masses": {"m": PointMass(mass=0.0)}}, "masses.m.mass: must be a positive number"),
        ({"ribs": {"r": Rib(height=0.002)}}, "ribs.r.height: must be above the plate's thickness"),
        ({"ribs": {"r": Rib(Along.x, 0.13)}}, "ribs.r.offset: must be within +-0.125"),
        ({"modes": {"m": Mode(9, 1)}}, "modes.m: must have at most 8 half waves"),
        ({"modes": {"m": Mode(membrane=[0.1, 0.0])}}, "modes.m.membrane: does not go with masses"),
    ],
)
def test_no_such_attached(settings, told):
    checks = Checks()
    loaded(**settings).check(checks, "plate")
    problems = [f"{p.field}: {p.message}" for p in checks.problems]
    assert len(problems) == 1
    assert told in problems[0]
