"""Free text of files that contradicts settings or labels is asked about, or told; never lost."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.dataset import take_findings
from sldvexp.errors import UserError
from sldvexp.importers import PointwiseView, conventions
from sldvexp.importers.scan_export import ScanExport
from sldvexp.units import LengthUnit

ROWS = "1\t0\t0\t0\t1\t2\n2\t0.3\t0\t0\t3\t4\n3\t0\t0.2\t0\t5\t6\n"
SAID = {
    "positive": conventions.Positive.towards,
    "phase": conventions.Phase.exp_plus,
}


def table(tmp_path, head, names="Index\tX [m]\tY [m]\tZ [m]\tReal [m/s pk]\tImag [m/s pk]", **more):
    path = tmp_path / "scan.txt"
    path.write_text(f"{head}\nFrequency: 195 Hz\n{names}\n{ROWS}", encoding="utf-8")
    view = PointwiseView(path=str(path), origin=[0.0, 0.0, 1.5])
    return ScanExport(views={"a": view}, **{**SAID, **more}).read()


def findings(group):
    return [f for f in take_findings({"line_of_sight": group}) if "states" in f.text]


@pytest.mark.parametrize(
    ("head", "said"),
    [
        ("Velocity RMS", "line 1: 'Velocity RMS' states rms, but the column of values says m/s pk; "
         "say which with instrument.amplitude"),
        ("Signal: Displacement", "line 1: 'Signal: Displacement' states displacement, but the "
         "column of values says m/s pk; say which with instrument.quantity"),
        ("units: in/s", "states in/s, but the column of values says m/s pk; say which with "
         "instrument.unit"),
        ("coordinates in mm", "states mm, but the columns of coordinates say m; say which with "
         "instrument.length_unit"),
    ],
)  # fmt: skip
def test_head_line_that_contradicts_a_label_is_asked_about(tmp_path, head, said):
    with pytest.raises(UserError) as error:
        table(tmp_path, head)
    assert said in str(error.value), str(error.value)


def test_file_whose_name_has_braces_is_named_as_it_is(tmp_path):
    folder = tmp_path / "{1} {a}"
    folder.mkdir()
    with pytest.raises(UserError) as error:
        table(folder, "Velocity RMS")
    assert f"{folder / 'scan.txt'}, line 1: 'Velocity RMS'" in str(error.value)


@pytest.mark.parametrize(
    ("setting", "head", "factor"),
    [
        ({"amplitude": conventions.Amplitude.rms}, "Velocity RMS", 2**0.5),
        ({"amplitude": conventions.Amplitude.peak}, "Velocity RMS", 1.0),
        ({"unit": conventions.MotionUnit.inch}, "units: in/s", 0.0254),
        ({"quantity": conventions.Quantity.displacement}, "Displacement", 2 * np.pi * 195),
        ({"length_unit": LengthUnit.mm}, "coordinates in mm", 1.0),
    ],
)
def test_setting_that_the_question_names_answers_it(tmp_path, setting, head, factor):
    group = table(tmp_path, head, **setting)
    found = np.abs(group["velocity"].values[0, 0, 0])
    assert found == pytest.approx(factor * 5**0.5, rel=1e-12)


@pytest.mark.parametrize(
    ("head", "setting", "said"),
    [
        ("# Velocity RMS", {"amplitude": conventions.Amplitude.peak},
         "instrument.amplitude=peak wins, although '# Velocity RMS' states rms"),
        ("time dependence exp(-iwt)", {},
         "instrument.phase=exp_plus wins, although 'time dependence exp(-iwt)' states exp_minus"),
        ("positive velocity is away from the laser", {},
         "instrument.positive=towards wins, although 'positive velocity is away from the laser' "
         "states away"),
    ],
)  # fmt: skip
def test_setting_that_wins_over_a_head_line_makes_the_run_doubtful(tmp_path, head, setting, said):
    (found,) = findings(table(tmp_path, head, **setting))
    assert said in found.text
    assert "scan.txt, line 1: " in found.text
    assert found.severity.name == "doubtful"


def test_unit_of_phases_that_a_head_line_contradicts_makes_the_run_doubtful(tmp_path):
    names = "Index\tX [m]\tY [m]\tZ [m]\tMagn. [m/s pk]\tPhase [deg]"
    (found,) = findings(table(tmp_path, "phase in radians", names))
    assert (
        "'phase in radians' states radian, but the column of phases says deg, which wins"
        in found.text
    )
    assert not findings(table(tmp_path, "phase in degrees", names))


@pytest.mark.parametrize(
    "head", ["Velocity, m/s 0-pk", "RMS averaging", "Velocity 50 mm/s/V range", "peak hold"]
)
def test_head_line_that_agrees_or_says_nothing_is_silent(tmp_path, head):
    assert not findings(table(tmp_path, head))


def test_comment_between_rows_and_text_below_are_compared_too(tmp_path):
    path = tmp_path / "scan.txt"
    head = "195 Hz\nIndex\tX [m]\tY [m]\tZ [m]\tReal [m/s pk]\tImag [m/s pk]\n"
    view = PointwiseView(path=str(path), origin=[0.0, 0.0, 1.5])
    for text, line in (
        (ROWS.replace("2\t0.3", "# values are rms\n2\t0.3"), 4),
        (f"{ROWS}\nvelocity RMS\n", 7),
    ):
        path.write_text(head + text)
        with pytest.raises(UserError, match=rf"line {line}: .* states rms"):
            ScanExport(views={"a": view}, **SAID).read()


def test_question_for_a_sense_names_what_a_line_states_of_it(tmp_path):
    with pytest.raises(UserError) as error:
        table(tmp_path, "time dependence exp(-iwt)", phase=None)
    assert "2 questions are open" in str(error.value)
    said = "line 1: 'time dependence exp(-iwt)' states exp_minus; if so, say instrument.phase=exp_m"
    assert said in str(error.value)
