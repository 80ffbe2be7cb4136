"""Marks aimed at with arrow keys: what moves, what is told, what is taken back, what is kept."""

from __future__ import annotations

import re
from contextlib import contextmanager
from functools import partial

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.instrument import InstrumentError, RawSamples, Status
from sldvexp.instrument.person import read_answer
from sldvexp.laser import Mirror, TwoMirror
from sldvexp.pose.aiming import aiming_at_marks
from sldvexp.session import Camera, Journal, Operator
from sldvexp.session.by_keys import LightLevel, fitting, typed
from sldvexp.session.keyboard import Key
from sldvexp.session.session import scan_views
from sldvexp.virtual_lab import VirtualLab

HAND = ["target=fiducials", "scan=by_hand", "scan.views={a: {}}"]


class Keys:
    """A keyboard on which prepared keys are pressed; what is shown is remembered."""

    columns = 100

    def __init__(self, *keys):
        self.keys = [k for key in keys for k in ([key] if isinstance(key, Key) else key.split())]
        self.lines, self.shown = [], []

    def key(self, patience=None):
        if not self.keys:
            raise KeyboardInterrupt
        key = self.keys.pop(0)
        if key == "idle":
            return None
        return key if isinstance(key, Key) else Key({"_": " "}.get(key, key))

    @property
    def is_waiting(self):
        return self.keys[:1] not in ([], ["idle"])

    def say(self, text):
        self.lines.append(text)

    def status(self, text):
        self.shown.append(text)

    def told(self, begin):
        return [line for line in self.lines if line.startswith(begin)]


class AtKeys(Operator):
    """Sits at such a keyboard."""

    def __init__(self, keys):
        super().__init__()
        self.keys = keys

    @contextmanager
    def keyboard(self):
        yield self.keys


class Session:
    """A session by hand in front of the virtual lab, whose person is not there."""

    def __init__(self, composed, folder, monkeypatch, *settings):
        monkeypatch.delattr(VirtualLab, "person")
        self.experiment, self.folder = composed(*HAND, *settings), folder
        e = self.experiment
        lab = VirtualLab(e.scene, e.laser, None, 0)
        self.true = np.rint(lab.true_dac(e.target.points().position)).astype(int).tolist()
        self.path = []
        move = VirtualLab.move

        def moved(lab, dac):
            self.path.append(tuple(int(step) for step in dac))
            move(lab, dac)

        monkeypatch.setattr(VirtualLab, "move", moved)

    def press(self, *keys):
        """Press keys in a session, or the rest of it; Ctrl-C ends them if they do not end it."""
        keyboard = Keys(*keys)
        guide = partial(aiming_at_marks, self.experiment.laser, None)
        self.group = None
        try:
            found = scan_views(self.experiment, self.folder, AtKeys(keyboard), guide=guide)
            self.group = found["registration"]
        except KeyboardInterrupt:
            pass
        return keyboard

    def at(self, number, off=(0, 0)):
        """Type where a mark is."""
        up_down, left_right = np.add(self.true[number - 1], off).tolist()
        return f"{' '.join(f'={up_down}')} _ {' '.join(str(left_right))} enter enter"

    def kept(self):
        """Steps in the journal, by mark."""
        found = {}
        for path in self.folder.glob("a/mark_*.json"):
            found[int(path.stem.removeprefix("mark_"))] = read_answer(path)["answer"]
        return found


@pytest.fixture
def session(composed, tmp_path, monkeypatch):
    return Session(composed, tmp_path, monkeypatch)


def test_arrows_move_the_beam(session):
    session.press("3 up 2 left left 1 down", Key("right", shift=True), "enter")
    expected = [(0, 0), (100, 0), (100, 10), (100, 20), (99, 20), (99, 10)]
    assert session.path[: len(expected)] == expected
    assert session.kept() == {1: [99, 10]}


def test_arrows_move_the_spot_as_it_is_seen_whatever_the_wiring(session):
    """With positive gains up and left count up; a mirror wired the other way counts down."""
    session.experiment.laser = TwoMirror(
        up_down=Mirror(-25.0), left_right=Mirror(25.0), mirror_offset=0.0
    )
    session.press("1 up left")
    assert session.path[:3] == [(0, 0), (-1, 0), (-1, 1)]


