"""What the scans of images say about their settings, and which pixels they choose."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import ConfigError, UserError
from sldvexp.io.scan_files import write_list
from sldvexp.scan import Sampling, Scan, ScanPart
from sldvexp.scan.base import Trigger
from sldvexp.scan.calibration import CalibrationScan, Centres
from sldvexp.scan.lines import rectangle, strided
from sldvexp.scan.pixel_list import LINE, PixelList, PixelSequence
from sldvexp.scan.rectangle import Rectangle, ScanRegion
from sldvexp.scan.session import Session
from sldvexp.signal import ExcitationKind, LineChoice

BOX = [[10, -5], [12, 40], [-30, 38], [-28, -6]]
SCAN_RECT = "11 12\n-5 10\n40 12\n38 -30\n-6 -28\n"


def chirp(kind="chirp", **settings):
    return Sampling(excitation=ExcitationKind[kind], **settings)


def problems(cls, **settings):
    with pytest.raises(ConfigError) as error:
        cls(**settings)
    return {p.field: p.message for p in error.value.problems}


def test_a_rectangle_is_the_grid_over_its_corners():
    scan = Rectangle(views={"a": ScanRegion(BOX)}, pixels=[11, 12])
    np.testing.assert_array_equal(np.stack(scan.lines("a")), rectangle(BOX, 11, 12))
    assert scan.shape("a") == (11, 12)
    assert scan.pixel_count("a") == 132
    assert scan.known_pixels("a").shape == (132, 2)
    assert scan.seconds("a") == pytest.approx(132 * 512 / 25600)
    assert scan.view_names() == ["a"]
    assert scan.parts("a") == [scan]
    assert scan.inputs() == []


def test_a_stride_is_kept_from_the_first_corner():
    scan = Rectangle(views={"a": ScanRegion(BOX)}, stride=4)
    np.testing.assert_array_equal(np.stack(scan.lines("a")), strided(BOX, 4))
    assert scan.shape("a") == (11, 12)
    assert set(np.diff(scan.grid("a")[:, 0, 0])) == {4}
    assert Rectangle(views={"a": ScanRegion(BOX)}, stride=1).shape("a") == (43, 47)


def test_a_file_says_its_rows_and_columns_unless_the_scan_does(tmp_path):
    (tmp_path / "ScanRect").write_text(SCAN_RECT)
    region = ScanRegion(path=str(tmp_path / "ScanRect"))
    scan = Rectangle(views={"a": region})
    np.testing.assert_array_equal(scan.grid("a"), rectangle(BOX, 11, 12))
    assert scan.inputs() == [region.path]
    assert Rectangle(views={"a": region}, pixels=[3, 4]).shape("a") == (3, 4)
    assert Rectangle(views={"a": region}, stride=40).shape("a") == (2, 2)


def test_a_box_must_have_room_for_its_pixels():
    scan = Rectangle(views={"a": ScanRegion(BOX)}, pixels=[11, 48])
    with pytest.raises(UserError, match="view a span 47 steps of left_right, fewer than the 48"):
        scan.lines("a")


def test_a_list_is_scanned_in_its_order_line_by_line(tmp_path):
    dac = np.random.default_rng(0).integers(-4000, 4000, (2 * LINE + 5, 2))
    write_list(tmp_path / "ScanList", dac)
    path = str(tmp_path / "ScanList")
    for scan in (
        PixelList(views={"a": PixelSequence(dac.tolist())}),
        PixelList(views={"a": PixelSequence([], path)}),
    ):
        assert [len(line) for line in scan.lines("a")] == [LINE, LINE, 5]
        np.testing.assert_array_equal(scan.known_pixels("a"), dac)
        assert scan.shape("a") is None
        assert scan.pixel_count("a") == len(dac)
    assert scan.inputs() == [path]


@pytest.mark.parametrize(
    ("settings", "field", "message"),
    [
        (
            {"views": {"a": ScanRegion()}, "stride": 1},
            "views.a",
            "give corners, path, or a rough pose and corners_at",
        ),
        (
            {"views": {"a": ScanRegion(BOX, "x")}, "stride": 1},
            "views.a",
            "give corners, path, or a rough pose and corners_at",
        ),
        ({"views": {"a": ScanRegion(BOX[:3])}, "stride": 1}, "views.a.corners", "must be 4 pairs"),
        (
            {"views": {"a": ScanRegion([[1]] * 4)}, "stride": 1},
            "views.a.corners",
            "must be 4 pairs",
        ),
        ({"views": {"a": ScanRegion(BOX)}}, "views.a", "has corners only"),
        ({"pixels": [3, 4], "stride": 1}, "pixels", "give either pixels or stride"),
        ({"pixels": [3]}, "pixels", "must be two positive numbers"),
        ({"pixels": [3, 0]}, "pixels", "must be two positive numbers"),
        ({"stride": 0}, "stride", "must be 1 or more"),
        ({"views": {"a/b": ScanRegion(path="x")}}, "views", "one that a folder can have"),
        ({"sampling": Sampling(frequency=[20000.0])}, "sampling.frequency", "needs a rate above"),
        ({"sampling": Sampling(records=1)}, "sampling.records", "must be 2 or more"),
        ({"sampling": Sampling(again=-1)}, "sampling.again", "must be 0 or more"),
        ({"sampling": Sampling(spare=-1.0)}, "sampling.spare", "must be zero or a pos"),
        ({"sampling": chirp(band=[500.0])}, "sampling.band", "two increasing positive freq"),
        ({"sampling": chirp(band=[50.0, 15000.0])}, "sampling.band", "needs a rate above 30000"),
        ({"sampling": chirp(band=[51.0, 54.0])}, "sampling.band", "no line of a record of 0.02 s"),
        ({"sampling": chirp(lines=LineChoice.odd)}, "sampling.lines", "can be chosen of multisine"),
        ({"sampling": chirp("hammer", trigger=Trigger.free)}, "sampling.trigger", "holds a part"),
    ],
)
def test_wrong_rectangles(settings, field, message):
    assert message in problems(Rectangle, **settings)[field]


@pytest.mark.parametrize(
    ("settings", "field", "message"),
    [
        (
            {"views": {"a": PixelSequence()}},
            "views.a",
            "give dac, path, or a rough pose and pixels_at",
        ),
        ({"views": {"a": PixelSequence([[1, 2, 3]])}}, "views.a.dac", "must be pairs"),
        ({"sampling": Sampling(samples=3)}, "sampling.samples", "at least 16"),
        (
            {"views": {"..": PixelSequence(path="x")}},
            "views",
            "must begin with a letter, a digit or _",
        ),
    ],
)
def test_wrong_lists(settings, field, message):
    assert message in problems(PixelList, **settings)[field]


def parts(**views):
    made = {
        "calibration": lambda v: CalibrationScan(views={k: Centres([[0, 0]]) for k in v}),
        "structure": lambda v: Rectangle(views={k: ScanRegion(BOX) for k in v}, stride=1),
        "pixels": lambda v: PixelList(views={k: PixelSequence([[0, 0]]) for k in v}),
    }
    return {name: made[name](v) for name, v in views.items()}


def test_a_session_has_its_parts_in_every_view():
    session = Session(**parts(calibration="ab", structure="b", pixels="a"))
    assert isinstance(session, Scan)
    assert session.view_names() == ["a", "b"]
    assert session.parts("a") == [session.calibration, session.pixels]
    assert session.parts("b") == [session.calibration, session.structure]
    assert all(isinstance(p, ScanPart) for p in session.parts("a"))
    assert Session().view_names() == []


@pytest.mark.parametrize(
    ("views", "field", "message"),
    [
        ({"calibration": "a", "structure": "ab"}, "calibration.views", "lacks the view b"),
        ({"calibration": "abc", "structure": "b"}, "structure.views", "lacks the view a, c"),
        (
            {"calibration": "ab", "structure": "a", "pixels": "ab"},
            "pixels.views",
            "has the view a, of which structure",
        ),
    ],
)
def test_a_session_leaves_no_view_out(views, field, message):
    assert message in problems(Session, **parts(**views))[field]


def test_inputs_of_a_session_are_those_of_its_parts():
    session = Session(
        calibration=CalibrationScan(views={"a": Centres(path="Scan6pt")}),
        structure=Rectangle(views={"a": ScanRegion(path="ScanRect")}),
    )
    assert session.inputs() == ["Scan6pt", "ScanRect"]


def test_settings_of_a_part_are_named_in_full(sldvexp):
    done = sldvexp(
        "~experiment",
        "scan=session",
        "scan.structure.views={a: {corners: [[1, 2]]}}",
        "scan.structure.stride=0",
        "scan.calibration.views={a: {dac: [[1]]}}",
    )
    assert done.status == 1
    where = "sldvexp: command line: scan"
    assert done.err.splitlines() == [
        f"{where}.calibration.views.a.dac must be pairs [up_down, left_right]",
        f"{where}.structure.stride must be 1 or more, not 0",
        f"{where}.structure.views.a.corners must be 4 pairs [up_down, left_right]",
    ]


def test_averages_take_their_time():
    averages = chirp(rate=5120.0, samples=1024, records=10, lead=1)
    scan = Rectangle(views={"a": ScanRegion(BOX)}, pixels=[2, 3], sampling=averages)
    assert scan.seconds("a") == pytest.approx(6 * 11 * 0.2)


def test_circles_are_found_by_one_sine():
    told = problems(CalibrationScan, views={"a": Centres([[0, 0]])}, sampling=chirp())
    assert "must be sine" in told["sampling.excitation"]
