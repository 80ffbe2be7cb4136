"""The bench does what is wished, looks from coarse to fine, and leaves the instrument safe."""

from __future__ import annotations

import json
import struct
from dataclasses import replace

import numpy as np
import pytest

from sldvexp.console import bench as bench_module
from sldvexp.console.bench import AimingBench
from sldvexp.errors import UserError
from sldvexp.instrument.visa import Visa
from sldvexp.scan import Sampling
from sldvexp.signal import ExcitationKind
from sldvexp.virtual_lab.lab import VirtualLab
from sldvexp.virtual_lab.server import Fault, LabServer


class Seen:
    """What a browser has seen of a board."""

    def __init__(self, board):
        self.board, self.reader = board, board.reader(lambda: None)
        self.topics, self.parts = {}, []

    def look(self):
        more = True
        while more:
            news, more = self.board.news(self.reader)
            for each in news:
                if isinstance(each, str):
                    word = json.loads(each)
                    self.topics[word["topic"]] = word["word"]
                else:
                    (length,) = struct.unpack("<I", each[:4])
                    self.parts.append((json.loads(each[4 : 4 + length]), each[4 + length :]))
        return self.topics


@pytest.fixture
def bench(lab_experiment, board, wishes):
    made = AimingBench(lab_experiment, board, wishes)
    yield made
    made.leave()


@pytest.fixture
def seen(board):
    return Seen(board)


@pytest.fixture
def do(bench, wishes):
    """Wish something, and let the bench do it."""

    def done(what, **more):
        wishes.put({"do": what, **more})
        bench.turn()

    done("taken")
    return done


@pytest.fixture
def lab(lab_experiment):
    e = lab_experiment
    return VirtualLab(e.scene, e.laser, e.target, e.seed)


@pytest.fixture
def far(lab_experiment, board, wishes, lab):
    """A bench whose instrument is spoken to over a socket."""
    with LabServer(lab) as server:
        instrument = Visa(resource=server.resource, timeout=5.0, retries=0)
        made = AimingBench(replace(lab_experiment, instrument=instrument), board, wishes)
        wishes.put({"do": "taken"})
        made.turn()
        yield made, server
        made.leave()


def test_beam_goes_where_it_is_sent_and_not_beyond_the_board(bench, do, seen):
    do("move", to=[120, -40])
    assert seen.look()["beam"] == [120, -40]
    do("nudge", by=[-20, 100])
    assert seen.look()["beam"] == [100, 60]
    do("move", to=[5000, -99999])
    assert seen.look()["beam"] == [4096, -4096]
    assert bench._instrument.position == (4096, -4096)


def test_circle_tells_also_where_it_was_predicted_since_the_scan_finds_its_middle(bench, do):
    do("go", kind="circle", number=1, to=[120, -40])
    do("mark", kind="circle", number=1)
    assert bench.marks.telling("1") == {("circle", 1): (120, -40)}


@pytest.mark.parametrize(
    "wish",
    [
        {"do": "move"},
        {"do": "move", "to": [1]},
        {"do": "move", "to": [1.5, 2]},
        {"do": "move", "to": [True, 2]},
        {"do": "move", "to": "12"},
        {"do": "move", "to": [None, 1]},
        {"do": "mark", "kind": "circle", "number": 9},
        {"do": "mark", "kind": "circle", "number": True},
        {"do": "mark", "kind": "nothing", "number": 1},
        {"do": "mark", "kind": ["circle"], "number": 1},
        {"do": "view", "name": "nowhere"},
        {"do": "view", "name": ["1"]},
        {"do": "kind", "kind": {}},
        {"do": "look", "low": [5000, 5000], "high": [6000, 6000]},
        {"do": "undo"},
        {"do": "_leave"},
    ],
    ids=str,
)
def test_wish_that_cannot_be_is_told_and_changes_nothing(bench, do, seen, wish):
    do(wish.pop("do"), **wish)
    assert seen.look()["said"]["problem"]
    assert (bench.beam, bench.marks.of("1"), bench._instrument) == ((0, 0), {}, None)


def test_a_problem_goes_when_the_next_action_succeeds(bench, do, seen):
    do("undo")
    assert seen.look()["said"]["problem"]
    do("release")  # of an arrow that could not move
    assert seen.look()["said"]["problem"]
    do("mark", kind="circle", number=1)
    assert (seen.look()["said"]["text"], seen.topics["said"]["problem"]) == ("", False)


