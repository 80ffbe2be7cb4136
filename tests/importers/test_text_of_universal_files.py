"""Lines of universal files that contradict labels or settings: asked about, told, or silent."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.dataset import take_findings
from sldvexp.importers import conventions
from sldvexp.io.uff import universal_file

from .plate_files import FIRST, POINTS, SAID, SIX_DIGITS, read, refused

PEAK, RMS = conventions.Amplitude.peak, conventions.Amplitude.rms
#: Spectra of motions, whose amplitudes have a measure.
SPECTRUM = {"kind": 12, "reference_kind": 0, "reference_unit": ""}
SPECTRA = {name: value for name, value in SAID.items() if name != "reference"}


def words(*lines):
    return (*lines, *[""] * (5 - len(lines)))


@pytest.fixture
def made(tmp_path, uff):
    def made_(*lines, before=b"", code=9, name="SI", length=1.0, **more):
        units = uff.units(length, name).replace(f"{9:10d}".encode(), f"{code:10d}".encode(), 1)
        path = tmp_path / "plate.uff"
        own = {"words": words(*lines), "unit": "m/s", **more}
        functions = [uff.function(i, FIRST, **own) for i in (1, 2, 3, 4)]
        path.write_bytes(units + before + uff.nodes(POINTS) + b"".join(functions))
        return path

    return made_


def odd(group):
    return [f for f in take_findings({"line_of_sight": group}) if f.kind == "unit"]


@pytest.mark.parametrize(
    ("line", "kind", "said"),
    [
        ("Vib Displacement", {},
         "'Vib Displacement' states displacement, but its values are in units of 1 m of velocity "
         "(by the label m/s); say which with instrument.quantity"),
        ("H1 Velocity [mm/s] / Force", {}, "states mm/s, but its values are in units of 1 m of "
         "velocity (by the label m/s); say which with instrument.unit"),
        ("Velocity RMS", SPECTRUM | {"unit": "m/s pk"}, "'Velocity RMS' states rms, but its "
         "amplitudes are peak, by the label m/s pk; say which with instrument.amplitude"),
    ],
)  # fmt: skip
def test_identifying_line_that_contradicts_a_label_is_asked_about_by_its_line(
    made, line, kind, said
):
    path = made("plate", line, **kind)
    settings = {"reference": None} if "kind" in kind else {}
    told = refused(path, said, "plate.uff, data set 3 (58), line ", **settings)
    number = int(told.partition(", line ")[2].partition(":")[0])
    assert path.read_text().splitlines()[number - 1] == line
    assert "further" not in told


def test_setting_that_wins_over_an_identifying_line_makes_the_run_doubtful(made):
    path = made("Velocity RMS", **SPECTRUM)
    (found,) = odd(read(path, reference=None, amplitude=PEAK))
    assert "instrument.amplitude=peak wins, although 'Velocity RMS' states rms" in found.text
    assert "plate.uff, data set 3 (58), line " in found.text
    assert found.severity.name == "doubtful"
    right = read(path, reference=None, amplitude=RMS)
    assert not odd(right)
    np.testing.assert_allclose(right["velocity"][0, 0], 2**0.5 * FIRST, rtol=SIX_DIGITS)


@pytest.mark.parametrize(
    "lines",
    [
        ("Vib Velocity", "H1 Velocity / Force"),
        ("RMS averaging", "Magnitude averaging", "peak hold"),
        ("Vibrometer velocity 50 mm/s/V range", "VD-09 50 mm/s/V", "Ref1 Acceleration"),
        ("NONE", "01-Jan-24 10:00:00", "Velocity RMS"),  # response functions have no measure
    ],
)
def test_identifying_lines_that_agree_or_say_nothing_are_silent(made, lines):
    group = read(made(*lines))
    assert not odd(group)
    np.testing.assert_allclose(group["velocity"][0, 0], FIRST, rtol=SIX_DIGITS)


def test_lines_about_the_file_are_heeded_if_they_are_more_than_a_word(made, uff):
    about = uff.data_set(151, "Plate 7", "Displacement and its velocity", "Program", "", "", "", "")
    assert not odd(read(made(before=about)))
    about = uff.data_set(151, "Plate 7", "displacement", "Program", "", "", "", "")
    assert not odd(read(made(before=about)))  # functions of several quantities may be in a file
    about = uff.data_set(151, "Plate 7", "Velocity [mm/s]", "Program", "", "", "", "")
    refused(made(before=about), "data set 2 (151), line 10: 'Velocity [mm/s]' states mm/s")


def test_functions_of_another_quantity_are_compared_only_where_they_are_read(tmp_path, uff):
    path = tmp_path / "both.uff"
    omega = 2j * np.pi * np.array([100.0, 110, 120, 130, 140])
    path.write_bytes(
        uff.units()
        + uff.nodes(POINTS)
        + b"".join(
            uff.function(i, FIRST, first=100.0, step=10.0, words=words("Vib Velocity"))
            + uff.function(
                i, FIRST / omega, first=100.0, step=10.0, quantity=8, unit="m",
                words=words("Vib Displacement"),
            )
            for i in (1, 2, 3, 4)
        )
    )  # fmt: skip
    assert not odd(read(path))


@pytest.mark.parametrize(
    ("code", "name", "length", "said"),
    [
        (5, "MM: mm (milli newton)", 1.0, "the code 5 is of units of 0.001 m, but the factor of "
         "lengths of units of 1 m; say which with instrument.length_unit"),
        (9, "inch", 1e-3, "the name 'inch' is of units of 0.0254 m"),
        (1, "SI: Meter (newton)", 1e-3, "the code 1 is of units of 1 m"),
    ],
)  # fmt: skip
def test_units_that_a_data_set_states_in_two_ways_are_asked_about(made, code, name, length, said):
    path = made(code=code, name=name, length=length)
    settings = {"directions": conventions.Directions.view}
    refused(path, said, **settings)


@pytest.mark.parametrize(("code", "name"), [(1, "SI: Meter (newton)"), (9, "SI"), (9, "USER")])
def test_units_that_agree_with_their_code_and_name_are_silent(made, code, name):
    path = made(code=code, name=name)
    assert not odd(read(path))
    with universal_file(path) as file:
        assert file.units is not None
        assert not file.units.contradiction