def test_a_whole_view_by_keys(session):
    """After three marks the rest is expected where it is; residuals and the review tell of all."""
    first = [session.at(k) for k in (1, 2, 3)]
    off_and_on = "g 1 up down enter"
    keys = session.press(*first, "g", session.at(4), off_and_on, off_and_on, "enter")
    assert session.group["point"].values.tolist() == [1, 2, 3, 4, 5, 6]
    dac = session.group["dac"].isel(view=0).values
    np.testing.assert_allclose(dac, session.true, atol=2)
    assert "expected" not in keys.told("View a, mark 3 at")[0]
    match = re.search(r"expected at (-?\d+) (-?\d+) steps", keys.told("View a, mark 5 at")[0])
    np.testing.assert_allclose([int(match[1]), int(match[2])], session.true[4], atol=3)
    assert keys.told("mark 3: taken at") == [
        "mark 3: taken at {} {}".format(*session.true[2]),
        *keys.told("mark 3: taken at")[1:],
    ]
    assert any("steps from where the others put it (+-" in t for t in keys.told("mark 4: "))
    assert len(keys.told("mark 6: ")) == 1
    assert keys.keys == []


@pytest.mark.whole
def test_one_place_of_several_is_not_taken_unseen(session):
    """Who presses g and Enter would confirm whichever pose the place was predicted by."""
    keys = session.press(*map(session.at, (1, 2, 3)), "g enter", "h")
    assert any("is but one of" in line for line in keys.lines)
    assert session.kept()[4] is None
    keys = session.press("u g enter enter")
    np.testing.assert_allclose(session.kept()[4][:2], session.true[3], atol=3)


def test_marks_taken_where_they_were_predicted_tell_nothing(session):
    """Taken by g and Enter alone they would confirm any pose: told, counted, left out of it."""
    first = [session.at(k) for k in (1, 2, 3)]
    keys = session.press(*first, session.at(4, (5, -3)), "g enter", "g enter")  # then the review
    for mark in (5, 6):
        for told in keys.told(f"mark {mark}: taken at"):
            assert told.endswith("where it was predicted: it tells nothing until you have moved to "
                             "what you see")  # fmt: skip
    assert any(line.startswith("2 of 6 marks were taken where they were") for line in keys.lines)
    by_four = [line.partition("(+-")[2] for line in keys.told("mark 4: taken at")]
    assert len(set(by_four)) == 1  # the bounds are as they were before the two
    session.press()  # the journal has kept how they were taken
    assert session.group["point"].values.tolist() == [1, 2, 3, 4]
    (finding,) = dataset.take_findings({"registration": session.group})
    assert finding.kind == "unmoved_marks"
    assert finding.severity is dataset.Severity.note
    assert finding.text.startswith("view a: marks 5 and 6 were taken where they were predicted")
    assert finding.text.endswith("the pose rests on the other 4")


def test_who_moves_off_a_predicted_place_and_back_has_seen_the_mark(session):
    first = [session.at(k) for k in (1, 2, 3, 4)]
    keys = session.press(*first, "g 1 up down enter", session.at(6, (9, 9)), "u g enter")
    assert "where it was predicted" not in keys.told("mark 5: taken at")[0]
    assert read_answer(session.folder / "a" / "mark_5.json")["answer"][2:] == []
    assert read_answer(session.folder / "a" / "mark_6.json")["answer"][2:] == ["unmoved"]


def test_who_goes_back_to_a_predicted_place_by_g_has_seen_nothing(session):
    first = [session.at(k) for k in (1, 2, 3, 4)]
    session.press(*first, "g 1 up g enter")
    assert read_answer(session.folder / "a" / "mark_5.json")["answer"][2:] == ["unmoved"]


def test_a_mark_that_is_taken_back_and_again_where_it_was_is_measured_as_before(session):
    """If no prediction brought the beam there, though nobody moves it now."""
    session.press(*[session.at(k) for k in (1, 2, 3, 4)], "u enter")
    assert session.kept()[4] == session.true[3]
    session.press("g enter", "u enter")
    assert session.kept()[5][2:] == ["unmoved"]
    session.press("u 1 up enter", "h", "enter")
    assert session.group["point"].values.tolist() == [1, 2, 3, 4, 5]


def test_a_mark_that_is_taken_back_is_named_and_no_other(session):
    keys = session.press(*map(session.at, (1, 2, 3, 4)), "u")
    back = keys.lines.index("mark 4 taken back: aim at it again")
    assert not [line for line in keys.lines[back:] if line.startswith("mark 3: taken at")]


def test_g_says_which_of_several_places_it_goes_to(session):
    keys = session.press(*map(session.at, (1, 2, 3)), "g", "idle", "g", "idle")
    there = [line for line in keys.shown if "to go +0 +0" in line]
    assert {line.partition("to place ")[2].partition("  ")[0] for line in there} == {
        "1 of 3",
        "2 of 3",
    }