def test_marks_are_taken_taken_back_and_repeated_across_views(bench, do, seen):
    do("move", to=[10, 20])
    do("mark", kind="circle", number=1)
    do("view", name="2")
    assert bench.beam == (0, 0)  # another view is another place of the instrument
    do("move", to=[30, 40])
    do("mark", kind="corner", number=2)
    marks = seen.look()["marks"]
    assert [(m["kind"], m["number"], m["dac"]) for m in marks["marks"]] == [("corner", 2, [30, 40])]
    do("undo")
    assert seen.look()["marks"]["marks"] == []
    do("undo")
    assert (seen.look()["marks"]["view"], bench.marks.of("1")) == ("1", {})
    do("redo")
    do("redo")
    assert (bench.view, bench.marks.of("2")) == ("2", {("corner", 2): (30, 40)})


def test_three_circles_tell_where_the_fourth_and_the_corners_lie(bench, do, seen, lab):
    true = np.rint(lab.true_dac(lab.calibration_object.center)).astype(int)
    for number, place in enumerate(true[:3].tolist(), 1):
        do("move", to=place)
        do("mark", kind="circle", number=number)
    marks = seen.look()["marks"]
    predicted = {(p["kind"], p["number"]): p["dac"] for p in marks["predicted"]}
    np.testing.assert_allclose(predicted["circle", 4], true[3], atol=15)
    # As the example's operator saw the plate, whose rim the volume leaves out.
    corners = np.array([predicted["corner", k] for k in (1, 2, 3, 4)])
    seen_then = bench.experiment.scan.structure.views["1"].corners
    for limit in (np.min, np.max):
        np.testing.assert_allclose(limit(corners, axis=0), limit(seen_then, axis=0), atol=60)
    # As seen: lower left, lower right, upper right, upper left; steps grow upwards and to the left.
    (first, second, third, fourth), middle = corners, corners.mean(axis=0)
    assert (first > middle).tolist() == [False, True]
    assert (second > middle).tolist() == [False, False]
    assert (third > middle).tolist() == [True, False]
    assert (fourth > middle).tolist() == [True, True]
    assert len(marks["outlines"]) == 5
    do("move", to=(true[3] + [90, 0]).tolist())
    do("mark", kind="circle", number=4)
    marks = {m["number"]: m for m in seen.look()["marks"]["marks"]}
    assert marks[4]["off"] > 20
    assert "contradict" in seen.topics["marks"]["pose"]


@pytest.fixture
def broadband(lab_experiment, board, wishes):
    """A bench for a structure that a multisine excites."""
    how = {"excitation": ExcitationKind.multisine, "band": [50.0, 1325.0], "records": 10}
    sampling = Sampling(rate=5120.0, samples=1024, **how)
    scan = replace(lab_experiment.scan.structure, sampling=sampling)
    made = AimingBench(replace(lab_experiment, scan=scan), board, wishes)
    made._taken({})
    yield made
    made.leave()


def looked_at(bench, seen, low, high):
    """Look quickly at a window until its pixels are found; the headers of the last look."""
    bench._begin_look({"low": low, "high": high})
    while bench._look is not None:
        bench.turn()
    seen.look()
    parts = [h for h, _ in seen.parts if h["picture"] == "raster"]
    begun = max(i for i, h in enumerate(parts) if "cell" not in h)
    return parts[begun + 1 :]


@pytest.mark.whole
def test_broadband_scan_is_looked_at_where_most_moves(broadband, seen):
    parts = looked_at(broadband, seen, [-1500, -1600], [1500, 400])
    assert {h["frequency"] for h in parts} == {440.0}  # of a mode that moves all over the plate
    assert {h["among"] for h in parts} == {256}


def test_broadband_scan_of_a_known_region_is_looked_at_there(broadband, seen):
    for number, corner in enumerate([(-600, 100), (600, 100), (600, -1400), (-600, -1400)], 1):
        broadband.marks.put("1", ("corner", number), corner)
    parts = looked_at(broadband, seen, [1900, 1900], [1930, 1930])
    assert {h["frequency"] for h in parts} == {440.0}


def test_what_does_not_move_is_looked_at_in_the_middle_of_the_band(broadband, seen):
    parts = looked_at(broadband, seen, [1800, 1800], [1900, 1900])
    (hertz,) = {h["frequency"] for h in parts}
    assert hertz == pytest.approx(np.sqrt(50.0 * 1325.0))
    assert {h["among"] for h in parts} == {1}


