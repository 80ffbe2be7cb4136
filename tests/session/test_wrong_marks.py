"""Marks of which no pose can be believed: told before the session goes on, and asked for again."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from sldvexp.console.marks import FIDUCIAL, AimedMark, AimedMarks, AimedPerson
from sldvexp.errors import UserError
from sldvexp.instrument.person import Mark, TakenBackError
from sldvexp.instrument.recording import JOURNAL
from sldvexp.pose.aiming import aiming_at_marks
from sldvexp.session import Operator
from sldvexp.session.interruption import telling_of_the_scan
from sldvexp.session.operator import NobodyThereError
from sldvexp.session.session import scan_views
from sldvexp.targets import FiducialPoint
from tests.session.test_by_keys import HAND, Session

#: Steps by which mark 5 is taken beside its place.
OFF = (30, -20)
WRONG = "mark 5 lies 3"


@pytest.fixture
def session(composed, tmp_path, monkeypatch):
    return Session(composed, tmp_path, monkeypatch)


def marks(session, off=OFF):
    return [session.at(k, off if k == 5 else (0, 0)) for k in range(1, 7)]


def test_one_enter_does_not_let_a_wrong_mark_pass(session):
    keys = session.press(*marks(session), "enter", "r 5 enter", session.at(5), "enter")
    told = keys.told("The pose of this view would rest on these: ")
    assert len(told) == 1
    assert WRONG in told[0]
    assert told[0].endswith("steps beside where the others put it: take it again")
    assert any("Enter twice goes on all the same" in line for line in keys.shown)
    np.testing.assert_array_equal(session.group["dac"].values[0], session.true)


def test_what_is_asked_of_wrong_marks_goes_when_one_is_taken_back(session):
    keys = session.press(*marks(session), "u")
    asked = max(i for i, line in enumerate(keys.shown) if "Enter twice goes on" in line)
    assert keys.shown[asked + 1] == ""


def test_who_goes_on_with_a_wrong_mark_is_asked_again_when_the_run_goes_on(session):
    session.press(*marks(session), "enter enter")
    assert session.group is not None
    keys = session.press("r 5 enter", session.at(5), "enter")
    assert any(line.startswith(WRONG) for line in keys.lines)
    np.testing.assert_array_equal(session.group["dac"].values[0], session.true)
    assert session.press().keys == []  # nothing is asked where the marks agree
    assert session.group is not None


def test_marks_too_few_for_a_pose_are_told(session):
    keys = session.press(*marks(session)[:2], "h h h h", "enter")
    assert keys.told("2 marks of this view are taken, and a pose needs three")
    keys = session.press("r 3 enter", session.at(3), "enter")
    assert session.group["point"].values.tolist() == [1, 2, 3]


def test_a_mark_that_a_rough_pose_refutes_is_told_when_it_is_taken(composed, tmp_path, monkeypatch):
    e = composed(*HAND)
    truth = next(iter(e.scene.views.values()))
    rough = f"{{euler: {list(truth.euler)}, origin: {(truth.place + 0.01).tolist()}}}"
    session = Session(composed, tmp_path, monkeypatch, f"scan.views={{a: {{pose: {rough}}}}}")
    keys = session.press(session.at(1), session.at(2, (2600, 0)), "idle")
    (told,) = keys.told("mark 2 lies 2")
    assert told.endswith(
        "steps from where the rough pose and mark 1 put it: take it or mark 1 again, or correct "
        "the rough pose"
    )
    keys = session.press("r 2 enter", session.at(2), *marks(session, (0, 0))[2:], "enter")
    assert sum("rough pose" in line for line in keys.lines) == 1  # before it is taken again
    np.testing.assert_array_equal(session.group["dac"].values[0], session.true)


class Typing(Operator):
    """Types prepared answers, and then has gone."""

    def __init__(self, *answers):
        self.answers, self.requests = list(answers), []

    def ask(self, request):
        self.requests.append(request)
        if not self.answers:
            raise NobodyThereError("nobody is there")
        return self.answers.pop(0)


def typed(session, *answers):
    operator = Typing(*answers)
    guide = partial(aiming_at_marks, session.experiment.laser, None)
    session.group = scan_views(session.experiment, session.folder, operator, guide=guide)[
        "registration"
    ]
    return operator


def test_who_types_lines_is_told_before_the_session_goes_on(session):
    steps = [np.add(place, OFF if k == 4 else 0) for k, place in enumerate(session.true)]
    lines = [line for u, v in steps for line in (f"={u} {v}", "")]
    u, v = session.true[4]
    operator = typed(session, *lines, "9", "5", f"={u} {v}", "")
    assert WRONG in operator.requests[len(lines)]
    assert "'9' is not a mark of this view" in operator.requests[len(lines) + 1]
    np.testing.assert_array_equal(session.group["dac"].values[0], session.true)


@pytest.mark.parametrize(
    "by",
    [lambda s: typed(s, *6 * [""]), lambda s: s.press(*6 * ["enter"], "enter enter")],
    ids=["lines", "keys"],
)
def test_who_only_presses_enter_at_the_places_of_a_rough_pose_has_measured_nothing(
    composed, tmp_path, monkeypatch, by
):
    """All marks of a pose that is 30 mm beside: neither lines nor keys take them for measured."""
    where = "views={a: {pose: {origin: [0.31, 0.55, 1.66], look_at: [0.13, 0.15, 0]}}}"
    rough = Session(composed, tmp_path, monkeypatch, f"scan.{where}")
    with pytest.raises(UserError, match="every mark of the view a was taken where it was predict"):
        by(rough)


@pytest.mark.whole
def test_where_nobody_is_there_the_session_goes_on_with_what_is_kept(session):
    session.press(*marks(session), "enter enter")
    assert WRONG in typed(session).requests[0]
    assert session.kept()[5] == np.add(session.true[4], OFF).tolist()


def test_what_is_aimed_anew_on_the_page_counts_when_the_run_goes_on():
    person = AimedPerson({2: AimedMark((2, 2))}, {4})
    person.review({1: (1, 1), 3: None})  # which nobody has touched there
    kept = {1: (1, 1), 2: (2, 2), 3: None, 4: (4, 4)}
    for number, steps in ((2, (2, 2)), (4, None)):
        with pytest.raises(TakenBackError) as back:
            person.review(kept)
        assert back.value.number == number
        assert person.aim(Mark(number, np.zeros(3), np.zeros(3)), (0, 0)) == steps
    person.review(kept)


class OnThePage(Operator):
    """Has aimed at marks on the page."""

    def __init__(self, aimed):
        self.aimed = aimed

    def person(self, view):
        return self.aimed.person(view)


def gone_on_with(session, aimed):
    guide = partial(aiming_at_marks, session.experiment.laser, None)
    scan_views(session.experiment, session.folder, OnThePage(aimed), guide=guide)


def test_marks_that_nobody_touched_on_the_page_stay_as_the_run_has_them(session):
    session.press(*marks(session), "enter enter")
    aimed = AimedMarks()
    aimed.put("a", (FIDUCIAL, 5), tuple(session.true[4]))
    gone_on_with(session, aimed)
    assert session.kept() == {k: session.true[k - 1] for k in range(1, 7)}


def test_a_mark_that_was_taken_away_on_the_page_is_hidden_when_the_run_goes_on(session):
    session.press(*marks(session), "enter enter")
    aimed = AimedMarks()
    for k in (1, 5):
        aimed.put("a", (FIDUCIAL, k), tuple(session.true[k - 1]))
    aimed.put("a", (FIDUCIAL, 5), None)
    aimed.put("a", (FIDUCIAL, 6), (1, 2))
    aimed.undo()  # as if it had never been touched
    gone_on_with(session, aimed)
    right = {k: session.true[k - 1] for k in range(1, 7)}
    assert session.kept() == right | {5: None}


def test_a_pose_that_fails_tells_how_marks_are_taken_again(tmp_path: Path):
    (tmp_path / JOURNAL / "front").mkdir(parents=True)
    (tmp_path / JOURNAL / "front" / "mark_3.json").touch()
    with pytest.raises(UserError) as error, telling_of_the_scan(tmp_path, scanned=True):
        raise UserError("pose: a view has two points")
    assert "journal/<view>/mark_<number>.json you delete), and go on with: " in str(error.value)


def test_a_mark_beyond_the_mirrors_is_told_at_the_terminal_after_the_third(session):
    target = session.experiment.target
    far = target.fiducials | {7: FiducialPoint(x=200, y=3, z=0)}
    session.experiment.target = replace(target, fiducials=far)
    keys = session.press(*map(session.at, range(1, 7)), "h", "enter")
    (told,) = keys.told("mark 7 is ")
    assert "steps (" in told
    assert "beyond the left-right mirror's reach (+- " in told
    assert "h leaves it out" in told
    before = keys.lines.index(told)
    assert keys.lines[before - 1 :][0].startswith(("mark 3: ", "marks 1, 2 and 3 fit"))
    (asked,) = keys.told("View a, mark 7 at")
    assert "beyond the left-right mirror's reach" in asked
    assert session.group["point"].values.tolist() == [1, 2, 3, 4, 5, 6]
