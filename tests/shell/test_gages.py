"""Strain gages: rows of known strains, and what is measured against what is predicted."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from sldvexp.check import Examination
from sldvexp.check.gages import Gages
from sldvexp.errors import UserError
from sldvexp.shell import Gage, estimate_surface
from sldvexp.shell.gage import along
from tests.shell import simulated_shell as lab

PLACES = ([0.0, 0.0, 0.0], [0.0, 0.0, 90.0], [0.05, -0.04, 30.0], [-0.07, 0.06, 135.0])


def gages(**settings):
    return {
        f"g{i}": Gage(place=[x, y], direction=angle, **settings)
        for i, (x, y, angle) in enumerate(PLACES)
    }


@pytest.fixture(scope="module")
def found():
    views = lab.views(lab.plate(), np.random.default_rng(1))
    return estimate_surface(
        views, lab.LASER, lab.volume(), lab.method(), lab.SHEET, frequency=[lab.FREQUENCY]
    )


def true(gage):
    places, weight = gage.points()
    world = np.column_stack([places, np.full(len(places), 0.0015)]) + lab.CENTER
    strain = lab.plate().strain(world, lab.FREQUENCY)
    return weight @ along(tuple(strain.T), gage.along)


def test_the_strain_along_a_direction():
    """Uniaxial strain along 30 degrees with its Poisson contraction."""
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    strain = np.array([c * c - 0.3 * s * s, s * s - 0.3 * c * c, 1.3 * c * s])[:, None]
    assert along(tuple(strain), np.array([c, s])) == pytest.approx(1.0)
    assert along(tuple(strain), np.array([-s, c])) == pytest.approx(-0.3)


def test_gages_show_what_the_plate_strains(found):
    for gage in gages().values():
        row = gage.row(found.fit.shell, found.fit.face)
        strain, variance = found.strain_of(row[None], [gage.row])
        error = strain[0, 0] - true(gage)
        assert abs(error.real) <= 3 * np.sqrt(variance[0, 0, 0])
        assert abs(error.imag) <= 3 * np.sqrt(variance[1, 0, 0])
        assert abs(error.imag) < 0.15e-6  # of up to 3.9e-6, that of the bending


def test_a_longer_gage_averages(found):
    """Over a third of a wave it shows less than at the antinode alone."""
    long = Gage(place=[0.0, 0.0], length=0.19)
    short = Gage(place=[0.0, 0.0], length=0.001)
    ratio = [abs(true(gage).imag) for gage in (long, short)]
    rows = [gage.row(found.fit.shell, found.fit.face) for gage in (long, short)]
    shown = [
        abs(found.strain_of(r[None], [g.row])[0][0, 0].imag)
        for r, g in zip(rows, (long, short), strict=True)
    ]
    assert shown[0] / shown[1] == pytest.approx(ratio[0] / ratio[1], rel=0.03)
    # mean of cos(pi x / a) over the length
    assert ratio[0] / ratio[1] == pytest.approx(np.sinc(0.19 / 0.3 / 2), rel=0.01)


def examined(monkeypatch, found, **measured):
    monkeypatch.setattr("sldvexp.check.gages.reconstruct_surface", lambda *_: found)
    experiment = SimpleNamespace(
        laser=None, volume=None, material=None, reconstruction=lab.method(), compare={}
    )
    run = Examination({}, rng=np.random.default_rng(0), experiment=experiment)
    return Gages(gages(**measured)).examine(run)


def test_a_gage_that_agrees_and_one_that_does_not(monkeypatch, found):
    plain = examined(monkeypatch, found)
    strain = complex(plain["strain"].values[0, 0])
    right = {"amplitude": [abs(strain)], "phase": [np.degrees(np.angle(strain))], "std": [1e-8]}
    group = examined(monkeypatch, found, **right)
    assert group["agrees"].values[0, 0]
    assert abs(group["difference"].values[0, 0]) < 1e-12
    assert not group["agrees"].values[1, 0]  # 90 degrees away it strains otherwise


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"place": [0.0]}, r"gages.g.place: must be 2 numbers in m"),
        ({"place": [0.0, 0.0], "length": 0.0}, "gages.g.length: must be a positive"),
        ({"place": [0.0, 0.0], "amplitude": [1e-6]}, "gages.g.phase: must have as many numbers"),
    ],
)
def test_gages_that_cannot_be(settings, told):
    with pytest.raises(UserError, match=told):
        Gages({"g": Gage(**settings)})


def test_a_gage_beside_the_surface_is_named(monkeypatch, found):
    monkeypatch.setattr("sldvexp.check.gages.reconstruct_surface", lambda *_: found)
    experiment = SimpleNamespace(
        laser=None, volume=None, material=None, reconstruction=lab.method(), compare={}
    )
    run = Examination({}, rng=np.random.default_rng(0), experiment=experiment)
    with pytest.raises(UserError, match=r"far is not on the surface with its whole grid of 6 x 3"):
        Gages({"far": Gage(place=[0.3, 0.0])}).examine(run)
    wrong = Gage(place=[0.0, 0.0], amplitude=[1e-6, 2e-6], phase=[0, 0], std=[0, 0])
    with pytest.raises(UserError, match=r"two.amplitude must have 1 numbers, one for each freq"):
        Gages({"two": wrong}).examine(run)