def test_a_narrow_terminal_says_how_far_it_is_before_to_which_place(session, monkeypatch):
    monkeypatch.setattr(Keys, "columns", 50)
    keys = session.press(*map(session.at, (1, 2, 3)), "idle")
    assert re.search(r"to go ([-+]\d+) ([-+]\d+)$", keys.shown[-1])
    assert "to place" not in keys.shown[-1]


def test_a_wrong_mark_is_told_when_it_is_taken_and_taken_again(session):
    right = [session.at(k) for k in (1, 2, 3, 4)]
    keys = session.press(
        *right, session.at(5, (30, -20)), "u", session.at(5), session.at(6), "enter"
    )
    told = [line for line in keys.lines if "lies" in line or "wrong" in line]
    assert told
    assert "too far" in keys.told("mark 5: taken at")[0]
    assert session.group["dac"].sel(view="a", point=5).values.tolist() == session.true[4]


def test_undo_and_repeat_go_back_to_where_the_mark_was(session):
    keys = session.press(
        session.at(1), session.at(2), "u", "1 up enter", "r 1 enter", "1 left enter"
    )
    (one, two) = session.true[:2]
    assert session.kept() == {1: [one[0], one[1] + 1], 2: [two[0] + 1, two[1]]}
    assert [line.split(" at ")[0] for line in keys.told("View a")] == [
        f"View a, mark {k}" for k in (1, 2, 3, 2, 3, 1, 3)
    ]
    kept = sorted(path.name for path in session.folder.glob("a/.mark*"))
    assert kept == [".mark_1.1.json", ".mark_2.1.json"]


@pytest.mark.whole
def test_a_hidden_mark_can_be_taken_back(session):
    session.press(session.at(1), "h", session.at(3))
    assert session.kept()[2] is None
    session.press("r 2 enter", session.at(2))
    assert session.kept() == {k: session.true[k - 1] for k in (1, 2, 3)}


@pytest.mark.whole
def test_what_was_taken_back_stays_so_after_a_cut(session):
    """Neither the answer that was taken back counts, nor is one lost that counted."""
    session.press(session.at(1), session.at(2), session.at(3, (9, 9)), "u")
    assert session.kept() == {k: session.true[k - 1] for k in (1, 2)}
    keys = session.press("u", session.at(2), session.at(3), *map(session.at, (4, 5, 6)), "enter")
    assert keys.told("View a")[0].startswith("View a, mark 3 at")
    assert keys.told("View a")[1].startswith("View a, mark 2 at")
    np.testing.assert_array_equal(session.group["dac"].values[0], session.true)


@pytest.mark.whole
def test_who_only_goes_on_reviews_nothing(session):
    session.press(*map(session.at, range(1, 7)))
    assert session.group is None  # cut off at the review
    session.press()
    np.testing.assert_array_equal(session.group["dac"].values[0], session.true)


def test_nothing_that_is_mistyped_moves_the_beam(session):
    keys = session.press(
        "= 1 enter", "= 9 9 9 9 _ 0 enter", "+ 5 escape", "- backspace backspace", "x", "g", "u",
        "r 7 enter", "?",
    )  # fmt: skip
    assert set(session.path) == {(0, 0)}
    told = "\n".join(keys.lines)
    for part in (
        "'=1' is neither steps like +5 -3 nor a place like =120 -40",
        "9999 0 is beyond the board's steps, -4096 to 4096",
        "three marks that are not in a line tell where the others lie; 0 are taken",
        "nothing is taken yet",
        "'7' is not a mark that was taken or left out",
    ):
        assert part in told
    assert told.count("Arrow keys move the beam") == 2


def test_two_marks_are_not_at_one_place(session):
    keys = session.press(session.at(1), "enter", "1 up enter")
    told = "mark 1 was taken at {} {}, where mark 2 cannot be too".format(*session.true[0])
    assert any(line.startswith(told) for line in keys.lines)
    assert session.kept()[2] == [session.true[0][0] + 1, session.true[0][1]]


def test_light_is_looked_at_while_no_key_is_pressed(session):
    keys = session.press("idle", session.at(1))
    assert any("light [" in line and "velocity" in line for line in keys.shown)


def test_an_instrument_that_cannot_sample_is_aimed_all_the_same(session, monkeypatch):
    def cannot(lab, acquisition):
        raise InstrumentError("no board")

    monkeypatch.setattr(VirtualLab, "configure", cannot)
    keys = session.press("idle", session.at(1), "idle", session.at(2), "idle")
    assert "mark 1  beam 0 0  no level  step 10  no board" in keys.shown
    assert session.kept() == {k: session.true[k - 1] for k in (1, 2)}