def test_quick_look_goes_from_coarse_to_fine_and_shows_what_moves(bench, do, seen, lab):
    x, y = np.rint(lab.true_dac(lab.calibration_object.center[0])).astype(int).tolist()
    do("look", low=[x - 200, y - 200], high=[x + 200, y + 200])
    while bench._look is not None:
        bench.turn()
    seen.look()
    parts = [(h, rest) for h, rest in seen.parts if h["picture"] == "raster" and "cell" in h]
    cells = [h["cell"] for h, _ in parts]
    assert cells == sorted(cells, reverse=True)
    assert (cells[0], cells[-1]) == (50, 4)
    assert {h["frequency"] for h, _ in parts} == set(bench._sampling().excitation)
    header, rest = parts[-1]
    (_, pairs), (_, count), *_ = header["arrays"]
    dac = np.frombuffer(rest, "<i4", pairs).reshape(-1, 2)
    value = np.frombuffer(rest, "<f4", count, 4 * pairs)
    assert value.max() < 1  # the last part is beside the circle
    everything = [
        (
            np.frombuffer(r, "<i4", h["arrays"][0][1]).reshape(-1, 2),
            np.frombuffer(r, "<f4", h["arrays"][1][1], 4 * h["arrays"][0][1]),
        )
        for h, r in parts
    ]
    dac, value = (np.concatenate(part) for part in zip(*everything, strict=True))
    near = np.hypot(*(dac - [x, y]).T) < 40
    assert value[near].min() > 5 > 1 > np.median(value[np.hypot(*(dac - [x, y]).T) > 180])
    assert bench.beam == (0, 0)
    assert bench._instrument.position == (0, 0)  # the beam is back where it was sent


