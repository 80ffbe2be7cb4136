"""Whatever is in a file, it is read or refused in a sentence, and in little memory."""

from __future__ import annotations

import resource
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from sldvexp.errors import UserError
from sldvexp.importers import PointwiseView, conventions
from sldvexp.importers.uff import Estimator, UffImport
from sldvexp.io.uff import universal_file
from sldvexp.units import LengthUnit

#: What the whole process may take, bytes.
MOST_MEMORY = 500 << 20
PLATE = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]
VALUES = np.array([1 + 2j, 3 - 4j, 5 + 6j])
UNEVEN = np.array([1.0, 3.0, 4.0])
#: What is put into files besides their own bytes.
SPICE = [
    b"    -1\n",
    b"-1",
    b"\n",
    b"\r\n",
    b"\0",
    b" ",
    b"99999999",
    b"-",
    b"D+300",
    b"nan",
    b"\xff",
]


@pytest.fixture(scope="module")
def sound(uff):
    """Data sets that mutations start from."""
    systems = {5: (np.eye(3), [0, 0, 0])}
    shape = ["ODS", "", "", "", "", *map(integers, ((1, 5, 2, 11, 5, 3), (2, 1, 1, 1)))]
    shape += [f"{10.0:13.5E}", f"{1:10d}", "".join(f"{v:13.5E}" for v in range(6))]
    analysis = [integers([1]), "response", integers([1]), "", "", "", "", ""]
    analysis += [*map(integers, ((1, 5, 2, 11, 5, 3), range(8), (0, 0)))]
    analysis += ["".join(f"{v:13.5E}" for v in row) for row in (range(9, 15), [0] * 6)]
    analysis += [f"{1:10d}", "".join(f"{v:13.5E}" for v in range(6))]
    system_18 = f"{6:10d}{0:10d}{0:10d}{8:10d}{1:10d}"
    return [
        uff.units(),
        uff.qualifiers(2),
        uff.systems(systems),
        uff.data_set(18, system_18, "CS", "0. 0. 0. 1. 0. 0.", "0. 0. 1."),
        uff.nodes(PLATE),
        uff.nodes_15(PLATE, first=9),
        uff.elements([[1, 2, 3, 4]]),
        uff.trace([1, 2, 0, 3, 4]),
        uff.function(7, VALUES),
        uff.function(8, VALUES, type_=6, abscissa=UNEVEN),
        uff.function(8, VALUES.real, type_=4),
        uff.binary(7, VALUES),
        uff.binary(8, VALUES.real, type_=4, order=">", abscissa=UNEVEN),
        uff.function(7, VALUES, kind=3),
        uff.function(1, VALUES.real, kind=2),
        uff.data_set(55, *shape),
        uff.data_set(2414, *analysis),
        uff.function(7, VALUES, unit="mm/s²", axis=(18, "", "kHz")),
        uff.data_set(151, "model", "         9 lines follow this set, crc32 00000000"),
    ]


@st.composite
def changes(draw):
    """Replace so many bytes at a place by something."""
    place, length = draw(st.floats(0, 1)), draw(st.integers(0, 12) | st.integers(0, 600))
    return place, length, draw(st.sampled_from(SPICE) | st.binary(max_size=12))


def integers(numbers):
    return "".join(f"{n:10d}" for n in numbers)


def read_all(path):
    with universal_file(path) as file:
        assert all(e.end <= file.source.size for e in file.entries)
        for what in ("units", "amplitude", "geometry"):
            try:
                getattr(file, what)
            except UserError as error:
                told(error)
        shapes = []
        try:
            shapes = file.nodal_functions()
        except UserError as error:
            told(error)
        for function in file.functions + shapes:
            try:
                x, y = file.values(function)
            except UserError as error:
                told(error)
            else:
                assert x.shape == y.shape == (function.size,)
                assert np.isfinite(x).all()
                assert np.isfinite(y).all()


def import_all(path):
    """As `instrument=uff` does."""
    views = {"a": PointwiseView(path=str(path), direction=[0.0, 0.0, 1.0])}
    settings_ = {
        "directions": conventions.Directions.view,
        "positive": conventions.Positive.towards,
    }
    settings_ |= {"phase": conventions.Phase.exp_plus, "reference": 1.0, "amplitude": None}
    settings_ |= {"estimator": Estimator.h1, "unit": conventions.MotionUnit.m}
    settings_ |= {"length_unit": LengthUnit.m, "averages": 4}
    UffImport(views=views, **settings_).read()


def told(error):
    assert "\n" not in str(error)
    assert len(str(error)) < 600


def fuzz(sound, path, examples, deadline=None):
    """Read so many mutations of sound files."""

    @settings(
        max_examples=examples,
        deadline=None,
        derandomize=deadline is None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(
        st.lists(st.integers(0, len(sound) - 1), min_size=1, max_size=4),
        st.lists(changes(), max_size=5) | st.just([]),
        st.none() | st.binary(max_size=300),
    )
    def read_one(sets, edits, other):
        content = b"".join(sound[i] for i in sets)
        for place, length, new in edits:
            at = int(place * len(content))
            content = content[:at] + new + content[at + length :]
        path.write_bytes(content if other is None else b"    -1\n" + other)
        for work in (read_all, import_all):
            try:
                work(path)
            except UserError as error:
                told(error)

    read_one()


def peak():
    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return used if sys.platform == "darwin" else 1024 * used


@pytest.mark.parametrize("count", [80, pytest.param(300, marks=pytest.mark.whole)])
def test_mutated_files(sound, tmp_path, count):
    before = peak()
    fuzz(sound, tmp_path / "fuzzed.uff", count)
    assert peak() - before < MOST_MEMORY


@pytest.mark.long
def test_mutated_files_for_a_minute(sound, tmp_path):
    import time

    before, end = peak(), time.monotonic() + 60
    rounds = 0
    while time.monotonic() < end:
        fuzz(sound, tmp_path / "fuzzed.uff", 500, deadline=end)
        rounds += 1
    assert rounds > 1
    assert peak() - before < MOST_MEMORY