def test_a_narrow_terminal_shows_what_matters_most():
    parts = ["mark 1", "beam 0 0", "to go +3 -2", "light [####......]"]
    assert fitting(parts, 100) == "mark 1  beam 0 0  to go +3 -2  light [####......]"
    assert fitting(parts, 30) == "mark 1  beam 0 0  to go +3 -2"
    assert fitting(parts, 12) == "mark 1"


def test_a_line_is_typed_with_mistakes():
    assert typed(Keys("5 6 backspace up _ enter"), "move: ", "+") == "+5 "
    assert typed(Keys("escape"), "move: ", "+") is None
    assert typed(Keys("backspace backspace"), "move: ", "+") is None


class Seen:
    """A camera with one pixel."""

    def __init__(self, status=Status.good):
        counts = np.array([[[0, 100, -100, 0], [0, 0, 0, 0]]], np.int16)
        self.pixel = RawSamples(counts, np.array([0.01, 0.01]), 1.0, np.array([status], np.uint8))

    def look(self):
        return self.pixel


def test_the_level_is_told():
    bright = ["light [##########]", "velocity 0.7071 V", "reference 0.0000 V"]
    assert LightLevel().read(Seen(), None) == bright
    assert LightLevel().read(Seen(Status.dropped_out), None)[0] == "light [..........]"
    assert LightLevel().read(Seen(Status.over_range), None)[0] == "light [##########] over range"


def test_an_instrument_without_a_level_is_asked_once():
    class Blind:
        asked = 0

        def look(self):
            self.asked += 1
            raise InstrumentError("no such command")

    level, blind = LightLevel(), Blind()
    assert level.read(blind, None) == ["no level", "no such command"]
    assert level.read(blind, None) == ["no level"]
    assert blind.asked == 1


def test_who_has_aimed_elsewhere_is_not_asked_for_keys(session, monkeypatch):
    """A page that has aimed in a view answers for it, also if it was started from a terminal."""

    class Aimed:
        def aim(self, mark, start):
            return (mark.number, 0)

    monkeypatch.setattr(AtKeys, "person", lambda self, view: Aimed())
    assert session.press().lines == []
    assert session.kept() == {k: [k, 0] for k in range(1, 7)}


def test_a_scan_after_a_look_samples_as_it_should(composed, tmp_path):
    """Neither a look before the pixels nor one between them changes what is scanned."""
    settings = ["scan=rectangle", "scan.pixels=[2,2]"]
    corners = "scan.views={a: {corners: [[0, 0], [40, 0], [40, -40], [0, -40]]}}"
    part = (e := composed(*settings, corners)).scan.parts("a")[0]
    camera = Camera(lambda: VirtualLab(e.scene, e.laser, None, 0), e.signal, Journal(tmp_path))
    lines = [np.array([[0, 0], [5, 0]]), np.array([[0, 9], [5, 9]])]
    with camera:
        assert camera.look().counts.shape == (1, 2, 64)
        camera.sample(part.sampling)
        first = camera.image("one", lines)
        camera.look()
        again = camera.image("two", lines)
    assert first.velocity.shape == again.velocity.shape == (4, 1)
    np.testing.assert_allclose(first.velocity, again.velocity, rtol=0.2)


def test_nobody_is_asked_for_keys_where_there_are_none(composed, tmp_path, monkeypatch):
    """With a guide at hand, too, a pipe is asked for lines, as ever."""
    experiment = composed(*HAND)
    monkeypatch.delattr(VirtualLab, "person")
    monkeypatch.setattr("builtins.input", lambda request: (_ for _ in ()).throw(EOFError))
    guide = partial(aiming_at_marks, experiment.laser, None)
    with pytest.raises(
        UserError, match="nobody is at the terminal to answer 'mark 1, beam at 0 0'"
    ):
        scan_views(experiment, tmp_path, guide=guide)


def test_marks_nearly_in_a_line_do_not_send_the_beam_anywhere(composed, tmp_path, monkeypatch):
    """Their prediction of the next one has an error as large as the mirrors' range."""
    third = "target.fiducials={3: {x: 5.0, y: 0.02, z: 0.0}}"
    session = Session(composed, tmp_path, monkeypatch, third)
    keys = session.press(*map(session.at, (1, 2, 3)), "idle g")
    (asked,) = keys.told("View a, mark 4 at")
    assert "; mark 1, mark 2 and mark 3 do not tell yet where mark 4 is, as when" in asked
    assert "expected at" not in asked
    assert keys.lines[-1] == asked.partition("; ")[2]


def test_second_g_says_where_there_is_no_other_place(session):
    keys = session.press(*map(session.at, (1, 2, 3, 4)), "g g up g")
    expected = [line for line in keys.lines if line.startswith("mark 5 is expected where")]
    assert len(expected) == 1
    assert expected[0].endswith("move the beam onto it if it is beside")
