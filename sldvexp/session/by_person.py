"""One view by a person: marks that the beam was pointed at, spots that were digitised.

The person at the terminal: told where to point, asked what the digitizer shows.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from typing import Any

import numpy as np

from sldvexp.dataset import Finding, Severity
from sldvexp.errors import UserError
from sldvexp.geometry import KnownPose
from sldvexp.instrument import Instrument
from sldvexp.instrument.person import (
    AimingGuide,
    Attended,
    HandOnBeam,
    Mark,
    Person,
    Place,
    Reviewer,
    Steps,
    TakenBackError,
    answer_of,
    mark_label,
    mark_name,
    spot_name,
    steps_of,
)
from sldvexp.io.registration import RegistrationTable, from_dataset, to_dataset
from sldvexp.laser import TwoMirror, corrected_pose, dac_of_points
from sldvexp.lazy import xarray as xr
from sldvexp.scan.by_digitizer import ByDigitizer
from sldvexp.scan.by_hand import ByHand
from sldvexp.session.by_keys import AtKeyboard, beyond_board, in_mm, moved
from sldvexp.session.camera import ViewContext
from sldvexp.session.operator import NobodyThereError, Operator
from sldvexp.targets import Circles, Target
from sldvexp.typing import Array, IntArray
from sldvexp.units import LengthUnit

GROUP = "registration"
HOME: Steps = (0, 0)
#: Marks that test one another: a pose of three has no residuals.
TESTED = 4


def record_marks(scan: ByHand, at: ViewContext) -> dict[str, xr.Dataset]:
    """Record the marks that a person can point at in a view: the group ``registration/<view>``.

    Raises
    ------
    UserError
        If there are no marks, or all are hidden.
    """
    hidden = scan.views[at.view].hidden
    marks = {m.number: m for m in known_marks(scan, at.target) if m.number not in hidden}
    answers = _Answers(at, marks, scan.views[at.view].pose)
    steps, changes = answers.all(), answers.changes()
    v = at.view
    at.findings.extend(
        Finding("aimed_anew", f"view {v}", f"in view {v}, {told}", Severity.note, views=(v,))
        for told in changes
    )
    seen = {number: mark for number, mark in marks.items() if steps[number] is not None}
    if not seen:
        raise UserError(f"scan: none of the marks can be seen from the view {at.view}")
    found = [
        (mark, steps[number]) for number, mark in seen.items() if number not in answers.unmoved
    ]
    if not found:
        raise UserError(
            f"scan: every mark of the view {v} was taken where it was predicted, so that nothing "
            "was measured: move the beam onto what is seen, and take each there"
        )
    if answers.unmoved:
        at.findings.append(_unmoved(v, sorted(answers.unmoved), len(found)))
    numbers = np.array([mark.number for mark, _ in found])
    position = np.array([mark.position for mark, _ in found])
    std = np.array([mark.std for mark, _ in found])
    made = _group(at, numbers, position, std, np.array([dac for _, dac in found], float))
    for group in made.values():
        group.attrs |= {"summary": "\n".join(changes)} if changes else {}
    return made


def _unmoved(view: str, numbers: Sequence[int], rest: int) -> Finding:
    """Name the marks of a view that were taken where they were predicted.

    Their steps are those of the other marks' pose, which they would confirm whatever it is, and
    are no measurement of their own: the pose rests on the others.
    """
    several = len(numbers) > 1
    listed = " and ".join(", ".join(map(str, numbers)).rsplit(", ", 1))
    told = (
        f"view {view}: mark{'s' * several} {listed} "
        f"{'were taken where they were' if several else 'was taken where it was'} predicted, "
        f"without a move of the beam, and {'tell' if several else 'tells'} nothing: the pose rests "
        f"on the other {rest}"
    )
    untested = rest < TESTED
    return Finding(
        "unmoved_marks",
        f"view {view}",
        f"{told}, which nothing tests" if untested else told,
        Severity.doubtful if untested else Severity.note,
        remedy="aim at these marks again, and move the beam onto what you see",
        views=(view,),
    )


class _Answers:
    """Steps of all marks of a view: kept in the journal, or found by a person.

    An answer is in the journal as soon as it is given; one that is taken back is not, so that a
    session that is cut off goes on with what counted last.
    """

    def __init__(self, at: ViewContext, marks: Mapping[int, Mark], rough: KnownPose | None) -> None:
        self._at, self._marks, self._rough = at, marks, rough
        self._steps: dict[int, Steps | None] = {}
        self._guide = None if at.guide is None else at.guide(list(marks.values()), rough)
        self._person: Person | None = None
        self._opened = ExitStack()
        self._beam = HOME
        self.unmoved: set[int] = set()  # marks that were taken where they were predicted
        # Marks that are open again: where they were found, and if that was predicted.
        self._again: dict[int, tuple[Steps, bool]] = {}
        self._kept: dict[int, Steps | None] = {}  # answers of the journal, as they were at first

    def all(self) -> dict[int, Steps | None]:
        """Give the steps of all marks, None for those that cannot be seen."""
        with self._opened:
            while True:
                try:
                    for number in self._marks:
                        if number not in self._steps:
                            self._note(number, *self._answer(self._marks[number]))
                    self._review()
                    return self._steps
                except TakenBackError as back:
                    self._take_back(back.number)

    def changes(self) -> list[str]:
        """Say which marks stand elsewhere than the journal had them at first."""
        return [
            f"{mark_label(number)} counts as it was aimed last, {_told(self._steps[number])}, in "
            f"place of {_told(before)}"
            for number, before in self._kept.items()
            if number in self._steps and self._steps[number] != before
        ]

    def _review(self) -> None:
        """Let somebody look at all marks: who has just pointed, or who goes on with wrong ones."""
        # Who has aimed before goes before what was kept, also where that gives no trouble.
        self._person = self._person or self._at.operator.person(self._at.view)
        if self._guide is not None and self._guide.trouble():
            self._person = self._person or self._who_aims()
        if isinstance(self._person, Reviewer):
            self._person.review(self._steps)

    def _who_aims(self) -> Person:
        """Find who aims; the keys of a terminal are theirs until all marks are answered."""
        at, guide = self._at, self._guide
        somebody = person_at(at, taken=self._taken, guide=guide)
        if guide is None or not isinstance(somebody, AtTerminal):
            return somebody
        keyboard = self._opened.enter_context(at.operator.keyboard())
        return somebody if keyboard is None else AtKeyboard(at, guide, keyboard)

    def _answer(self, mark: Mark) -> tuple[Steps | None, bool]:
        """Look an answer up, or let a person aim, at other steps than those of other marks.

        Returns
        -------
        steps : (up_down, left_right), or None
        unmoved : bool
            Whether nobody has moved the beam from where the mark was predicted.
        """
        asked = False

        def aim() -> list[Any] | None:
            nonlocal asked
            asked = True
            self._person = self._person or self._who_aims()
            start, predicted = self._start(mark)
            steps = self._person.aim(mark, start)
            # Where only a key brought the beam that goes to a prediction, it has left the start.
            still = isinstance(self._person, HandOnBeam) and not self._person.moved
            return answer_of(steps, still and (predicted or steps != start))

        journal = self._at.camera.journal
        kept = journal.answer(mark_name(mark.number), mark.position.tolist(), aim)
        steps, unmoved = steps_of(kept)
        if not asked:
            self._kept.setdefault(mark.number, steps)
        return steps, unmoved

    def _note(self, number: int, steps: Steps | None, unmoved: bool) -> None:
        self._steps[number] = steps
        if unmoved:
            self.unmoved.add(number)
        if steps is not None:
            self._beam = steps
        if self._guide is not None and steps is not None:
            self._guide.take(mark_label(number), steps, unmoved)
        elif self._guide is not None:
            self._guide.hide(mark_label(number))

    def _take_back(self, number: int) -> None:
        """Open a mark again; the beam begins where it was found."""
        self._at.camera.journal.take_back(mark_name(number))
        if (found := self._steps.pop(number, None)) is not None:
            self._again[number] = found, number in self.unmoved
        self.unmoved.discard(number)
        if self._guide is not None:
            self._guide.repeat(mark_label(number))

    def _start(self, mark: Mark) -> tuple[Steps, bool]:
        """Say where the beam begins: where a mark was, is predicted, or where the beam is.

        The rough pose, corrected by the marks that are found, predicts it.

        Returns
        -------
        start : (up_down, left_right)
        predicted : bool
            Whether that is a prediction, which nobody has moved the beam to.
        """
        if mark.number in self._again:
            return self._again.pop(mark.number)
        if self._rough is None:
            return self._beam, False
        laser, pose = self._at.laser, (self._rough.rotation, self._rough.place)
        taken = {s: number for s, number in self._taken().items() if number not in self.unmoved}
        try:
            if taken:
                at = [self._marks[number].position for number in taken.values()]
                names = [mark_label(number) for number in taken.values()]
                pose = corrected_pose(at, list(taken), *pose, laser, names)
            steps = dac_of_points(mark.position[None], *pose, laser, [mark_label(mark.number)])[0]
        except UserError:  # out of the mirrors' reach, as a mark that is hidden may be
            return self._beam, False
        up_down, left_right = np.rint(steps).astype(int).tolist()
        return (up_down, left_right), True

    def _taken(self) -> dict[Steps, int]:
        """Give the marks by the steps at which they were found."""
        return {steps: number for number, steps in self._steps.items() if steps is not None}


def record_spots(scan: ByDigitizer, at: ViewContext) -> dict[str, xr.Dataset]:
    """Record the digitised spots of a view: the group ``registration/<view>``.

    A spot is a point of the structure that no other view has, and so has a number of its own.
    """
    dac = scan.known_pixels(at.view)
    before = list(scan.views)[: list(scan.views).index(at.view)]
    first = 1 + sum(len(scan.known_pixels(view)) for view in before)
    places = []
    for spot, steps in enumerate(dac.tolist(), 1):
        measure = partial(_digitise, scan, at, spot, steps)
        asked = [*steps, scan.samples]
        places.append(at.camera.journal.answer(spot_name(spot), asked, measure))
    sampled = np.array(places)
    std = None
    if scan.samples > 1:
        std = sampled.std(axis=1, ddof=1) / np.sqrt(scan.samples)
    numbers = np.arange(first, first + len(dac))
    return _group(at, numbers, sampled.mean(axis=1), std, dac.astype(float))


def joined(found: Mapping[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    """Join the single views' registration to one group of a session."""
    views = [group for name, group in found.items() if name.startswith(f"{GROUP}/")]
    others = {name: g for name, g in found.items() if not name.startswith(f"{GROUP}/")}
    if not views:
        return others
    tables = [table for group in views for table in from_dataset(group, "")]
    return others | {GROUP: to_dataset(tables)}


