"""Tables that scanning vibrometers export are read by their structure, in any language."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sldvexp.errors import ConfigError, UserError
from sldvexp.importers import PointwiseView, conventions
from sldvexp.importers.scan_export import ScanExport
from sldvexp.units import LengthUnit

POINTS = np.array([[0, 0, 0], [0.3, 0, 0], [0.3, 0.2, 0.01], [0, 0.2, 0]])
VALUES = 1e-3 * np.array([1 + 2j, -3 + 0.5j, 0.25 - 4j, -5 - 6j])
PLAIN = {
    "positive": conventions.Positive.towards,
    "phase": conventions.Phase.exp_plus,
    "amplitude": conventions.Amplitude.peak,
}


def rows(*columns, mark=".", delimiter="\t"):
    lines = [delimiter.join(f"{v:.9g}" for v in row) for row in zip(*columns, strict=True)]
    return "\n".join(lines).replace(".", mark) + "\n"


@pytest.fixture
def read(tmp_path):
    def read_(text, encoding="utf-8", **more):
        views = {}
        for name, origin in (("a", [0.0, 0.0, 1.5]), ("b", [1.0, 0.0, 1.0])):
            path = tmp_path / f"{name}.txt"
            path.write_bytes(text.encode(encoding))
            views[name] = PointwiseView(path=str(path), origin=origin)
        return ScanExport(views=views, **{**PLAIN, **more}).read()

    return read_


def right(group, values=VALUES[:, None], position=POINTS, frequency=(197.0,)):
    np.testing.assert_allclose(group["velocity"].sel(view="a"), values, rtol=1e-8)
    np.testing.assert_allclose(group["position"], position, atol=1e-12)
    np.testing.assert_allclose(group["frequency"], frequency)
    assert list(group["point"].values) == [str(i) for i in range(1, len(position) + 1)]


INDEX = np.arange(1, 5)
XYZ = POINTS.T
PARTS = (VALUES.real, VALUES.imag)

TABLES = {
    "english": (
        "Source\tC:\\scan.svd\nFrequency:\t197 Hz\n\n"
        "Index\tX [m]\tY [m]\tZ [m]\tReal [m/s]\tImag [m/s]\n" + rows(INDEX, *XYZ, *PARTS)
    ),
    "german, decimal commas, units in a line of their own": (
        "Quelle;C:\\Prüfling.svd\nFrequenz: 0,197 kHz\n"
        "Punkt;X;Y;Z;Realteil;Imaginärteil\n;mm;mm;mm;mm/s;mm/s\n"
        + rows(INDEX, *(1e3 * XYZ), *(1e3 * v for v in PARTS), mark=",", delimiter=";")
    ),
    "magnitude and phase, blanks": (
        "freq = 197Hz\n Nr   x(m)  y(m)  z(m)  |v|(m/s)  arg(deg)\n"
        + rows(INDEX, *XYZ, np.abs(VALUES), np.degrees(np.angle(VALUES)), delimiter="  ")
    ),
    "no numbers of points, commas between, quotes, end of line": (
        '"197 Hz"\n"X [m]","Y [m]","Z [m]","速度実部 [µm/s]","速度虚部 [µm/s]",\n'
        + rows(*XYZ, *(1e6 * v for v in PARTS), delimiter=",").replace("\n", ",\n")
    ),
    "displacement": (
        "197 Hz\nX [mm]\tY [mm]\tZ [mm]\tRe [nm]\tIm [nm]\n"
        + rows(
            *(1e3 * XYZ),
            (VALUES / (2j * np.pi * 197)).real * 1e9,
            (VALUES / (2j * np.pi * 197)).imag * 1e9,
        )
    ),
}


@pytest.mark.parametrize("name", TABLES)
def test_structures(read, name):
    right(read(TABLES[name]))


@pytest.mark.parametrize("encoding", ["latin-1", "utf-8-sig", "utf-16"])
def test_encodings(read, encoding):
    right(read(TABLES["german, decimal commas, units in a line of their own"], encoding))


def test_real_values(read):
    text = "197 Hz\nX [m]\tY [m]\tZ [m]\tV [m/s]\n" + rows(*XYZ, VALUES.real)
    right(read(text), VALUES.real[:, None])


def test_several_frequencies_in_rows(read):
    order = np.random.default_rng(1).permutation(8)
    columns = [np.tile(INDEX, 2), *np.tile(XYZ, 2), np.repeat([100.0, 200.0], 4)]
    columns += [np.tile(p, 2) * np.repeat([1, 2], 4) for p in PARTS]
    head = "n\tx [m]\ty [m]\tz [m]\tf [Hz]\tre [m/s]\tim [m/s]\n"
    both = VALUES[:, None] * [1, 2]
    text = head + rows(*(c[order] for c in columns))
    right(read(text), both, frequency=[100, 200])
    right(read(text, frequency=[200.0]), both[:, 1:], frequency=[200])
    with pytest.raises(UserError, match="is not at 150 Hz; the nearest is"):
        read(text, frequency=[150.0])
    with pytest.raises(UserError, match=r"line 2 and 1 more: there is no row for point \d at"):
        read(head + rows(*(c[order][1:] for c in columns)))
    with pytest.raises(UserError, match=r"line 10: point 1 at 100 Hz is given twice"):
        read(text + rows(*(c[:1] for c in columns)))


F_EACH = 1e-3 * np.arange(1, 13).reshape(4, 3) * (1 + 0.5j)
RE_IM = np.stack([F_EACH.real, F_EACH.imag], axis=2)
NAMES = "Nr\tX [m]\tY [m]\tZ [m]"
EACH = ("100 Hz", "0,2 kHz", "300 Hz")
POLAR = np.stack([np.abs(F_EACH), np.degrees(np.angle(F_EACH))], axis=2)

#: Heading, columns of values, and the values they stand for.
WIDE = {
    "real and imaginary parts side by side": (
        NAMES + "".join(f"\tRe {f} [m/s]\tIm {f} [m/s]" for f in EACH),
        RE_IM.reshape(4, 6),
        F_EACH,
    ),
    "all real parts first, frequencies behind the unit": (
        NAMES + "".join(f"\t{p} [m/s] @ {f}" for p in ("Re", "Im") for f in EACH),
        RE_IM.transpose(0, 2, 1).reshape(4, 6),
        F_EACH,
    ),
    "joined cells in a line above, magnitude and phase": (
        "\t\t\t\t100 Hz\t\t200 Hz\t\t300 Hz\n" + NAMES + "\tA [m/s]\tφ [deg]" * 3,
        POLAR.reshape(4, 6),
        F_EACH,
    ),
    "bare numbers below their unit, between names and units": (
        "Nr\tX\tY\tZ" + "\tV" * 3 + "\n" + "f [Hz]\t\t\t\t100\t200\t300\n\tm\tm\tm" + "\tm/s" * 3,
        F_EACH.real,
        F_EACH.real,
    ),
    "two real columns": (
        NAMES + "\tV(100 Hz) [m/s]\tV(200 Hz) [m/s]",
        F_EACH.real[:, :2],
        F_EACH.real[:, :2],
    ),
    "band of the analysis above, which is of no column": (
        "Band\t100 Hz\t300 Hz\n197 Hz\n" + NAMES + "\tRe [m/s]\tIm [m/s]",
        RE_IM[:, 0],
        F_EACH[:, :1],
    ),
}


@pytest.mark.parametrize("name", WIDE)
def test_columns_of_several_frequencies(read, name):
    heading, columns, expected = WIDE[name]
    text = heading + "\n" + rows(INDEX, *XYZ, *columns.T)
    frequency = [100, 200, 300][: expected.shape[1]] if expected.shape[1] > 1 else [197]
    more = {"frequency": [197.0]} if frequency == [197] else {}
    right(read(text, **more), expected, frequency=frequency)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
def test_one_frequency_in_the_names_of_columns(read, delimiter):
    head = ["Nr", "X [m]", "Y [m]", "Z [m]", "100 Hz Magnitude [m/s]", "100 Hz Phase [deg]"]
    parts = np.abs(VALUES), np.degrees(np.angle(VALUES))
    text = delimiter.join(head) + "\n" + rows(INDEX, *XYZ, *parts, delimiter=delimiter)
    right(read(text), frequency=[100])
    right(read(f"Frequency{delimiter}100 Hz\n" + text.replace("100 Hz ", "")), frequency=[100])


def test_a_decimal_comma_in_a_table_of_commas_is_asked_about(read):
    head = "X [m],Y [m],Z [m],Re [m/s],Im [m/s]\n"
    text = "Frequency: 0,197 kHz\n" + head + rows(*XYZ, *PARTS, delimiter=",")
    with pytest.raises(UserError, match=r"states 197, 197000 Hz\); say it with instrument.freq"):
        read(text)
    right(read(text, frequency=[197.0]))


def test_columns_of_frequencies_without_units(read):
    text = "n\tx\ty\tz\t100 Hz\t200 Hz\n" + rows(INDEX, *XYZ, *F_EACH.real[:, :2].T)
    more = {
        "columns": {"index": 1, "x": 2, "y": 3, "z": 4},
        "length_unit": LengthUnit.m,
        "quantity": conventions.Quantity.velocity,
    }
    with pytest.raises(UserError, match=r"say it with instrument\.unit"):
        read(text, **more)
    group = read(text, **more, unit=conventions.MotionUnit.m)
    right(group, F_EACH.real[:, :2], frequency=[100, 200])
    assert group.attrs["import_columns"].endswith("frequency heading, real 5 6")
    right(read(text, **more, unit=conventions.MotionUnit.m, frequency=[200.0]),
          F_EACH.real[:, 1:2], frequency=[200])  # fmt: skip


def test_columns_of_frequencies_that_are_refused(read):
    numbers = rows(INDEX, *XYZ, *RE_IM.reshape(4, 6).T[:3])
    heading = "\tRe 100 Hz [m/s]\tIm 100 Hz [m/s]\tRe 200 Hz [m/s]\n"
    with pytest.raises(UserError, match=r"line 2: has the columns 5 .*, 6 .* but 7 "):
        read(NAMES + heading + numbers)
    text = WIDE["two real columns"][0].replace("V(200 Hz) [m", "V(200 Hz) [mm")
    with pytest.raises(UserError, match=r"need the same columns in the same units"):
        read(text + "\n" + rows(INDEX, *XYZ, *F_EACH.real[:, :2].T))
    numbers = rows(INDEX, *XYZ, *RE_IM.reshape(4, 6).T)
    heading = "\tA 100 Hz [m/s]\tB 100 Hz [m/s]\tC 100 Hz [m/s]" * 2
    said = r"the columns of 100 Hz are 5 \(A 100 Hz \[m/s\]\), 6 .* of one frequency, write the"
    with pytest.raises(UserError, match=said):
        read(NAMES + heading.replace("100", "200").replace("200", "100", 3) + "\n" + numbers)


def test_one_of_several_functions_for_each_frequency(read):
    heading = "".join(
        f"\tH1 re {f} [m/s]\tH1 im {f} [m/s]\tH2 re {f} [m/s]\tH2 im {f} [m/s]\tCoh {f}"
        for f in EACH
    )
    columns = np.concatenate([RE_IM, 2 * RE_IM, np.full((4, 3, 1), 0.875)], axis=2)
    text = NAMES + heading + "\n" + rows(INDEX, *XYZ, *columns.reshape(4, 15).T)
    with pytest.raises(UserError, match=r"columns of 100 Hz are 5 .* 8 .* of one frequency, write"):
        read(text)
    named = {"index": 1, "x": 2, "y": 3, "z": 4}
    units = {"length_unit": LengthUnit.m}
    of_h1 = named | {"real": 10, "imag": 11}  # of 200 Hz, which is as good as another
    right(read(text, columns=of_h1, **units), F_EACH, frequency=[100, 200, 300])
    of_h2 = named | {"real": 7, "imag": 8}
    right(read(text, columns=of_h2, **units), 2 * F_EACH, frequency=[100, 200, 300])
    with pytest.raises(UserError, match=r"names 5 .*, 11 .* of different frequencies"):
        read(text, columns=named | {"real": 5, "imag": 11}, **units)


def test_rows_of_frequencies_are_refused(read):
    text = "f [Hz]\tP1 [m/s]\tP2 [m/s]\tP3 [m/s]\n" + rows([1, 2], [3, 4], [5, 6], [7, 8])
    with pytest.raises(UserError, match="line 2: its rows are frequencies and its columns points"):
        read(text)


def test_response_functions_need_the_reference(read):
    text = TABLES["english"].replace("[m/s]", "[m/s/N]")
    with pytest.raises(UserError, match=r"say it with instrument\.reference"):
        read(text)
    group = read(text, reference=2.0, amplitude=None)
    right(group, 2 * VALUES[:, None])
    assert group.attrs["import_reference"] == "2 N"
    assert group.attrs["import_columns"] == "x 2, y 3, z 4, index 1, real 5, imag 6"


def test_references_of_tables_in_several_units_are_converted_or_asked_about(tmp_path):
    views = {}
    for name, unit, per in (("a", "m/s/N", 1.0), ("b", "m/s/lbf", 4.4482216152605)):
        values = per * np.array(PARTS)
        text = TABLES["english"].split("Index")[0] + (
            f"Index\tX [m]\tY [m]\tZ [m]\tReal [{unit}]\tImag [{unit}]\n"
            + rows(INDEX, *XYZ, *values)
        )
        path = tmp_path / f"{name}.txt"
        path.write_text(text)
        views[name] = PointwiseView(path=str(path), origin=[0.0, 0.0, 1.5])
    with pytest.raises(UserError, match=r"in N \(a\), lbf \(b\); .* instrument.reference='2 N'"):
        ScanExport(views=views, **PLAIN | {"reference": 2}).read()
    group = ScanExport(views=views, **PLAIN | {"reference": "2 N"}).read()
    for view in "ab":
        np.testing.assert_allclose(group["velocity"].sel(view=view)[:, 0], 2 * VALUES, rtol=1e-8)
    with pytest.raises(UserError, match=r"reference in N, a force, but .* in V, a voltage"):
        ScanExport(views=views, **PLAIN | {"reference": "2 V"}).read()


def test_status(read):
    head = "197 Hz\nNr\tX [m]\tY [m]\tZ [m]\tRe [m/s]\tIm [m/s]\tStatus\n"
    text = head + rows(INDEX, *XYZ, *PARTS, [3, 3, 0, 3])
    with pytest.raises(UserError, match=r"values 0, 3, of which .*instrument.good_status=\[3\]"):
        read(text)
    group = read(text, good_status=[3], incomplete=True)
    assert list(group["point"].values) == ["1", "2", "4"]
    np.testing.assert_allclose(group["velocity"].sel(view="a")[:, 0], VALUES[[0, 1, 3]])
    with pytest.raises(UserError, match="has not measured node 3"):
        read(text, good_status=[3])


def test_named_columns(read):
    text = "197 Hz\na\tb\tc\td\te\tf\n" + rows(INDEX, *XYZ, *PARTS)
    with pytest.raises(
        UserError, match="line 3 and 1 more: there are no three columns of coordinates"
    ):
        read(text)
    columns = {"index": 1, "x": 2, "y": 3, "z": 4, "real": 5, "imag": 6}
    units = {"length_unit": LengthUnit.m, "unit": conventions.MotionUnit.m}
    right(read(text, columns=columns, quantity=conventions.Quantity.velocity, **units))
    with pytest.raises(UserError, match=r"columns\.imag is 7, but there are 6"):
        read(text, columns=columns | {"imag": 7}, **units)


def test_phases_signs_and_amplitudes(read):
    more = {"phase": conventions.Phase.exp_minus, "positive": conventions.Positive.away}
    group = read(TABLES["english"], amplitude=conventions.Amplitude.rms, **more)
    right(group, -(2**0.5) * VALUES.conj()[:, None])


@pytest.mark.parametrize("setting", ["positive", "phase", "amplitude"])
def test_what_nobody_says_is_asked_for(read, setting):
    with pytest.raises(UserError, match=f"say it with instrument.{setting}"):
        read(TABLES["english"], **{setting: None})


REFUSED = {
    "no table": ("hello\nworld\n", "has no table of numbers"),
    "empty": ("", "has no table of numbers"),
    "no text": ("\0\1\2", "is not a text file"),
    "decibels": (TABLES["english"].replace("[m/s]", "[dB]"), "column 5 is in dB; export linear"),
    "three values": (
        "197 Hz\nX [m]\tY [m]\tZ [m]\tA [m/s]\tB [m/s]\tC [m/s]\n" + rows(*XYZ, *PARTS, *PARTS[:1]),
        "line 3 and 1 more: the columns of values are 4 (A [m/s]), 5 (B [m/s]), 6 (C [m/s])",
    ),
    "no frequency": (TABLES["english"].replace("197 Hz", "high"), "does not state one frequency"),
    "two frequencies": (
        TABLES["english"].replace("197 Hz", "197 Hz of 0 to 1.6 kHz"),
        "states 197, 0, 1600 Hz",
    ),
    "mixed marks": (TABLES["english"].replace("0.3\t", "0,3\t", 1), "points and commas are mixed"),
    "twice": (
        TABLES["english"].replace("\n4\t", "\n3\t"),
        "line 8: point 3 at 197 Hz is given twice",
    ),
    "zeros": (
        TABLES["english"].replace("-0.003\t0.0005", "0\t0"),
        "whether points whose values are all zero, as in line 6, were measured; say it with "
        "instrument.zeros (measured, or missing with instrument.incomplete=drop or mark), for "
        "example instrument.zeros=missing",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_tables_that_are_refused(read, name):
    text, said = REFUSED[name]
    with pytest.raises(UserError) as error:
        read(text)
    assert said in str(error.value), str(error.value)


def test_settings_that_cannot_be():
    view = {"a": PointwiseView(path="x", origin=[0.0, 0.0, 1.0])}
    for wrong in (
        {"directions": conventions.Directions.dof},
        {"columns": {"u": 1}},
        {"columns": {"x": 0}},
        {"views": {"a": PointwiseView(path="x", dof="+Z", origin=[0.0, 0.0, 1.0])}},
    ):
        with pytest.raises(ConfigError):
            ScanExport(**{"views": view, **wrong})


FUZZED = TABLES | {n: f"{h}\n" + rows(INDEX, *XYZ, *c.T) for n, (h, c, _) in WIDE.items()}
SPICE = ["\t", ";", ",", "\n", "9e99", "-1", "[Hz]", "[m]", "nan", "\0", "²"]


@pytest.mark.whole
@settings(max_examples=150, deadline=None, derandomize=True, database=None)
@given(
    st.sampled_from(sorted(FUZZED)),
    st.lists(
        st.tuples(
            st.floats(0, 1),
            st.integers(0, 30),
            st.sampled_from(SPICE) | st.text(max_size=4),
        ),
        max_size=5,
    ),
)
def test_mutated_tables(tmp_path_factory, name, edits):
    text = FUZZED[name]
    for place, length, new in edits:
        at = int(place * len(text))
        text = text[:at] + new + text[at + length :]
    path = tmp_path_factory.mktemp("fuzz") / "a.txt"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    view = {"a": PointwiseView(path=str(path), direction=[0.0, 0.0, 1.0])}
    with contextlib.suppress(UserError):
        ScanExport(views=view, **PLAIN).read()
