"""Tables as they come in real life: nothing is dropped in silence, exchanged, or out of scale."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.importers import PointwiseView, conventions
from sldvexp.importers.scan_export import ScanExport
from sldvexp.units import LengthUnit

CASES = Path(__file__).parent / "cases" / "scan_export"
PLAIN = {
    "positive": conventions.Positive.towards,
    "phase": conventions.Phase.exp_plus,
    "amplitude": conventions.Amplitude.peak,
}
#: Of the four corners, mm/s.
CORNERS = np.array([-1.213 + 0.402j, 2.044 - 0.655j, 1.987 - 0.601j, -1.176 + 0.388j])


def read(path, **settings):
    view = PointwiseView(path=str(path), direction=[0.0, 0.0, 1.0])
    return ScanExport(views={"front": view}, **{**PLAIN, **settings}).read()


def right(group, expected=CORNERS, frequency=(195.0,)):
    assert list(group["frequency"].values) == list(frequency)
    columns = np.asarray(expected).reshape(-1, len(frequency))
    np.testing.assert_allclose(group["velocity"].values[0], 1e-3 * columns, rtol=1e-8)
    np.testing.assert_allclose(group["position"].values[1], [0.15, 0.0, 0.0])


def counted(group):
    return [(f.kind, f.size) for f in dataset.take_findings({"line_of_sight": group})]


@pytest.mark.parametrize("name", ["blank_front", "blank_left", "blank_below", "page_front"])
def test_blank_lines_and_page_headings_part_no_table(name):
    group = read(CASES / f"{name}.txt")
    assert list(group["point"].values) == [str(i) for i in range(1, 61)]
    lines = (CASES / f"{name}.txt").read_text().splitlines()
    cells = [line.split("\t") for line in lines if line[:1].isdigit()]
    own = [1e-3 * complex(float(c[4]), float(c[5])) for c in cells]
    assert len(own) == 60
    np.testing.assert_allclose(group["velocity"].values[0, :, 0], own)
    kind = "blank lines" if name.startswith("blank") else "repeated headings"
    assert group.attrs["import_lines"] == f"2 {kind}"


@pytest.mark.parametrize("name", ["gap", "comment_mid"])
def test_a_blank_line_or_a_comment_drops_no_row(name):
    right(read(CASES / f"{name}.txt"))


@pytest.mark.parametrize("name", ["nan", "dash", "empty_cell"])
def test_a_row_without_numbers_is_a_point_that_was_not_measured(name):
    path = CASES / f"{name}.txt"
    with pytest.raises(UserError) as error:
        read(path)
    said = (
        f"{path}: does not state the values of 1 of 4 rows (the first is line 5), whose points may "
        "be left out, or kept and marked; say it with instrument.incomplete, for example "
        "instrument.incomplete=drop"
    )
    assert str(error.value) == said
    dropped = read(path, incomplete="drop")
    right(dropped, CORNERS[[0, 1, 3]])
    assert list(dropped["point"].values) == ["1", "2", "4"]
    assert counted(dropped) == [("missing_points", 1.0)]
    marked = read(path, incomplete="mark")
    right(marked, np.where([0, 0, 1, 0], np.nan, CORNERS))
    assert marked["flags"].values.tolist() == [[[0], [0], [1], [0]]]
    assert counted(marked) == [("missing_points", 1.0)]


def test_a_second_block_is_of_a_second_frequency():
    both = np.repeat(CORNERS[:, None], 2, axis=1)
    right(read(CASES / "two_freq_blocks.txt"), both, (195.0, 440.0))
    right(read(CASES / "two_freq_blocks.txt", frequency=[440.0]), CORNERS, (440.0,))


@pytest.mark.parametrize("name", ["phase_degunit", "imagfirst"])
def test_names_and_units_tell_the_parts(name):
    right(read(CASES / f"{name}.txt"))


def test_columns_of_two_channels_are_asked_about():
    path = CASES / "two_channels.txt"
    said = r"line 3: the columns of values are 5 \(Vib \[mm/s\]\), 6 \(Ref \[mm/s\]\); .*columns="
    with pytest.raises(UserError, match=said):
        read(path)
    with pytest.raises(UserError, match=r"2 questions are open: .*Vib.*; \(2\) .*positive=towards"):
        read(path, positive=None)
    only = {"index": 1, "x": 2, "y": 3, "z": 4, "real": 5}
    right(read(path, columns=only), CORNERS.real)


def test_a_status_may_be_words(tmp_path):
    path = tmp_path / "a.txt"
    words = iter(["Optimal", "Valid", "Not measured", "Valid"])
    rows = [f"{row}\t{next(words)}" for row in ROWS]
    path.write_text(HEAD.replace("Imag [mm/s]", "Imag [mm/s]\tStatus") + "\n".join(rows))
    said = r"good of the values Not measured, Optimal, Valid, .*instrument\.good_status=\[Optimal\]"
    with pytest.raises(UserError, match=said):
        read(path)
    good = {"good_status": ["Optimal", "Valid"]}
    with pytest.raises(UserError, match=r"line 5: the view front has not measured node 3"):
        read(path, **good)
    right(read(path, **good, incomplete="drop"), CORNERS[[0, 1, 3]])
    columns = {"index": 1, "x": 2, "y": 3, "z": 4, "real": 5, "imag": 6}
    right(read(path, columns=columns))


@pytest.mark.parametrize(("name", "factor"), [("rms", 2**0.5), ("pp", 0.5), ("sm1", 1.0)])
def test_units_tell_amplitude_and_quantity(name, factor):
    settings = {} if name == "sm1" else {"amplitude": None}
    right(read(CASES / f"{name}.txt", **settings), factor * CORNERS)


def test_millimetres_a_minute():
    right(read(CASES / "min.txt"), CORNERS / 60)


def test_squares_have_no_amplitude():
    with pytest.raises(
        UserError, match=r"line 3: its values are in \(mm/s\)², which is no amplitude"
    ):
        read(CASES / "sq.txt")


@pytest.mark.parametrize(
    ("words", "severity"),
    [
        (["Valid", "Invalid", "Valid", "Optimal"], "doubtful"),
        (["ok"] * 4, "note"),
    ],
)
def test_columns_that_are_left_out_are_named(tmp_path, words, severity):
    """One of a few different words may tell which values are good."""
    lines = ["Frequency: 195 Hz", "Index\tX [m]\tY [m]\tZ [m]\tReal [m/s]\tImag [m/s]\tStatus"]
    lines += [f"{i + 1}\t{i}\t{i * i}\t0\t1e-3\t0\t{word}" for i, word in enumerate(words)]
    path = tmp_path / "words.txt"
    path.write_text("\n".join(lines) + "\n")
    columns = {"index": 1, "x": 2, "y": 3, "z": 4, "real": 5, "imag": 6}
    (found,) = dataset.take_findings({"line_of_sight": read(path, columns=columns)})
    assert found.severity.name == severity
    assert "instrument.columns leaves out 7 (Status)" in found.text
    assert found.remedy == ("instrument.columns.status=7" if severity == "doubtful" else "")


def test_settings_that_win_over_labels_are_told(tmp_path):
    path = CASES / "rms.txt"
    group = read(path)
    right(group)
    (found,) = dataset.take_findings({"line_of_sight": group})
    assert found.severity is dataset.Severity.doubtful
    assert found.text == f"{path}: instrument.amplitude=peak wins, although the file says mm/s RMS"
    said = {"unit": conventions.MotionUnit.cm, "length_unit": LengthUnit.m}
    group = read(path, amplitude=None, **said)
    found = dataset.take_findings({"line_of_sight": group})
    assert [f.text.partition("=")[0].rpartition(".")[2] for f in found] == ["unit", "length_unit"]
    assert not counted(read(path, amplitude=conventions.Amplitude.rms))


HEAD = "Frequency: 195 Hz\nIndex\tX [mm]\tY [mm]\tZ [mm]\tReal [mm/s]\tImag [mm/s]\n"
ROWS = [
    "1\t0\t0\t0\t-1.213\t0.402",
    "2\t150\t0\t0\t2.044\t-0.655",
    "3\t150\t100\t0\t1.987\t-0.601",
    "4\t0\t100\t0\t-1.176\t0.388",
]
TABLE = HEAD + "\n".join(ROWS) + "\n"


def with_line(line, at=2):
    return HEAD + "\n".join([*ROWS[:at], line, *ROWS[at:]]) + "\n"


READ = {
    "a footer": TABLE + "\nMaximum 2.14 mm/s\nEnd of file\n",
    "a comment behind percents": with_line("% remeasured"),
    "line ends of DOS, and its end of file": TABLE.replace("\n", "\r\n") + "\x1a",
    "a page heading with its number": ("Page 1\n" + with_line("Page 2")).replace("Hz\n", "Hz\n\n"),
    "an upper line of many words": "A real file of magnitudes: x y z phase\n" + TABLE,
    "French": TABLE.replace("Real", "Partie réelle").replace("Imag", "Partie imaginaire"),
    "Italian": TABLE.replace("Real", "Parte reale").replace("Imag", "Parte immaginaria"),
    "Spanish": TABLE.replace("Real", "Parte real").replace("Imag", "Parte imaginaria"),
    "German": TABLE.replace("Real", "Realteil").replace("Imag", "Imaginärteil"),
    "names that say one part": TABLE.replace("Real", "Velocity"),
    "a minus of typographers": TABLE.replace("-", "\u2212"),
    "coherence besides": TABLE.replace("Imag [mm/s]", "Imag [mm/s]\tCoherence")
    .replace("0.402", "0.402\t0.98")
    .replace("0.655", "0.655\t0.97")
    .replace("0.601", "0.601\t0.99")
    .replace("0.388", "0.388\t0.91"),
}


@pytest.mark.one_in(3)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le"])
@pytest.mark.parametrize("name", READ)
def test_tables_that_are_read(tmp_path, name, encoding):
    path = tmp_path / "a.txt"
    path.write_bytes(READ[name].encode(encoding))
    right(read(path))


def polar(magnitude, phase):
    columns = np.abs(CORNERS), np.degrees(np.angle(CORNERS))
    lines = [HEAD.replace("Real [mm/s]", magnitude).replace("Imag [mm/s]", phase).rstrip()]
    for row, a, b in zip(ROWS, *columns, strict=True):
        lines.append("\t".join([*row.split("\t")[:4], f"{a:.12g}", f"{b:.12g}"]))
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("magnitude", "phase"),
    [
        ("Magnitude [mm/s]", "Phase [deg]"),
        ("Betrag [mm/s]", "Phase [Grad]"),
        ("Ampiezza [mm/s]", "Fase [gradi]"),
        ("Amplitud [mm/s]", "Ángulo [grados]"),
        ("Amplitude [mm/s]", "Phase [degrés]"),
        ("|v| [mm/s]", "∠ [°]"),
    ],
)
def test_magnitude_and_phase_in_many_languages(tmp_path, magnitude, phase):
    path = tmp_path / "a.txt"
    path.write_text(polar(magnitude, phase), encoding="utf-8")
    right(read(path))
    text = path.read_text("utf-8").replace(phase, phase.split(" ")[0] + " [radians]")
    cells = [line.split("\t") for line in text.splitlines()]
    for row in cells[2:]:
        row[5] = f"{np.radians(float(row[5])):.12g}"
    path.write_text("\n".join("\t".join(row) for row in cells), encoding="utf-8")
    right(read(path))


ASKED = {
    "a row with a word": (with_line("5\t0\t50\t0\t1.5x\t0.3"), "line 5: looks like a row of the"),
    "a row that is short": (with_line("5\t0\t50\t0"), "line 5: '5 0 50 0' looks like a row of the"),
    "a row behind a comment's mark": (with_line("#5\t0\t50\t0\t1.5\t0.3"), "line 5: '#5 0 50 0"),
    "a first row with a word": (with_line("0\tx\t50\t0\t1.5\t0.3", 0), "line 3: looks like a row"),
    "a row in two lines": (TABLE.replace("1.987", "1.9\n87"), "line 5: '3 150 100 0 1.9' looks"),
    "a last row in two lines": (TABLE.replace("0.388", "0.3\n88"), "line 7: '88' looks like a row"),
    "words between rows": (with_line("Scan 2"), "line 5: 'Scan 2' stands between rows"),
    "other names of columns": (
        with_line(HEAD.splitlines()[1].replace("mm/s", "m/s")),
        "line 5: is a second head, in which column 5 is in m/s and not in mm/s as in the first",
    ),
    "a frequency in words of its own": (with_line("now 440 Hz"), "line 5: 'now 440 Hz' states a"),
    "a frequency without rows": (
        TABLE + "\nFrequency: 440 Hz\n",
        "line 8: 'Frequency: 440 Hz' states frequencies, but no rows follow",
    ),
    "a magnitude without a phase": (
        polar("Magnitude [mm/s]", "Phase [dg]"),
        "the column 6 (Phase [dg]) is not understood: mass is no motion",
    ),
    "a magnitude alone": (
        re.sub(r"\t[^\t]+$", "", polar("Magnitude [mm/s]", "Phase"), flags=re.M),
        "the columns of values are 5 (Magnitude [mm/s])",
    ),
    "two columns of one name": (
        TABLE.replace("Real", "Velocity").replace("Imag", "Velocity"),
        "5 (Velocity [mm/s]), 6 (Velocity [mm/s]); needed is one, two in one unit that are named",
    ),
    "volts": (TABLE.replace("mm/s", "V"), "the column 5 (Real [V]) is not understood: voltage is"),
    "decibels": (TABLE.replace("Real [mm/s]", "Real [dB re 1 mm/s]"), "is in dB re 1 mm/s; export"),
    "a coordinate that is not there": (
        with_line("5\t\t50\t0\t1.5\t0.3"),
        "line 5: column 2, x, has no number",
    ),
    "a point that moves": (
        (CASES / "two_freq_blocks.txt").read_text()[::-1].replace("051", "052", 1)[::-1],
        "line 12: point 3 stood elsewhere before",
    ),
    "a column of words": (
        re.sub("(?m)([0-9])$", r"\1\tVib", TABLE.replace("Imag [mm/s]", "Imag [mm/s]\tUnit [V]")),
        "the column 7 (Unit [V]) is not understood",
    ),
    "thousands": (
        re.sub(r"\t-?[0-9]\.", "\t1,", TABLE).replace("1,402", "1,402").replace("195", "195"),
        "may be 1.213 or 1213; write decimal points",
    ),
    "milligravities": (TABLE.replace("mm/s", "mg"), "the unit 'mg'"),
    "spectral density": (TABLE.replace("mm/s", "mm/s/√Hz"), "no amplitude of a motion"),
}


@pytest.mark.parametrize("name", ASKED)
def test_tables_that_are_asked_about(tmp_path, name):
    text, said = ASKED[name]
    path = tmp_path / "a.txt"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(UserError) as error:
        read(path)
    assert said in str(error.value), str(error.value)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_all_that_is_open_is_asked_in_one_go_and_the_answers_are_right(tmp_path):
    path = tmp_path / "a.txt"
    lines = TABLE.replace("Frequency: 195 Hz\n", "").replace("[mm]", "").splitlines()
    text = "\n".join(
        [lines[0] + "\tOK", *(f"{row}\t{i == 3:d}" for i, row in enumerate(lines[1:]))]
    )
    path.write_text(text.replace("-1.176\t0.388", "-\t-"))
    columns = {"index": 1, "x": 2, "y": 3, "z": 4, "real": 5, "imag": 6, "status": 7}
    nothing = dict.fromkeys(PLAIN)
    with pytest.raises(UserError) as error:
        read(path, columns=columns, **nothing)
    assert str(error.value).startswith("7 questions are open: (1) ")
    assert re.findall(r"for example (instrument\.[^ ;]+)", str(error.value)) == [
        "instrument.frequency=[197]",
        "instrument.amplitude=peak",
        "instrument.positive=towards",
        "instrument.phase=exp_plus",
        "instrument.good_status=[0]",
        "instrument.incomplete=drop",
        "instrument.length_unit=mm",
    ]
    answers = {"frequency": [195.0], "good_status": [0, 1], "incomplete": "drop"}
    right(read(path, columns=columns, **PLAIN, **answers, length_unit=LengthUnit.mm), CORNERS[:3])


def test_a_table_without_names_is_asked_about_in_one_go_too(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("\n".join(ROWS))
    with pytest.raises(UserError) as error:
        read(path, **dict.fromkeys(PLAIN))
    said = str(error.value)
    assert said.startswith("8 questions are open: (1) ")
    assert "there are no three columns of coordinates with a unit of length" in said
    assert set(re.findall(r"say it with instrument\.(\w+)", said)) == {
        "positive",
        "phase",
        "length_unit",
        "quantity",
        "unit",
        "amplitude",
        "frequency",
    }
    columns = {"index": 1, "x": 2, "y": 3, "z": 4, "real": 5, "imag": 6}
    units = {"unit": conventions.MotionUnit.mm, "length_unit": LengthUnit.mm}
    quantity = conventions.Quantity.velocity
    right(read(path, columns=columns, quantity=quantity, frequency=[195.0], **units))


def test_numbers_of_points_that_have_no_row_are_counted(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text(TABLE.replace(ROWS[2] + "\n", ""))
    group = read(path)
    right(group, CORNERS[[0, 1, 3]])
    (found,) = dataset.take_findings({"line_of_sight": group})
    assert found.text == (
        "the table of view front has no rows for 1 of the point numbers 1 to 4: 3"
    )
