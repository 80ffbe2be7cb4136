"""Fiducials that are aimed at on the page, for poses by hand."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.config.experiment import Experiment
from sldvexp.console import Console
from sldvexp.console.bench import AimingBench
from sldvexp.console.marks import FIDUCIAL, AimedMarks, wanted
from sldvexp.console.scanning import Asked, Scanning
from sldvexp.dataset.findings import take_findings
from sldvexp.instrument import InstrumentError
from sldvexp.session.session import scan_views
from sldvexp.virtual_lab import VirtualLab
from sldvexp.virtual_lab.console import experiment
from tests.console.test_bench import Seen

HAND = [
    *("~experiment", "target=fiducials", "scene=annular_plate", "scan=by_hand"),
    *("instrument=simulated", "pose=registration"),
    "scene.views={a: {euler: [0.1, 2.9, 0.3], origin: [0.3, 0.2, 1.7]}}",
    # How the plate moves does not matter, and each shape has to be found.
    *(f"~scene.plate.modes.{n}_diameter{'s' * (n != 'one')}" for n in ("one", "two", "three")),
]


@pytest.fixture(scope="module")
def by_hand():
    return experiment(HAND)


@pytest.fixture
def lab(by_hand):
    return VirtualLab(by_hand.scene, by_hand.laser, by_hand.target, 0)


def true_steps(by_hand, lab):
    return np.rint(lab.true_dac(by_hand.target.points().position)).astype(int).tolist()


def test_marks_of_the_target_are_wanted_and_predicted_from_the_third_on(
    by_hand, lab, board, wishes
):
    bench, seen = AimingBench(by_hand, board, wishes), Seen(board)
    steps = true_steps(by_hand, lab)
    numbers = wanted(by_hand)[FIDUCIAL]
    assert len(numbers) == len(steps) > 4

    def take(number, place):
        wishes.put({"do": "move", "to": place})
        wishes.put({"do": "mark", "kind": FIDUCIAL, "number": number})
        while not wishes.empty():
            bench.turn()
        return seen.look()["marks"]

    marks = None
    wishes.put({"do": "taken"})
    for number, place in list(zip(numbers, steps, strict=True))[:4]:
        three, marks = marks, take(number, place)
    several = {p["number"]: [p["dac"], *p["instead"]] for p in three["predicted"]}
    off = np.hypot(*(np.array(several[numbers[3]]) - steps[3]).T)
    assert len(off) > 1
    assert off.min() < 20  # one of the poses that three marks fit is the right one
    assert "Go there (g) again goes to where it may be instead." in three["pose"]
    predicted = {p["number"]: p["dac"] for p in marks["predicted"]}
    np.testing.assert_allclose(predicted[numbers[4]], steps[4], atol=20)
    assert not any(p["instead"] for p in marks["predicted"])
    assert seen.topics["said"]["problem"] is False
    bench.leave()


def test_marks_taken_where_they_were_predicted_tell_nothing(by_hand, lab, board, wishes, tmp_path):
    """By g and m alone they would confirm any pose: told, not used, and left out by the scan."""
    bench, seen = AimingBench(by_hand, board, wishes), Seen(board)
    numbers = wanted(by_hand)[FIDUCIAL]
    steps = dict(zip(numbers, true_steps(by_hand, lab), strict=True))

    def do(what, number=None, **more):
        wishes.put({"do": what, "kind": FIDUCIAL, "number": number, **more})
        bench.turn()
        return seen.look()["marks"]

    do("taken")
    do("view", name="a")
    for number in numbers[:4]:
        do("move", to=steps[number])
        marks = do("mark", number)
    by_four = marks["pose"]
    for number in numbers[4:6]:
        (place,) = [p["dac"] for p in marks["predicted"] if p["number"] == number]
        do("go", number, to=place)
        marks = do("mark", number)
        assert f"Mark {number}: taken where it was predicted" in seen.topics["said"]["text"]
    left_out = " Left out: marks 5 and 6, taken where the program alone had put the beam."
    assert marks["pose"] == by_four + left_out  # it stands no surer
    assert [m["number"] for m in marks["marks"] if m.get("unmoved")] == numbers[4:6]

    made = experiment([*HAND, f"scan.views={{a: {{hidden: {numbers[6:]}}}}}"])

    def scanned():
        watcher = Scanning(made, board, wishes)
        found = scan_views(made, tmp_path, Asked(watcher, bench.marks), watcher=watcher)
        watcher.end()
        return found["registration"]["point"].values.tolist(), take_findings(found)

    points, (finding,) = scanned()
    assert points == numbers[:4]
    assert finding.kind == "unmoved_marks"
    do("undo")
    for by in ([1, 0], [-1, 0]):  # off and back
        do("nudge", by=by)
    marks = do("mark", number)
    assert bench.marks.of("a")[FIDUCIAL, number] == tuple(place)
    assert [m["number"] for m in marks["marks"] if m.get("unmoved")] == numbers[4:5]
    points, (finding,) = scanned()  # in the same folder, which has kept what was taken before
    assert points == [*numbers[:4], number]
    bench.leave()


def test_marks_tell_that_a_hand_has_taken_before_or_that_are_taken_at_another_ones_place(
    by_hand, board, wishes
):
    bench = AimingBench(by_hand, board, wishes)

    def do(what, number=None, to=None):
        wishes.put({"do": what, "name": "a", "kind": FIDUCIAL, "number": number, "to": to})
        bench.turn()
        return [number for _, number in bench.marks.of("a").keys() - bench.marks.telling("a")]

    for what, number, to, unmoved in (
        ("taken", None, None, []),
        ("view", None, None, []),
        ("go", 1, [5, 6], []),
        ("mark", 2, None, []),  # at what was predicted of mark 1
        ("mark", 1, None, [1]),
        ("undo", None, None, []),
        ("redo", None, None, [1]),
        ("go", 1, [5, 6], [1]),
        ("mark", 1, None, [1]),
        ("move", None, [7, 8], [1]),
        ("mark", 1, None, []),
        ("go", 1, [7, 8], []),
        ("mark", 1, None, []),
        ("undo", None, None, []),
        ("undo", None, None, [1]),
        ("go", 3, [0, 0], [1]),
        ("view", None, None, [1]),  # which sends the beam home
        ("mark", 3, None, [1]),
    ):
        assert do(what, number, to) == unmoved
    bench.leave()


def test_no_scan_begins_of_a_view_of_which_the_program_alone_has_taken_all(by_hand, tmp_path):
    one = Console(by_hand, HAND, tmp_path, None, None)
    for number in (1, 2):
        one.bench.marks.put("a", (FIDUCIAL, number), (number, 3), unmoved=True)
    one.bench._safely(lambda: one.bench.further["scan"]({"do": "scan", "name": "aimed"}))
    told = Seen(one.board).look()["said"]
    assert told["problem"]
    assert told["text"].startswith("every mark of view a was taken where it was predicted")
    assert not list(tmp_path.iterdir())


@pytest.mark.whole
def test_scan_gets_the_places_that_were_aimed_at_and_hides_the_others(
    by_hand, lab, board, wishes, tmp_path
):
    marks, numbers = AimedMarks(), wanted(by_hand)[FIDUCIAL]
    steps = dict(zip(numbers, true_steps(by_hand, lab), strict=True))
    for number in numbers[:5]:
        marks.put("a", (FIDUCIAL, number), tuple(steps[number]))
    settings = marks.settings(by_hand)
    assert settings == {"views": {"a": {"hidden": numbers[5:]}}}
    made = experiment([*HAND, f"scan.views={{a: {{hidden: {numbers[5:]}}}}}"])
    watcher = Scanning(made, board, wishes)
    found = scan_views(made, tmp_path, Asked(watcher, marks), watcher=watcher)
    watcher.end()
    assert found["registration"]["dac"].values[0].tolist() == [steps[n] for n in numbers[:5]]


def test_nobody_digitises_who_only_pointed():
    marks = AimedMarks()
    marks.put("a", (FIDUCIAL, 1), (1, 2))
    assert marks.person("b") is None
    with pytest.raises(InstrumentError, match="nobody digitises"):
        marks.person("a").digitise(1, 7)


def test_scan_without_marks_of_its_own_wants_nothing():
    assert wanted(Experiment(scan=experiment(["experiment=plate"]).scan.pixels)) == {}


@pytest.mark.whole
def test_mark_that_is_aimed_anew_replaces_a_kept_one_that_gives_no_trouble(
    by_hand, lab, board, wishes, tmp_path
):
    numbers = wanted(by_hand)[FIDUCIAL]
    steps = dict(zip(numbers, map(tuple, true_steps(by_hand, lab)), strict=True))
    made = experiment([*HAND, "scan.views={a: {hidden: []}}"])

    def scanned(marks):
        watcher = Scanning(made, board, wishes)
        found = scan_views(made, tmp_path, Asked(watcher, marks), watcher=watcher)
        watcher.end()
        dac = found["registration"]["dac"].values[0].tolist()
        return dict(zip(numbers, map(tuple, dac), strict=True)), take_findings(found)

    marks = AimedMarks()
    for number, place in steps.items():
        marks.put("a", (FIDUCIAL, number), place)
    assert scanned(marks) == (steps, [])
    # One step beside is no trouble for anybody, and still what was taken last.
    up, left = steps[numbers[1]]
    marks.put("a", (FIDUCIAL, numbers[1]), (up + 1, left))
    found, told = scanned(marks)
    assert found == steps | {numbers[1]: (up + 1, left)}
    assert [finding.text for finding in told] == [
        f"in view a, mark {numbers[1]} counts as it was aimed last, {up + 1} {left}, in place of "
        f"{up} {left}"
    ]
    assert scanned(marks) == (found, [])
