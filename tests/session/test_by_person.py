"""Marks that a person points at, spots that a person digitises: asked, kept, resumed, replayed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.instrument import InstrumentError, Replay
from sldvexp.instrument.person import Mark
from sldvexp.instrument.recording import JOURNAL
from sldvexp.laser import TwoMirror
from sldvexp.session import Journal, Operator
from sldvexp.session.by_person import AtTerminal
from sldvexp.session.operator import NobodyThereError
from sldvexp.session.session import estimate, scan_views, takes_samples
from sldvexp.units import LengthUnit
from sldvexp.virtual_lab import VirtualLab
from sldvexp.virtual_lab.lab import SimulatedPerson

MARK = Mark(3, np.array([0.2794, 0.2794, 0.0]), np.zeros(3))
SPOTS = "[[-450, -1250], [-450, -50], [450, -650], [300, -300]]"
HAND = ["target=fiducials", "scan=by_hand", "scan.views={a: {}, b: {hidden: [3]}}"]
DIGITIZER = ["scan=by_digitizer", f"scan.views={{a: {{dac: {SPOTS}}}, b: {{dac: {SPOTS}}}}}"]


class Typed(Operator):
    """Types prepared answers and remembers the requests."""

    def __init__(self, *answers):
        self.answers, self.requests = list(answers), []

    def ask(self, request):
        self.requests.append(request)
        return self.answers.pop(0)


class Beam:
    """An instrument that only moves."""

    def __init__(self):
        self.path = []

    def move(self, dac):
        self.path.append(tuple(dac))


def at_terminal(*answers, unit=LengthUnit.m):
    return AtTerminal(Typed(*answers), Beam(), TwoMirror(), "front", unit)


def test_steps_places_and_accepting():
    person = at_terminal("+5 -3", "5, 3", "=-120 40", "= 7 8", "-1 -1", "")
    assert person.aim(MARK, (10, 20)) == (6, 7)
    assert person.instrument.path == [(10, 20), (15, 17), (20, 20), (-120, 40), (7, 8), (6, 7)]
    requests = person.operator.requests
    assert "View front, mark 3 at (279.4, 279.4, 0) mm" in requests[0]
    assert [r.rsplit("beam at ")[-1] for r in requests[:2]] == ["10 20: ", "15 17: "]


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        ("left", "'left' is neither steps like +5 -3 nor a place like =120 -40"),
        ("5", "'5' is neither"),
        ("1.5 2", "'1.5 2' is neither"),
        ("=0 4097", "0 4097 is beyond the board's steps, -4096 to 4096"),
        ("-5000 0", "-5000 0 is beyond"),
    ],
)
def test_what_cannot_be_done_is_told_and_asked_again(answer, told):
    person = at_terminal(answer, "")
    assert person.aim(MARK, (0, 0)) == (0, 0)
    assert told in person.operator.requests[1]
    assert person.instrument.path == [(0, 0)]


def test_a_mark_may_be_hidden():
    assert at_terminal("+1 +1", "Hidden").aim(MARK, (0, 0)) is None


def test_two_marks_are_not_at_one_place():
    person = AtTerminal(Typed("", "-1 0", "+1 0", "", "+2 0", ""), Beam(), TwoMirror(), "front",
                        taken=lambda: {(10, 20): 1})  # fmt: skip
    assert person.aim(MARK, (10, 20)) == (12, 20)
    told = "mark 1 was found at 10 20, where mark 3 cannot be too: move the beam onto it, or type"
    requests = person.operator.requests
    assert [told in request for request in requests] == [False, True, False, False, True, False]


def test_a_session_refuses_the_place_of_an_earlier_mark(composed, tmp_path, monkeypatch):
    experiment = composed(*HAND[:2], "scan.views={a: {}}")
    monkeypatch.delattr(VirtualLab, "person")
    found = ["=10 20", "", "", "+5 5", "", *["+7 0", ""] * 4]
    operator = Typed(*found)
    group = scan_views(experiment, tmp_path, operator)["registration"]
    assert operator.answers == []
    np.testing.assert_array_equal(group["dac"].isel(view=0, point=[0, 1]), [[10, 20], [15, 25]])
    assert len(np.unique(group["dac"].values[0], axis=0)) == 6


def test_who_is_not_there_is_asked_in_one_line(monkeypatch):
    def ended(request):
        raise EOFError

    monkeypatch.setattr("builtins.input", ended)
    with pytest.raises(NobodyThereError) as error:
        Operator().ask("'' is not three numbers x y z\nView 1, spot 2: x y z in mm: ")
    expected = "nobody is at the terminal to answer 'View 1, spot 2: x y z in mm'"
    assert str(error.value) == expected


def test_a_person_alone_is_announced(experiment):
    how = {"marks": "hand", "spots": "digitizer"}[experiment.scan.parts("a")[0].kind]
    assert estimate(experiment.scan) == f"scan: by {how}, views a, b"


def test_digitised_coordinates_come_in_their_unit():
    person = at_terminal("1 2 3", "4, 5", "1 2 nan", "-1;0;1e1", unit=LengthUnit.mm)
    found = person.digitise(2, 2)
    np.testing.assert_allclose(found, [[0.001, 0.002, 0.003], [-0.001, 0, 0.01]])
    requests = person.operator.requests
    assert requests[0] == "View front, spot 2, sample 1 of 2: x y z in mm: "
    assert requests[2].startswith("'4, 5' is not three numbers x y z\n")
    assert "sample 2 of 2" in requests[3]


def test_an_answer_is_kept_and_asked_for_once(tmp_path):
    answers = iter([[1, 2], None, [5, 6]])
    journal = Journal(tmp_path / "a")
    for _ in range(2):
        assert journal.answer("mark_1", [0.1, 0.2], lambda: next(answers)) == [1, 2]
        assert journal.answer("mark_2", [0.3], lambda: next(answers)) is None
    with pytest.raises(UserError, match="belongs to another configuration"):
        journal.answer("mark_1", [0.1, 0.3], lambda: next(answers))
    (tmp_path / "a" / "mark_1.json").write_text('{"question": [0.1, 0.2], "ans')
    assert journal.answer("mark_1", [0.1, 0.2], lambda: next(answers)) == [5, 6]


@pytest.fixture(params=["hand", "digitizer"])
def experiment(request, composed):
    return composed(*{"hand": HAND, "digitizer": DIGITIZER}[request.param])


def require_same(one, two):
    assert one.keys() == two.keys() == {"registration"}
    assert one["registration"].identical(two["registration"])


@pytest.mark.whole
def test_what_was_cut_off_goes_on(experiment, tmp_path, monkeypatch):
    whole = scan_views(experiment, tmp_path / "whole")
    asked = []

    def counted(name):
        act = getattr(SimulatedPerson, name)

        def once(self, *arguments):
            if len(asked) == 3:
                raise KeyboardInterrupt
            asked.append(name)
            return act(self, *arguments)

        return once

    with monkeypatch.context() as patch:
        for name in ("aim", "digitise"):
            patch.setattr(SimulatedPerson, name, counted(name))
        with pytest.raises(KeyboardInterrupt):
            scan_views(experiment, tmp_path / "cut")
    kept = {p: p.stat().st_mtime_ns for p in (tmp_path / "cut").rglob("*.json")}
    assert len(kept) == 3
    require_same(scan_views(experiment, tmp_path / "cut"), whole)
    assert {p: p.stat().st_mtime_ns for p in kept} == kept


@pytest.mark.one_in(2)
def test_a_person_is_replayed(experiment, tmp_path):
    first = scan_views(experiment, tmp_path / "first" / JOURNAL)
    replayed = replace(experiment, instrument=Replay(str(tmp_path / "first")), scene=None)
    require_same(scan_views(replayed, tmp_path / "second"), first)
    for path in (tmp_path / "first").rglob("*_1.json"):
        path.unlink()
    with pytest.raises(InstrumentError, match="a recording can only be scanned as it was"):
        scan_views(replayed, tmp_path / "third")


def test_the_group_holds_what_was_found(composed, tmp_path):
    experiment = composed(*HAND)
    assert not takes_samples(experiment.scan)
    group = scan_views(experiment, tmp_path)["registration"]
    points = experiment.target.points()
    used = group["used"].values.astype(bool)
    np.testing.assert_array_equal(used, [[True] * 6, [True, True, False, True, True, True]])
    for view, seen in zip("ab", used, strict=True):
        own = group.sel(view=view).isel(point=seen)
        np.testing.assert_array_equal(own["object_point"], points.position[seen])
        np.testing.assert_allclose(own["object_point_std"], points.std[seen])
        np.testing.assert_array_equal(own["dac"] % 1, 0)
        np.testing.assert_allclose(own["angle"], experiment.laser.angle_from_dac(own["dac"]))


@pytest.mark.whole
def test_digitised_spots_are_points_of_their_own_in_every_view(composed, tmp_path):
    experiment = composed(*DIGITIZER, "scan.samples=9", "scene.operator.digitizer=0.001")
    group = scan_views(experiment, tmp_path)["registration"]
    np.testing.assert_array_equal(group["point"], np.arange(1, 9))
    np.testing.assert_array_equal(group["used"].sum("view"), 1)
    std = group["object_point_std"].values[group["used"].values.astype(bool)]
    # 24 standard errors from nine samples each: their mean square is right to 5 / sqrt(4 * 24).
    assert np.mean(std**2) == pytest.approx(0.001**2 / 9, rel=5 / np.sqrt(96))
    once = composed(*DIGITIZER, "scan.samples=1")
    assert "object_point_std" not in scan_views(once, tmp_path / "once")["registration"]


def test_marks_and_images_from_one_place(composed, tmp_path):
    corners = "{corners: [[0, 0], [40, 0], [40, -40], [0, -40]]}"
    experiment = composed(
        "scan=session",
        "target=fiducials",
        "scan.marks.views={a: {}, b: {}}",
        f"scan.structure.views={{a: {corners}, b: {corners}}}",
        "scan.structure.pixels=[2,2]",
    )
    found = scan_views(experiment, tmp_path)
    assert found.keys() == {"image/a", "image/b", "registration"}


@pytest.mark.whole
@pytest.mark.parametrize(
    ("scan", "told"),
    [
        ("scan.views={a: {}}", "scan=by_hand needs marks to point at"),
        (
            "scan.views={a: {hidden: [1, 2, 3, 4, 5, 6]}}",
            "none of the marks can be seen from the view a",
        ),
    ],
)
def test_nothing_to_point_at(composed, tmp_path, scan, told):
    experiment = composed("target=fiducials", "scan=by_hand", scan)
    if "hidden" not in scan:
        circles = composed("target=dissertation").target
        with pytest.raises(UserError, match=f"{told}, and the target is circles.*sldvexp console"):
            scan_views(replace(experiment, target=circles), tmp_path / "circles")
        experiment = replace(experiment, target=None)
    with pytest.raises(UserError, match=told):
        scan_views(experiment, tmp_path)


@pytest.mark.whole
def test_mistakes_in_the_configuration(composed):
    for scan, told in {
        "scan=by_digitizer scan.samples=0": "scan.samples: must be at least 1, not 0",
        "scan=by_digitizer scan.views={a:{dac:[[1]]}}": "must be pairs",
        "scan=by_hand scan.fiducials={1:{x:0,y:0}}": "a pose needs three points or more",
    }.items():
        with pytest.raises(UserError, match=told):
            composed(*scan.split())
    marks = "scan.fiducials={1: {x: 0, y: 0}, 2: {x: 1, y: 0}, 3: {x: 0, y: 1}}"
    with pytest.raises(UserError, match="there is no mark 7; there are 1, 2, 3"):
        composed("scan=by_hand", marks, "scan.views={a: {hidden: [7]}}")