def test_quick_look_has_the_level_of_the_reference_too(bench, do, seen):
    do("look", low=[-500, -500], high=[500, 500])
    bench.turn()
    seen.look()
    header, body = seen.parts[-1]
    (_, pairs), (_, count), (_, flags), (kind, level) = header["arrays"]
    assert (kind, level) == ("f4", count)
    at = 4 * pairs + 4 * count + -(-flags // 4) * 4
    reference = np.frombuffer(body, "<f4", level, at)
    np.testing.assert_allclose(reference, 1, atol=0.05)  # V, as the generator plays


def test_look_is_stopped_and_a_move_comes_between_its_parts(bench, do, seen):
    do("look", low=[-4096, -4096], high=[4096, 4096])
    bench.turn()
    do("move", to=[7, 7])
    assert (seen.look()["beam"], bench._look is None) == ([7, 7], False)
    do("stop_look")
    assert (seen.look()["looking"], bench._look) == (False, None)


def test_look_ends_when_marks_of_another_part_come_next_which_is_sampled_otherwise(bench, do, seen):
    do("look", low=[-4096, -4096], high=[4096, 4096])
    do("kind", kind="circle")
    assert seen.look()["looking"]
    do("kind", kind="corner")
    assert (seen.look()["looking"], bench._look) == (False, None)


def test_level_and_picture_are_told_where_the_beam_stands(bench, do, seen, lab):
    place = np.rint(lab.true_dac(lab.calibration_object.center[1])).astype(int).tolist()
    do("move", to=place)
    bench.turn()
    level = seen.look()["level"]
    assert level["velocity"] > 5
    assert level["reference"] == pytest.approx(1, abs=0.05)
    assert level["velocity"] > 50 * level["noise"] > 0
    assert (0 < level["light"] <= 1, level["flags"]) == (True, [])
    (camera,) = [h for h, _ in seen.parts if h["picture"] == "camera"]
    assert (camera["rows"], camera["columns"]) == (150, 200)


def test_held_arrow_moves_on_and_stops_when_the_page_does_not_say_so_any_more(
    bench, do, monkeypatch
):
    clock = [100.0]
    monkeypatch.setattr(bench_module.time, "monotonic", lambda: clock[0])
    do("hold", by=[0, 10])
    for _ in range(3):
        bench.turn()
    assert bench.beam == (0, 30)
    clock[0] += bench_module.HELD + 0.1
    bench.turn()
    bench.turn()
    assert (bench.beam, bench._held) == ((0, 30), None)


def test_lost_connection_in_mid_move_sends_the_mirrors_home_and_stops_the_generator(
    far, wishes, lab, monkeypatch
):
    monkeypatch.setattr(bench_module, "HELD", 300.0)  # however busy the machine is
    bench, server = far
    monkeypatch.setattr(bench_module, "HELD", 60.0)  # however long the four turns take
    wishes.put({"do": "hold", "by": [5, 100]})
    for _ in range(4):
        bench.turn()
    assert lab.position == (15, 300)
    assert server.dialect.playing
    wishes.put({"do": "lost"})
    bench.turn()
    bench.turn()  # and nothing moves any more
    assert (lab.position, server.dialect.playing, bench._held) == ((0, 0), False, None)


def test_lost_connection_in_a_quick_look_does_the_same(far, wishes, lab):
    bench, server = far
    wishes.put({"do": "look", "low": [-500, -500], "high": [500, 500]})
    bench.turn()
    bench.turn()
    assert server.dialect.playing
    wishes.put({"do": "lost"})
    bench.turn()
    assert (lab.position, server.dialect.playing, bench._look) == ((0, 0), False, None)


def test_who_comes_after_a_lost_controller_goes_on(far, wishes, lab):
    bench, _ = far
    for wish in ({"do": "lost"}, {"do": "taken"}, {"do": "move", "to": [3, 4]}):
        wishes.put(wish)
        bench.turn()
    assert lab.position == (3, 4)


def test_level_position_and_picture_come_over_the_socket(far, wishes, seen):
    bench, _ = far
    wishes.put({"do": "move", "to": [-371, 1322]})
    bench.turn()
    bench.turn()
    level = seen.look()["level"]
    assert level["velocity"] > 5
    assert [h["columns"] for h, _ in seen.parts if h["picture"] == "camera"] == [200]


class Silent(Fault):
    """An instrument that does not answer."""

    def spoil(self, answer, send, server):
        send(b"")


def test_fault_of_the_instrument_is_told_and_the_bench_goes_on(far, wishes, seen, lab):
    bench, server = far
    bench._ready()
    server.faults.append(Silent("SYST:ERR?", times=1))
    wishes.put({"do": "move", "to": [3, 4]})
    bench._instrument.profile  # noqa: B018 (it is opened)
    bench._instrument._persistently._dialogue.timeout = 0.2
    bench.turn()
    assert seen.look()["said"]["problem"]
    assert "no answer" in seen.topics["said"]["text"]
    wishes.put({"do": "move", "to": [5, 6]})
    bench.turn()
    assert lab.position == (5, 6)


def test_lost_instrument_leaves_no_picture_behind_and_is_told_when_it_is_back(
    far, wishes, seen, lab, monkeypatch
):
    monkeypatch.setattr(bench_module, "RETRY", bench_module.LEVEL)
    bench, server = far
    wishes.put({"do": "move", "to": [-371, 1322]})
    bench.turn()
    bench.turn()
    assert [h for h, _ in seen_pictures(seen) if "rows" in h]
    port = int(server.resource.split("::")[2])
    server.__exit__()
    bench.turn()
    assert "The instrument: " in seen.look()["said"]["text"]
    assert (seen.topics["level"], seen.topics["beam"]) == (None, [0, 0])
    header, _ = seen_pictures(seen)[-1]
    assert (header["begin"], header["arrays"]) == (True, [])
    with LabServer(lab, port=port):
        bench.turn()
        assert seen.look()["said"] | {"at": 0} == {
            "text": "The instrument answers again.",
            "problem": False,
            "at": 0,
        }
        assert seen.topics["level"] is not None
        bench.leave()


def test_instrument_that_fails_again_and_again_is_not_told_of_as_often(
    lab_experiment, board, wishes, lab, monkeypatch, caplog
):
    monkeypatch.setattr(bench_module, "RETRY", 0.01)
    monkeypatch.setattr("sldvexp.instrument.dialogue.PAUSE", 0.0)
    with LabServer(lab) as server:
        instrument = Visa(resource=server.resource, retries=1)
        bench = AimingBench(replace(lab_experiment, instrument=instrument), board, wishes)
        wishes.put({"do": "taken"})
        bench.turn()
        monkeypatch.setitem(server.dialect._questions, "DATA?", lambda: b"#13abc")
        for _ in range(12):
            bench.turn()
        told = [r.getMessage() for r in caplog.records]
        assert len(told) == 2, told
        assert told[0].endswith("; trying again")
        assert told[1] == f"{told[0]} (for the 10th time)"
        bench.leave()


def test_console_that_ends_with_a_lost_instrument_says_so_in_a_sentence(far):
    bench, server = far
    bench._ready()
    server.__exit__()
    bench.turn = lambda: (_ for _ in ()).throw(KeyboardInterrupt)
    with pytest.raises(UserError, match="the mirrors may not be home"):
        bench.serve()


def seen_pictures(seen):
    """Parts of the camera's picture that a browser has had."""
    seen.look()
    return [(h, body) for h, body in seen.parts if h["picture"] == "camera"]


def test_nothing_is_sampled_while_nobody_steers(bench, board, wishes):
    bench.turn()
    assert bench._instrument is None
