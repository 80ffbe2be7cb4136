"""A scan that knows roughly where the instrument stands: predicted at once, searched, painted."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from sldvexp.cli.aim import PosedView, Surroundings, known_lines
from sldvexp.console.bench import AimingBench
from sldvexp.console.board import NoticeBoard
from sldvexp.console.marks import CIRCLE
from sldvexp.console.outlook import Outlook, _metres, circle_rims
from sldvexp.console.scanning import Asked, Scanning
from sldvexp.errors import UserError
from sldvexp.geometry import KnownPose
from sldvexp.laser import dac_of_points
from sldvexp.scan.rectangle import ScanRegion
from sldvexp.scan.session import Session
from sldvexp.session.session import scan_views
from sldvexp.units import LengthUnit
from sldvexp.virtual_lab.console import experiment
from sldvexp.virtual_lab.lab import VirtualLab
from tests.console.test_bench import Seen

M = LengthUnit.m
CORNERS = [[0.34, -0.02, 0], [0.62, -0.02, 0], [0.62, 0.2, 0], [0.34, 0.2, 0]]


class Noted(NoticeBoard):
    """A board that remembers which pictures were begun, and all that was told of a scan."""

    def __init__(self):
        super().__init__()
        self.begun, self.told = [], []

    def begin(self, picture, arrays=(), **header):
        self.begun += [header] if picture == "image" else []
        super().begin(picture, arrays, **header)

    def tell(self, topic, word):
        self.told += [word] if topic == "scan" else []
        super().tell(topic, word)


def beside(pose, *, by):
    """A pose as a person says it, who misses the place by some metres."""
    return KnownPose(pose.euler, (pose.place + by).tolist())


@pytest.fixture(scope="module")
def rough(lab_experiment):
    """A session of one view of the plate, of few pixels, from a rough pose."""
    e = lab_experiment
    calibration = replace(
        e.scan.calibration, views={}, fine=replace(e.scan.calibration.fine, lines=6)
    )
    structure = replace(e.scan.structure, views={}, pixels=[6, 7], corners_at=CORNERS)
    pose = beside(e.scene.views["1"], by=[0.015, -0.01, 0.01])
    return replace(e, scan=Session(calibration, structure, poses={"1": pose}))


@pytest.fixture
def seen(board):
    return Seen(board)


@pytest.fixture
def bench(rough, board, wishes):
    made = AimingBench(rough, board, wishes)
    wishes.put({"do": "taken"})
    made.turn()
    yield made
    made.leave()


@pytest.fixture(scope="module")
def circles(lab_experiment):
    e = lab_experiment
    lab = VirtualLab(e.scene, e.laser, e.target, e.seed)
    lab.use_view("1")
    return lab.true_dac(lab.calibration_object.center)


def predicted(marks):
    return {(p["kind"], p["number"]): np.array(p["dac"]) for p in marks["predicted"]}


def test_all_is_predicted_and_drawn_before_anything_is_marked(bench, seen, circles):
    marks = seen.look()["marks"]
    found = predicted(marks)
    assert sorted(found) == [(k, n) for k in ("circle", "corner") for n in (1, 2, 3, 4)]
    for number, true in enumerate(circles, 1):
        assert 1 < np.hypot(*(found["circle", number] - true)) < 150
    assert len(marks["outlines"]) == 5
    assert marks["pose"].startswith("By the scan's rough pose the instrument stands at about (")
    assert "scan at once" in marks["pose"]


def test_every_mark_corrects_the_others(bench, wishes, seen, circles):
    before = predicted(seen.look()["marks"])["circle", 4]
    for number, true in enumerate(np.rint(circles[:2]).astype(int).tolist(), 1):
        for wish in (
            {"do": "move", "to": true},
            {"do": "mark", "kind": "circle", "number": number},
        ):
            wishes.put(wish)
            bench.turn()
    marks = seen.look()["marks"]
    after = predicted(marks)["circle", 4]
    assert np.hypot(*(after - circles[3])) < 0.5 * np.hypot(*(before - circles[3]))
    assert "corrected by 2 marks" in marks["pose"]


def test_rough_pose_that_is_none_gives_way_to_three_marks(rough, circles):
    wrong = beside(rough.scan.poses["1"], by=[0.6, 0.3, 0.2])
    outlook = Outlook(
        replace(rough, scan=replace(rough.scan, poses={"1": wrong})),
        {"circle": [1, 2, 3, 4], "corner": [1, 2, 3, 4]},
    )
    marks = {("circle", n): tuple(np.rint(c).astype(int)) for n, c in enumerate(circles[:3], 1)}
    found = outlook.of(marks, "1")
    assert not found.told.startswith("By the scan's rough pose")
    assert found.wrong == (
        "circle 1, circle 2 and circle 3 do not agree with the rough pose: take them again, or "
        "correct that pose"
    )
    np.testing.assert_allclose(found.predicted["circle", 4], circles[3], atol=15)


def taken(circles, *pairs):
    """Circles by their numbers, each at the place of another or of its own."""
    return {("circle", n): tuple(np.rint(circles[k - 1]).astype(int).tolist()) for n, k in pairs}


def test_a_wrong_second_mark_is_taken_once_and_named(bench, wishes, seen, circles):
    for name, steps in taken(circles, (3, 3), (1, 4)).items():
        for wish in ({"do": "move", "to": list(steps)}, {"do": "mark", "kind": "circle"}):
            wishes.put(wish | ({"number": name[1]} if wish["do"] == "mark" else {}))
            bench.turn()
    marks = seen.look()["marks"]
    assert [m["number"] for m in marks["marks"]] == [1, 3]
    assert not seen.topics["said"]["problem"]
    assert re.search(
        r"But circle 1 lies 9\d\d steps from where the rough pose and circle 3 put it: take it or "
        "circle 3 again, or correct the rough pose",
        marks["pose"],
    )
    assert np.hypot(*(predicted(marks)["circle", 1] - circles[0])) < 30
    wishes.put({"do": "undo"})
    bench.turn()
    assert [m["number"] for m in seen.look()["marks"]["marks"]] == [3]


@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    ("pairs", "told"),
    [
        ([(3, 3), (1, 4), (2, 2)], "circle 1 lies 9"),
        ([(3, 3), (4, 4), (1, 2)], "circle 1 lies 7"),
        ([(2, 2), (3, 3), (4, 4), (1, 3)], "circle 3 and circle 1 were taken at the same place"),
        ([(1, 2), (2, 1), (3, 3)], "circles 1, 2 and 3 are seen from behind"),
    ],
)
def test_no_wrong_mark_drops_the_rough_pose(rough, circles, pairs, told):
    outlook = Outlook(rough, {"circle": [1, 2, 3, 4]})
    found = outlook.of(taken(circles, *pairs), "1")
    assert found.told.startswith("By the scan's rough pose")
    assert found.wrong.startswith(told)
    for number, true in enumerate(circles, 1):
        assert np.hypot(*(found.predicted["circle", number] - true)) < 150


@pytest.mark.parametrize("times", [1, pytest.param(6, marks=pytest.mark.whole)])
def test_right_marks_do_not_doubt_a_rough_pose_within_its_errors(
    rough, lab_experiment, circles, times
):
    rng = np.random.default_rng(4)
    true = lab_experiment.scene.views["1"]
    for _ in range(times):
        turned = (np.array(true.euler) + rng.normal(0, 0.03, 3)).tolist()
        pose = KnownPose(turned, (true.place + rng.normal(0, 0.04, 3)).tolist())
        scan = replace(rough.scan, poses={"1": pose})
        outlook = Outlook(replace(rough, scan=scan), {"circle": [1, 2, 3, 4]})
        for count in (1, 2, 3, 4):
            clicks = circles[:count] + rng.normal(0, 5, (count, 2))
            found = outlook.of(taken(clicks, *((n, n) for n in range(1, count + 1))), "1")
            assert found.wrong == ""
            assert "not with the rough pose" not in found.told


def test_marks_that_agree_go_before_a_rough_pose_and_that_is_told(rough, circles):
    wrong = beside(rough.scan.poses["1"], by=[0.6, 0.3, 0.2])
    scan = replace(rough.scan, poses={"1": wrong})
    outlook = Outlook(replace(rough, scan=scan), {"circle": [1, 2, 3, 4]})
    found = outlook.of(taken(circles, (1, 1), (2, 2), (3, 3), (4, 4)), "1")
    assert found.wrong == ""
    assert "But all marks agree with one another but not with the rough pose" in found.told


def test_a_prediction_that_fails_does_not_hide_what_was_marked(bench, wishes, seen, monkeypatch):
    def failing(*_):
        raise UserError("no pose is near")

    monkeypatch.setattr(bench.outlook, "_foresight", failing)
    wishes.put({"do": "mark", "kind": "circle", "number": 3})
    bench.turn()
    marks = seen.look()["marks"]
    assert [m["number"] for m in marks["marks"]] == [3]
    assert marks["pose"] == "Nothing is predicted: no pose is near."


def test_what_is_not_marked_of_a_view_is_taken_as_predicted(bench, wishes, seen, circles):
    assert bench.settings() == {}  # nothing is marked: the scan's own poses serve
    place = np.rint(circles[0]).astype(int).tolist()
    for wish in ({"do": "move", "to": place}, {"do": "mark", "kind": "circle", "number": 1}):
        wishes.put(wish)
        bench.turn()
    views = {key: part["views"]["1"] for key, part in bench.settings().items()}
    assert views["calibration"]["dac"][0] == place
    np.testing.assert_allclose(views["calibration"]["dac"], circles, atol=100)
    found = predicted(seen.look()["marks"])
    assert views["structure"]["corners"] == [found["corner", k].tolist() for k in (1, 2, 3, 4)]


def test_region_is_that_which_the_scan_has_of_its_own(bench, rough, seen):
    found = predicted(seen.look()["marks"])
    in_steps = rough.scan.in_steps(rough.laser, rough.target)
    wanted = np.array(in_steps.parts("1")[1].views["1"].corners)
    np.testing.assert_allclose([found["corner", k] for k in (1, 2, 3, 4)], wanted, atol=1)


@pytest.mark.parametrize("first", [0, 2])
@pytest.mark.parametrize("turn", [1, -1], ids=["as_read", "other_way_round"])
def test_corners_have_one_number_here_and_where_points_are_aimed_at(rough, first, turn):
    corners = np.roll(CORNERS, -first, axis=0)[::turn].tolist()
    structure = replace(rough.scan.structure, corners_at=corners)
    e = replace(rough, scan=replace(rough.scan, structure=structure))
    predicted = Outlook(e, {"corner": [1, 2, 3, 4]}).of({}, "1").predicted
    pose = e.scan.poses["1"]
    aimed = PosedView("1", pose.rotation, pose.place, "as it is said")
    told = list(known_lines(aimed, Surroundings(e.laser, None, e.scan, np.zeros((0, 3, 3))), M))
    box = next(line for line in told if "box that is scanned" in line)
    for k, corner in enumerate(corners, 1):
        own = dac_of_points(np.array([corner]), pose.rotation, pose.place, e.laser, ["it"])[0]
        assert f"corner {k} ({corner[0]:.5f}, {corner[1]:.5f}, " in told[k - 1]
        assert np.abs(own - predicted["corner", k]).max() < 60  # of 700 and more between corners
        assert "corner {} dac {} {}".format(k, *predicted["corner", k]) in box


def test_region_of_a_view_of_its_own_goes_before_that_of_all(rough):
    own = [[0.4, 0.0, 0], [0.5, 0.0, 0], [0.5, 0.1, 0], [0.4, 0.1, 0]]
    region = ScanRegion(pose=rough.scan.poses["1"], corners_at=own)
    scan = replace(rough.scan.structure, views={"1": region})
    outlook = Outlook(replace(rough, scan=scan), {"corner": [1, 2, 3, 4]})
    found = outlook.of({}, "1").predicted
    wanted = scan.in_steps(rough.laser, rough.target).views["1"].corners
    np.testing.assert_allclose([found["corner", k] for k in (1, 2, 3, 4)], wanted, atol=1)


@pytest.mark.whole
def test_search_each_circle_and_the_image_are_pictures_that_hold_all_their_lines(
    rough, wishes, tmp_path
):
    board = Noted()
    seen, watcher = Seen(board), Scanning(rough, board, wishes)
    try:
        scan_views(rough, tmp_path / "journal", Asked(watcher), watcher=watcher)
    finally:
        watcher.end()
    begun, told = board.begun, board.told
    names = [header["name"] for header in begun if "name" in header]
    assert names[0] == "1 search"
    searches = names.count("1 search")
    assert names[searches:] == ["1 1", "1 2", "1 3", "1 4"] * 2 + ["1 image"]
    assert searches < 12  # of some hundred rings: it is not begun anew for each
    seen.look()
    parts = [(h, body) for h, body in seen.parts if h["picture"] == "image" and "tall" in h]
    header = begun[-1]
    assert sum(part["arrays"][0][1] for part, _ in parts) == 2 * np.prod(
        rough.scan.structure.pixels
    )
    for part, body in parts:
        dac = np.frombuffer(body, "<i4", part["arrays"][0][1]).reshape(-1, 2)
        assert ((dac >= header["low"]) & (dac <= header["high"])).all()
    last = told[-1]["facts"]
    assert last["pixels"] == "{0} of {0}".format(last["pixels"].split(" of ")[0])
    shares = [word["part"] for word in told]
    assert shares == sorted(shares)


@pytest.mark.whole
@pytest.mark.parametrize("times", [1, pytest.param(20, marks=pytest.mark.whole)])
def test_clicks_as_good_as_a_pixel_of_the_page_do_not_contradict_one_another(times):
    """On a board of fine steps a click at a circle is hundreds of them beside its middle."""
    fine = experiment(["experiment=plate", "laser.board=bits_16"])
    lab = VirtualLab(fine.scene, fine.laser, fine.target, 0)
    rims = np.array(circle_rims(fine.target))
    truth = lab.true_dac(rims.mean(axis=1))
    look = Outlook(fine, {CIRCLE: [1, 2, 3, 4]})
    rng = np.random.default_rng(3)
    for _ in range(times):
        clicks = np.rint(truth + rng.normal(0, 50, truth.shape)).astype(int).tolist()
        told = look.of({(CIRCLE, k): tuple(c) for k, c in enumerate(clicks, 1)}, "none").told
        assert "contradict" not in told
    clicks[1] = [clicks[1][0] + 3000, clicks[1][1]]
    told = look.of({(CIRCLE, k): tuple(c) for k, c in enumerate(clicks, 1)}, "none").told
    assert "contradict" in told


def test_a_place_has_as_many_digits_as_its_bound():
    assert _metres(np.array([0.0412, 1.09, 0.985]), 0.0571) == (
        "(0.041, 1.090, 0.985) m, to a standard deviation of 0.057 m"
    )
    assert _metres(np.array([0.0412, 1.09, 0.985])) == "(0.04, 1.09, 0.98) m"
