"""Strain gages: rows of known strains, and what is measured against what is predicted."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.stats

from sldvexp.check import Examination
from sldvexp.check.gages import Gages
from sldvexp.dataset import Severity, take_findings
from sldvexp.errors import UserError
from sldvexp.shell import Gage, estimate_surface
from sldvexp.shell.gage import along
from tests.shell import simulated_shell as lab

HEADER = "gage,frequency_Hz,amplitude_microstrain,phase_deg,std_microstrain"
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


SETTINGS = {"laser": None, "volume": None, "material": None, "compare": {}}


@pytest.fixture
def examined(monkeypatch, found, tmp_path):
    """Examine gages, with the lines of a file of measured strains."""

    def examine(*lines, header=HEADER, places=None):
        monkeypatch.setattr("sldvexp.check.on_surface.reconstruct_surface", lambda *_: found)
        experiment = SimpleNamespace(**SETTINGS, reconstruction=lab.method())
        run = Examination({}, rng=np.random.default_rng(0), experiment=experiment)
        path = tmp_path / "gages.csv"
        path.write_text("\n".join([header, *lines]))
        return Gages(places or gages(), str(path) if lines else None).examine(run)

    return examine


def line(name, strain, std=0.01, frequency=lab.FREQUENCY):
    """Line of a file: strain in microstrain."""
    strain = 1e6 * complex(strain)
    return f"{name},{frequency:.10g},{abs(strain):.9g},{np.degrees(np.angle(strain)):.9g},{std}"


def test_a_gage_that_agrees_and_one_that_does_not(examined):
    strain = examined()["strain"].values[:, 0]
    group = examined(line("g0", strain[0]), line("g1", strain[0]))
    assert group["agrees"].values[:2, 0].tolist() == [True, False]
    assert abs(group["difference"].values[0, 0]) < 1e-12
    assert group["p_value"].values[0, 0] == 1
    # 90 degrees away it strains otherwise
    (told,) = findings(group)
    assert told.subject == "gage g1"
    assert told.p_value < 1e-6
    assert told.size == pytest.approx(1e6 * abs(strain[1] - strain[0]))
    assert "gage g1 showed" in told.text
    assert told.severity is Severity.doubtful


def findings(group):
    return take_findings({"examined/gages": group})


def test_both_uncertainties_bound_the_difference(examined):
    """A gage off by three of its standard errors is no finding; the field's are in there too."""
    plain = examined()
    own = plain["confidence_by_part"].values[:, 0, 0]
    strain = plain["strain"].values[0, 0]
    group = examined(line("g0", strain + 0.9e-6, std=0.3))
    bound = group["difference_confidence"].values[:, 0, 0]
    assert bound == pytest.approx(np.hypot(own, 1.959964 * 0.3e-6), rel=1e-6)
    assert not group["agrees"].values[0, 0]
    z = 0.9e-6 / bound[0] * 1.959964
    assert group["p_value"].values[0, 0] == pytest.approx(4 * scipy.stats.norm.sf(z), rel=1e-5)
    assert findings(group) == []


@pytest.mark.whole
def test_a_right_gage_is_seldom_called_wrong(examined):
    """Of strains that scatter as they say, at most one in 20 does not agree."""
    plain, rng, wrong = examined(), np.random.default_rng(3), 0
    variance = (plain["confidence_by_part"].values[:, :, 0] / 1.959964) ** 2 + 0.05e-6**2
    for _ in range(100):
        parts = rng.normal(size=variance.shape) * np.sqrt(variance)
        strain = plain["strain"].values[:, 0] + parts[0] + 1j * parts[1]
        group = examined(*(line(f"g{i}", s, 0.05) for i, s in enumerate(strain)))
        wrong += (group["agrees"].values == 0).sum()
        assert findings(group) == []
    assert 5 <= wrong <= 35  # 20 of 400, 3.5 standard deviations


def test_all_of_a_file_that_is_not_used_is_told(examined):
    strain = examined()["strain"].values[:, 0]
    group = examined(
        line("g0", strain[0], frequency=lab.FREQUENCY * (1 + 5e-5)),
        line("g0", strain[0], frequency=300.0),
        line("other", 1e-6),
        header=HEADER.replace("std_microstrain", "remark"),
    )
    notes = group.attrs["notes"].splitlines()
    assert [note.partition(": ")[2] for note in notes] == [
        "the columns remark have no meaning here",
        "has no std; the gages are taken for exact",
        "strains of gages that check.gages does not have are left out: other",
        "1 of 2 strains is at a frequency that the run does not have, as 300 Hz",
        *["no strain was measured at 1 of 1 frequencies"] * 3,
    ]
    assert np.isfinite(group["measured"].values[:, 0]).tolist() == [True, False, False, False]
    assert not group["agrees"].values[1:].any()
    assert np.isnan(group["p_value"].values[1:]).all()


@pytest.mark.parametrize(
    ("lines", "told"),
    [
        (["h0,197,1,0,0"], "gages.csv: gage h0 is none of check.gages; Valid: g0"),
        (["g0,198,1,0,0"], "has no strain at a frequency of the run: it has 198 Hz, the run 197"),
    ],
)
def test_a_file_of_other_gages_or_lines_is_refused(examined, lines, told):
    with pytest.raises(UserError, match=told):
        examined(*lines)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"place": [0.0]}, r"gages.g.place: must be 2 numbers in m"),
        ({"place": [0.0, 0.0], "length": 0.0}, "gages.g.length: must be a positive"),
    ],
)
def test_gages_that_cannot_be(settings, told):
    with pytest.raises(UserError, match=told):
        Gages({"g": Gage(**settings)})


@pytest.mark.parametrize(
    ("gage", "told"),
    [
        ({"place": [0.3, 0.0]}, "far is not on the surface with its whole grid of 6 x 3 mm"),
        (
            {"place": [0.0, 0.0], "length": 0.4},
            "far, 400 x 3 mm, is longer than the surface, 300 x",
        ),
    ],
)
def test_a_gage_beside_the_surface_or_longer_is_named(examined, gage, told):
    with pytest.raises(UserError, match=told):
        examined(places={"far": Gage(**gage)})