def known_marks(scan: ByHand, target: Target | None) -> list[Mark]:
    """List the scan's own marks, or the points of the target.

    Raises
    ------
    UserError
        If there are neither, or those are the circles of a calibration object.
    """
    source = scan.own_marks() or target
    # Nobody sees where the bitangents of circles touch.
    if isinstance(source, Circles):
        raise UserError(
            "scan=by_hand needs marks to point at, and the target is circles, which a scan finds: "
            "choose scan=session with a rough pose of each view (scan.poses), or aim at them with "
            "sldvexp console, over SSH too; for marks choose target=fiducials, or give "
            "scan.fiducials; see sldvexp handbook aiming"
        )
    if source is None:
        raise UserError(
            "scan=by_hand needs marks to point at: choose target=fiducials, or give scan.fiducials"
        )
    points = source.points()
    every = zip(points.number, points.position, points.std, strict=True)
    return [Mark(int(number), position, std) for number, position, std in every]


def person_at(
    at: ViewContext,
    unit: LengthUnit = LengthUnit.m,
    taken: Callable[[], Mapping[Steps, int]] = dict,
    guide: AimingGuide | None = None,
) -> Person:
    """Find who does what the instrument cannot: a simulated one's own person, or the one we ask.

    Parameters
    ----------
    unit : LengthUnit
        In which the digitizer shows coordinates.
    taken : callable
        Gives the steps at which other marks, by their numbers, were found in this view.
    guide : AimingGuide, optional
        Of the view's marks.
    """
    if (aimed := at.operator.person(at.view)) is not None:
        return aimed
    instrument = at.camera.instrument
    if isinstance(instrument, Attended):
        return instrument.person
    return AtTerminal(at.operator, instrument, at.laser, at.view, unit, taken, guide)


