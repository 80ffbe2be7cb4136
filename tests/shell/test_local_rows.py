"""Rows with few coefficients against those with all: values, products, functionals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.geometry import Meridian
from sldvexp.shell import (
    CylinderChart,
    RevolutionChart,
    TensorSplines,
    ThinShell,
    estimate_surface,
    nodal_velocity,
    pixel_equations,
)
from sldvexp.shell.around_holes import HoleFunctions
from sldvexp.shell.functionals import Forms, Rows
from sldvexp.shell.least_stretch import wall_stretch
from sldvexp.shell.local_rows import LocalRows
from sldvexp.shell.splines import Splines
from tests.shell import simulated_shell as lab

HIGH = np.array([0.15, 0.12])


def plate():
    """A bent plate with a hole; its cells of w are no parts of those of u0 and v0."""
    bending = TensorSplines.over(-HIGH, HIGH, 12, 5, 0.1)
    around = HoleFunctions.of([(np.array([0.01, 0.02]), 0.02)], 0.02)
    membrane = TensorSplines.over(-HIGH, HIGH, 7, 3, 0.1)
    return ThinShell(bending, membrane, CylinderChart(np.zeros(3), np.eye(3), 2.0), around)


def tube():
    """A closed shell, whose u0 and v0 follow w."""
    chart = RevolutionChart(np.zeros(3), np.eye(3), Meridian(np.array([[0.1, -0.1], [0.1, 0.1]])))
    high = np.array([chart.period / 2, 0.1])
    bending = TensorSplines.over(-high, high, 12, 5, 0.1, around=True)
    membrane = TensorSplines.over(-high, high, 6, 3, 0.1, around=True)
    return ThinShell(
        bending, membrane, chart, stretch=wall_stretch(chart, bending, membrane, nu=0.3)
    )


def assert_same(found, wanted):
    """But for round-off, over the largest."""
    assert found.shape == wanted.shape
    assert np.abs(found - wanted).max() < 1e-12 * np.abs(wanted).max()


def problem(shell, seed=0):
    """Places, forms of motion and strain there, and all their rows."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-HIGH, HIGH, (300, 2)) * 0.8
    forms = [*shell.strains(places, 0.0015), *shell.motion(places, 0.001)]
    return rng, places, forms, shell.rows(places, forms)


@pytest.mark.parametrize("periodic", [False, True])
@pytest.mark.parametrize("degree", [3, 5])
def test_functions_of_a_cell_are_the_splines_that_are_not_zero_there(periodic, degree):
    splines = Splines(-0.43, 1.2, 13, degree, periodic)
    # Beyond the ends too, where open splines go on and closed ones come back.
    x = np.r_[np.random.default_rng(1).uniform(-0.5, 1.3, 300), splines.ends[1:-1]]
    cell, within = splines.cell_of(x)
    for order in range(degree + 1):
        # The last derivative jumps where cells meet.
        some = slice(300) if order == degree else slice(None)
        found = np.zeros((len(x), splines.count))
        np.add.at(
            found,
            (np.arange(len(x))[:, None], splines.functions[cell]),
            splines.local(cell, within, order),
        )
        wanted = splines(x, order)
        assert_same(found[some], wanted[some])
    assert not splines.local(cell, within, degree + 1).any()


@pytest.mark.parametrize("made", [plate, tube])
def test_values_are_those_of_rows(made):
    shell = made()
    rng, places, forms, rows = problem(shell)
    theta = rng.normal(size=(shell.coefficients, 11))
    for found, of in zip(np.moveaxis(shell.values(theta, places, forms), 1, 0), rows, strict=True):
        assert_same(found, of @ theta)


@pytest.mark.parametrize("made", [plate, tube])
def test_products_are_those_of_rows(made):
    shell = made()
    rng, places, forms, rows = problem(shell, 1)
    others, local = rng.normal(size=(len(places), 3)), LocalRows(shell, places)
    for form, of in zip(forms, rows, strict=True):
        row = local.row(form)
        normal, crossed = local.gram(row), local.crossed(row, others)
        assert_same(normal, of.T @ of)
        assert_same(crossed, of.T @ others)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("made", [plate, tube])
def test_forms_are_functionals_as_their_rows_are(made):
    """More places than are worked on at once."""
    shell = made()
    rng = np.random.default_rng(2)
    places = rng.uniform(-HIGH, HIGH, (1500, 2)) * 0.8
    forms = shell.strains(places, 0.0015)
    root = rng.normal(size=(shell.coefficients, 50))
    columns, matrices = rng.normal(size=(shell.coefficients, 4)), [root @ root.T, np.eye(len(root))]
    found = Forms(shell, places, forms).evaluate(columns, matrices)
    wanted = Rows(np.concatenate(shell.rows(places, forms))).evaluate(columns, matrices)
    for one, other in zip(found, wanted, strict=True):
        assert_same(one, other)
    none = Forms(shell, places, forms).evaluate(columns[:, :0], [])
    assert [each.shape for each in none] == [(4500, 0), (4500, 0)]


@pytest.mark.whole
def test_pixels_and_places_in_many_parts_give_the_same(monkeypatch):
    """Products, equations of errors, pointing, what no column of several lines holds, nodes."""
    frequency, laser = (190.0, 200.0, 210.0), replace(lab.LASER, pointing_std=0.02)
    views = lab.views(
        lab.plate(), np.random.default_rng(3), pixels=(10, 10), frequency=frequency, noise=1e-5
    )
    covariance = np.diag(np.tile([15e-6] * 3 + [27e-6] * 3, len(views)) ** 2)
    fields = []
    for joined, places in ((pixel_equations.JOINED, nodal_velocity.PLACES), (200, 50)):
        monkeypatch.setattr(pixel_equations, "JOINED", joined)
        monkeypatch.setattr(nodal_velocity, "PLACES", places)
        found = estimate_surface(
            views,
            laser,
            lab.volume(),
            lab.method(),
            lab.SHEET,
            frequency=frequency,
            covariance=covariance,
        )
        assert found.fit.overlooked is not None
        assert found.fit.pointed
        fields.append(found.field())
    for name in ("velocity", "velocity_std", "velocity_std_by_part", "variance"):
        whole, in_parts = (field[name].values for field in fields)
        assert np.abs(in_parts - whole).max() < 1e-8 * np.abs(whole).max()
