"""Marks of each view: places that are aimed at, and where they were found.

Every part of a scan wants places of its own: `CalibrationScan` the rough centres of the circles,
`Rectangle` four corners of the region that is imaged, `ByDigitizer` any number of spots. Fiducials
of `ByHand` are no part of a configuration, which only says which of them are hidden; the run gets
where they were found from `AimedPerson`, in the place of a person at the terminal.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, fields
from typing import Any

from sldvexp.config.experiment import Experiment
from sldvexp.instrument import InstrumentError
from sldvexp.instrument.person import Mark, Place, Steps, TakenBackError
from sldvexp.scan import Scan, ScanPart
from sldvexp.scan.by_digitizer import ByDigitizer
from sldvexp.scan.by_hand import ByHand
from sldvexp.scan.calibration import CalibrationScan
from sldvexp.scan.rectangle import Rectangle
from sldvexp.scan.session import Session
from sldvexp.session.by_person import known_marks
from sldvexp.targets import Circles, FiducialPoints

Name = tuple[str, int]

CIRCLE, CORNER, SPOT, FIDUCIAL = "circle", "corner", "spot", "fiducial"
#: Corners of a region.
CORNERS = 4
#: Where the places of a kind stand in a part's view.
KEYS = {CIRCLE: "dac", CORNER: "corners", SPOT: "dac"}


def used_parts(scan: Scan, by_hand: bool = False) -> dict[str, ScanPart]:
    """List the parts of a scan that has places to aim at, by their keys below ``scan``.

    The parts of a session that has no views at all are the calibration object, or marks if the
    instrument is posed by hand, and the structure.
    """
    if isinstance(scan, ScanPart):
        return {"": scan}
    assert isinstance(scan, Session)
    every = {f.name: getattr(scan, f.name) for f in fields(scan)}
    parts = {name: part for name, part in every.items() if isinstance(part, ScanPart)}
    used = {name: part for name, part in parts.items() if part.views}
    if used:
        return used
    first = "marks" if by_hand else "calibration"
    return {name: parts[name] for name in (first, "structure")}


def kind_of(part: ScanPart) -> str:
    """Name the kind of places that a part wants; empty if none."""
    kinds = {CalibrationScan: CIRCLE, Rectangle: CORNER, ByDigitizer: SPOT, ByHand: FIDUCIAL}
    return next((kind for of, kind in kinds.items() if isinstance(part, of)), "")


def parts_of(experiment: Experiment) -> dict[str, ScanPart]:
    """List the parts of an experiment's scan that has places to aim at, see `used_parts`."""
    return used_parts(experiment.scan, isinstance(experiment.target, FiducialPoints))


def wanted(experiment: Experiment) -> dict[str, list[int]]:
    """List the numbers of the places that every view wants, by their kinds; spots are open."""
    found: dict[str, list[int]] = {}
    for part in parts_of(experiment).values():
        kind = kind_of(part)
        if kind == CIRCLE:
            circles = isinstance(experiment.target, Circles)
            found[kind] = sorted(experiment.target.circles) if circles else [1, 2, 3, 4]
        elif kind == CORNER:
            found[kind] = list(range(1, CORNERS + 1))
        elif kind == SPOT:
            found[kind] = []
        elif isinstance(part, ByHand):
            found[kind] = [mark.number for mark in known_marks(part, experiment.target)]
    return found


def circle_numbers(experiment: Experiment, view: str) -> list[int]:
    """List the numbers of a view's circles in the order of its scan; none if nobody knows them."""
    for part in experiment.scan.parts(view):
        if isinstance(part, CalibrationScan):
            given = part.views[view]
            searched = given.pose is not None and isinstance(experiment.target, Circles)
            return list(experiment.target.circles) if searched else given.circles
    return []


def view_names(experiment: Experiment) -> list[str]:
    """List the views to aim in: the scan's own, those of the virtual lab, or one."""
    own = experiment.scan.view_names()
    return own or list(getattr(experiment.scene, "views", {})) or ["1"]


def configured(experiment: Experiment) -> set[str]:
    """Name the views of which the experiment has steps of its own, which a scan uses."""
    own = (KEYS[CIRCLE], KEYS[CORNER], "path")
    return {
        view
        for part in parts_of(experiment).values()
        for view, given in part.views.items()
        if any(getattr(given, name, None) for name in own)
    }


@dataclass(frozen=True)
class AimedMark:
    """A mark that was taken.

    Parameters
    ----------
    steps : (up_down, left_right)
    unmoved : bool
        Whether the program alone has brought the beam there, to its prediction: it has the other
        marks' pose and would confirm any.
    """

    steps: Steps
    unmoved: bool = False


@dataclass(frozen=True)
class MarkChange:
    """One mark that was set or taken away: what it was before and is now."""

    view: str
    name: Name
    before: AimedMark | None
    after: AimedMark | None


