"""Splines, penalties and Love's kinematics against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.shell import CylinderChart, TensorSplines, ThinShell, plane_stress, von_mises
from sldvexp.virtual_lab.modes import Direction, EdgeSupport, Mode, RectangularPlate
from sldvexp.virtual_lab.motion import Sheet

LOW, HIGH = np.array([-0.15, -0.12]), np.array([0.15, 0.12])


def laid(cells=12, degree=5):
    return TensorSplines.over(LOW, HIGH, cells, degree, 0.1)


def places(count=200, seed=0):
    return np.random.default_rng(seed).uniform(LOW, HIGH, (count, 2))


def bent(curvature):
    return CylinderChart(np.zeros(3), np.eye(3), curvature)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
def test_a_penalty_is_the_integral_of_the_squared_derivatives(order):
    """Of a polynomial, in the unit, and none of lower degree."""
    splines = laid(5)
    x, y = places(600).T / 0.1
    polynomial = x**order + 2 * x ** (order - 1) * y
    coefficients = np.linalg.lstsq(splines(places(600)), polynomial, rcond=None)[0]
    a, b = (HIGH - LOW) / 0.1
    factorial = float(np.prod(np.arange(1, order + 1)))
    # d^order/dx^order, and binomial(order, 1) times that of order - 1 by x and 1 by y
    integral = a * b * (factorial**2 + order * (2 * factorial / order) ** 2)
    assert coefficients @ splines.penalty(order) @ coefficients == pytest.approx(integral, rel=1e-6)
    smooth = np.linalg.lstsq(splines(places(600)), x ** (order - 1), rcond=None)[0]
    assert smooth @ splines.penalty(order) @ smooth == pytest.approx(0.0, abs=1e-6 * integral)


@pytest.mark.one_in(6)
@pytest.mark.parametrize("curvature", [0.0, 2.0])
@pytest.mark.parametrize("height", [0.0, 0.0015, -0.0015])
def test_rows_are_the_motion_and_the_strain_of_a_thin_shell(curvature, height):
    """Modes in closed form, whose middle surface the splines are fitted to."""
    sheet = Sheet(70e9, 0.33, 2700.0, 0.003)
    modes = RectangularPlate(tuple(HIGH - LOW), EdgeSupport.supported, sheet).modes(
        [
            Mode(1, 2),
            Mode(1, 1, direction=Direction.x),
            Mode(2, 1, direction=Direction.y),
        ]
    )
    amount = np.array([0.02, 0.003, -0.002])
    shell = ThinShell(laid(20), laid(20), bent(curvature))
    at = places(3000, 1)
    middle = np.einsum("pmi,m->pi", modes.motion(at - LOW, 0.0, curvature), amount)
    theta = np.linalg.lstsq(laid(20)(at), middle, rcond=None)[0].T.ravel()
    there = places(100, 2)
    wanted = np.einsum("pmi,m->pi", modes.motion(there - LOW, height, curvature), amount)
    got = np.stack([rows @ theta for rows in shell.velocity(there, height)], axis=1)
    assert got == pytest.approx(wanted, abs=1e-6 * np.abs(wanted).max())
    wanted = np.einsum("pmi,m->pi", modes.strain(there - LOW, height, curvature), amount)
    got = np.stack([rows @ theta for rows in shell.strain(there, height)], axis=1)
    assert got == pytest.approx(wanted, abs=1e-4 * np.abs(wanted).max())


def test_derivatives_of_the_rows_are_those_of_differences():
    shell = ThinShell(laid(6), laid(4, 3), bent(1.5))
    at, step, height = places(20), 1e-6, 0.002
    for axis, order in ((0, (1, 0)), (1, (0, 1))):
        by = step * np.eye(2)[axis]
        ahead, behind = shell.velocity(at + by, height), shell.velocity(at - by, height)
        for of, up, down in zip(shell.velocity(at, height, *order), ahead, behind, strict=True):
            assert of == pytest.approx((up - down) / (2 * step), rel=1e-6, abs=1e-5)
    higher, lower = shell.velocity(at, height + step), shell.velocity(at, height - step)
    for of, up, down in zip(shell.velocity_by_height(at), higher, lower, strict=True):
        assert of == pytest.approx((up - down) / (2 * step), rel=1e-6, abs=1e-5)


def test_the_largest_von_mises_stress_of_a_cycle():
    rng = np.random.default_rng(3)
    stress = rng.normal(size=(20, 3, 1)) + 1j * rng.normal(size=(20, 3, 1))
    phase = np.linspace(0, 2 * np.pi, 20001)
    ss, tt, st = np.moveaxis((stress * np.exp(1j * phase)).real, 1, 0)
    largest = np.sqrt(ss**2 - ss * tt + tt**2 + 3 * st**2).max(axis=1)
    assert von_mises(stress)[:, 0] == pytest.approx(largest, rel=1e-6)


def test_pure_shear_and_equal_tension():
    strain = np.array([[[0], [0], [1e-6]], [[1e-6], [1e-6], [0]]], complex)
    shear, tension = plane_stress(strain, 70e9, 0.25)
    assert shear[:, 0].real == pytest.approx([0, 0, 56e3])  # 2 G e, G = E / 2 (1 + nu)
    assert tension[:, 0].real == pytest.approx([70e3 / 0.75] * 2 + [0])