def _digitise(
    scan: ByDigitizer, at: ViewContext, spot: int, steps: Steps
) -> list[tuple[float, float, float]]:
    """Send the beam to its DAC steps and measure where it falls, in m."""
    at.camera.instrument.move(steps)
    return person_at(at, scan.unit).digitise(spot, scan.samples)


def _told(steps: Steps | None) -> str:
    """Say where a mark was found."""
    return "hidden" if steps is None else f"{steps[0]} {steps[1]}"


def _group(
    at: ViewContext,
    number: IntArray,
    position: Array,
    std: Array | None,
    dac: Array,
) -> dict[str, xr.Dataset]:
    """Make registration data of one view."""
    angle = at.laser.angle_from_dac(dac)
    table = RegistrationTable(at.view, number, position, angle, dac, object_std=std)
    return {f"{GROUP}/{at.view}": to_dataset([table])}


HIDDEN = "hidden"


class AtTerminal:
    """A `Person` who sits at the terminal.

    Parameters
    ----------
    operator : Operator
        Shows requests and waits for lines.
    instrument : Instrument
        Moves the beam.
    laser : TwoMirror
        Its board limits the beam.
    view : str
    unit : LengthUnit
        In which the digitizer shows coordinates.
    taken : callable
        Gives the steps at which other marks, by their numbers, were found in this view.
    guide : AimingGuide, optional
        Of the view's marks.
    """

    def __init__(
        self,
        operator: Operator,
        instrument: Instrument,
        laser: TwoMirror,
        view: str,
        unit: LengthUnit = LengthUnit.m,
        taken: Callable[[], Mapping[Steps, int]] = dict,
        guide: AimingGuide | None = None,
    ) -> None:
        self.operator = operator
        self.instrument = instrument
        self.laser = laser
        self.view = view
        self.unit = unit
        self.taken, self.guide = taken, guide
        self.moved = False

    def aim(self, mark: Mark, start: Steps) -> Steps | None:
        """See `Person`; every line that is typed moves the beam, an empty one accepts."""
        beam, self.moved = start, False
        self.instrument.move(beam)
        request = (
            f"View {self.view}, mark {mark.number} at {in_mm(mark)}{self._where(mark)}. Type DAC "
            "steps up-down and left-right to move by (+5 -3) or a place to go to (=120 -40), Enter "
            f"when the spot is on the mark, {HIDDEN} if it cannot be seen.\n"
        )
        while True:
            where = f"mark {mark.number}, beam at {beam[0]} {beam[1]}: "
            answer = self.operator.ask(f"{request}{where}")
            if answer.lower() == HIDDEN:
                return None
            taken = self.taken()
            if not answer and beam not in taken:
                return beam
            request = ""
            if not answer:
                request = (
                    f"mark {taken[beam]} was found at {beam[0]} {beam[1]}, where mark "
                    f"{mark.number} cannot be too: move the beam onto it, or type {HIDDEN}\n"
                )
            elif (wanted := moved(beam, answer)) is None:
                request = f"{answer!r} is neither steps like +5 -3 nor a place like =120 -40\n"
            elif problem := beyond_board(wanted, self.laser):
                request = f"{problem}\n"
            else:
                beam, self.moved = wanted, True
                self.instrument.move(beam)

    def _where(self, mark: Mark) -> str:
        """Say that a mark is out of the mirrors' reach."""
        beyond = self.guide.out_of_reach() if self.guide is not None else {}
        told = beyond.get(mark_label(mark.number), "")
        return f"; {told}" if told else ""

    def review(self, found: Mapping[int, Steps | None]) -> None:
        """See `Reviewer`; asked only where the marks cannot be right, and somebody is there."""
        problem = self.guide.trouble() if self.guide is not None else ""
        while problem:
            request = (
                f"View {self.view}: {problem}.\nType the number of a mark to take it again, or "
                "Enter to go on all the same: "
            )
            try:
                answer = self.operator.ask(request)
            except NobodyThereError:
                return
            if answer.isdecimal() and int(answer) in found:
                raise TakenBackError(int(answer))
            numbers = ", ".join(str(number) for number in found)
            problem = f"{answer!r} is not a mark of this view; there are {numbers}" * bool(answer)

    def digitise(self, spot: int, samples: int) -> list[Place]:
        """See `Person`."""
        places: list[Place] = []
        problem = ""
        while len(places) < samples:
            answer = self.operator.ask(
                f"{problem}View {self.view}, spot {spot}, sample {len(places) + 1} of {samples}: "
                f"x y z in {self.unit.name}: "
            )
            place = _place(answer, self.unit)
            problem = f"{answer!r} is not three numbers x y z\n" if place is None else ""
            places += [place] if place else []
        return places


def _place(answer: str, unit: LengthUnit) -> Place | None:
    """Read three coordinates in m, None if the answer has not three finite numbers."""
    try:
        x, y, z = (float(part) * unit.value for part in re.split(r"[\s,;]+", answer))
    except ValueError:
        return None
    return (x, y, z) if np.isfinite([x, y, z]).all() else None