class AimedPerson:
    """A `Person` who has pointed at the fiducials of a view before.

    Parameters
    ----------
    found : dict of int to AimedMark
        By the marks' numbers.
    removed : set of int
        Numbers of marks that were taken away again.
    """

    def __init__(self, found: Mapping[int, AimedMark], removed: Collection[int] = ()) -> None:
        self.found, self.removed = found, removed
        self.moved = False
        self._asked: set[int] = set()

    def aim(self, mark: Mark, start: Steps) -> Steps | None:
        """See `Person`; a mark that was not found is hidden."""
        self._asked.add(mark.number)
        found = self.found.get(mark.number)
        self.moved = found is not None and not found.unmoved
        return None if found is None else found.steps

    def review(self, found: Mapping[int, Steps | None]) -> None:
        """See `Reviewer`; what was aimed anew counts, in the place of what a run has kept.

        A run that was begun elsewhere may have kept marks that nobody has touched here. Each of
        the others is asked for once, also at the steps that were kept: who has moved off a mark
        and back has taken it there by hand.
        """
        for number in (*self.found, *self.removed):
            if number in found and number not in self._asked:
                raise TakenBackError(number)

    def digitise(self, spot: int, samples: int) -> list[Place]:
        """See `Person`; who points has no digitizer."""
        raise InstrumentError("nobody digitises where fiducials are pointed at")


class AimedMarks:
    """Marks of all views, with a history that can be gone back and forth."""

    def __init__(self) -> None:
        self._found: dict[str, dict[Name, AimedMark]] = {}
        self._done: list[MarkChange] = []
        self._undone: list[MarkChange] = []

    @property
    def every(self) -> dict[str, dict[Name, AimedMark]]:
        """Marks of all views that have any."""
        return {view: dict(marks) for view, marks in self._found.items() if marks}

    def of(self, view: str) -> dict[Name, Steps]:
        """Give the marks of a view."""
        return {name: mark.steps for name, mark in self._found.get(view, {}).items()}

    def telling(self, view: str) -> dict[Name, Steps]:
        """Give those of them that the program alone has not taken where they were predicted."""
        every = self._found.get(view, {})
        return {name: mark.steps for name, mark in every.items() if not mark.unmoved}

    def put(self, view: str, name: Name, steps: Steps | None, unmoved: bool = False) -> None:
        """Set a mark, or take it away."""
        before = self._found.get(view, {}).get(name)
        after = None if steps is None else AimedMark(steps, unmoved)
        change = MarkChange(view, name, before, after)
        self._undone = []
        self._done.append(change)
        self._put(change, change.after)

    def undo(self) -> MarkChange | None:
        """Take the last change back."""
        return self._step(self._done, self._undone, forwards=False)

    def redo(self) -> MarkChange | None:
        """Repeat what was taken back."""
        return self._step(self._undone, self._done, forwards=True)

    @property
    def can(self) -> tuple[bool, bool]:
        """True if something can be taken back, and if something can be repeated."""
        return bool(self._done), bool(self._undone)

    def settings(
        self, experiment: Experiment, predicted: Mapping[str, Mapping[Name, Steps]] | None = None
    ) -> dict[str, Any]:
        """Make the part ``scan`` of a configuration that has the marks as its parts want them.

        Only views of which something was marked are in it. Circles and corners of these that were
        not marked are taken where they are `predicted`, by the view's name.
        """
        made: dict[str, Any] = {}
        numbers = wanted(experiment)
        for key, part in parts_of(experiment).items():
            kind = kind_of(part)
            views: dict[str, Any] = {}
            for view in self._found:
                places = self._places(view, kind, (predicted or {}).get(view, {}))
                if places and kind == FIDUCIAL:
                    found = self.numbers(view, kind)
                    views[view] = {"hidden": [n for n in numbers[kind] if n not in found]}
                elif places:
                    views[view] = {KEYS[kind]: [list(steps) for steps in places.values()]}
                    if kind == CIRCLE:
                        views[view]["circles"] = list(places)
            if views:
                (made.setdefault(key, {}) if key else made)["views"] = views
        return made

    def unmeasured(self) -> list[str]:
        """Name the views of which the program alone has taken every fiducial."""
        aimed = {view: [k for k in marks if k[0] == FIDUCIAL] for view, marks in self.every.items()}
        return [v for v, names in aimed.items() if names and not self.telling(v).keys() & names]

    def numbers(self, view: str, kind: str) -> set[int]:
        """Give the numbers of a view's marks of a kind."""
        return {number for of, number in self._found.get(view, {}) if of == kind}

    def person(self, view: str) -> AimedPerson | None:
        """Give the person who has found this view's fiducials, None if nobody has."""
        every = self._found.get(view, {})
        found = {n: mark for (of, n), mark in every.items() if of == FIDUCIAL}
        changed = {c.name[1] for c in self._done if c.view == view and c.name[0] == FIDUCIAL}
        return AimedPerson(found, changed - found.keys()) if found else None

    def _places(self, view: str, kind: str, predicted: Mapping[Name, Steps]) -> dict[int, Steps]:
        """Give a view's places of a kind, in the order of their numbers."""
        found = self.of(view)
        foreseen = predicted if found and kind in (CIRCLE, CORNER) else {}
        every = {**foreseen, **found}
        return {name[1]: every[name] for name in sorted(every) if name[0] == kind}

    def _step(
        self, source: list[MarkChange], sink: list[MarkChange], forwards: bool
    ) -> MarkChange | None:
        if not source:
            return None
        change = source.pop()
        sink.append(change)
        self._put(change, change.after if forwards else change.before)
        return change

    def _put(self, change: MarkChange, mark: AimedMark | None) -> None:
        view = self._found.setdefault(change.view, {})
        if mark is None:
            view.pop(change.name, None)
        else:
            view[change.name] = mark
