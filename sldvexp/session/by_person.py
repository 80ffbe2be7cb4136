"""One view by a person: marks that the beam was pointed at, spots that were digitised.

The person at the terminal: told where to point, asked what the digitizer shows.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import partial

import numpy as np

from sldvexp.errors import UserError
from sldvexp.instrument import Instrument
from sldvexp.instrument.person import Attended, Mark, Person, Place, Steps, mark_name, spot_name
from sldvexp.io.registration import RegistrationTable, from_dataset, to_dataset
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.scan.by_digitizer import ByDigitizer
from sldvexp.scan.by_hand import ByHand
from sldvexp.session.camera import Operator, ViewContext
from sldvexp.targets import Circles, Target
from sldvexp.typing import Array, IntArray
from sldvexp.units import LengthUnit

GROUP = "registration"
HOME: Steps = (0, 0)


def record_marks(scan: ByHand, at: ViewContext) -> dict[str, xr.Dataset]:
    """Record the marks that a person can point at in a view: the group ``registration/<view>``.

    Raises
    ------
    UserError
        If there are no marks, or all are hidden.
    """
    beam, found, dac = HOME, [], []
    taken: dict[Steps, int] = {}
    for mark in known_marks(scan, at.target):
        if mark.number in scan.views[at.view].hidden:
            continue
        aim = partial(_aim, at, mark, beam, taken)
        kept = at.camera.journal.answer(mark_name(mark.number), mark.position.tolist(), aim)
        if kept is not None:
            beam = (kept[0], kept[1])
            found.append(mark)
            dac.append(beam)
            taken[beam] = mark.number
    if not found:
        raise UserError(f"scan: none of the marks can be seen from the view {at.view}")
    numbers = np.array([mark.number for mark in found])
    position = np.array([mark.position for mark in found])
    std = np.array([mark.std for mark in found])
    return _group(at, numbers, position, std, np.array(dac, float))


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
    if source is None or isinstance(source, Circles):
        raise UserError(
            "scan=by_hand needs marks to point at: choose target=fiducials, or give scan.fiducials"
        )
    points = source.points()
    every = zip(points.number, points.position, points.std, strict=True)
    return [Mark(int(number), position, std) for number, position, std in every]


def person_at(
    at: ViewContext, unit: LengthUnit = LengthUnit.m, taken: Mapping[Steps, int] | None = None
) -> Person:
    """Find who does what the instrument cannot: a simulated one's own person, or the one we ask."""
    instrument = at.camera.instrument
    if isinstance(instrument, Attended):
        return instrument.person
    return AtTerminal(at.operator, instrument, at.laser, at.view, unit, taken)


def _aim(at: ViewContext, mark: Mark, start: Steps, taken: Mapping[Steps, int]) -> Steps | None:
    """Let a person bring the beam onto a mark, at other steps than those of earlier marks."""
    return person_at(at, taken=taken).aim(mark, start)


def _digitise(
    scan: ByDigitizer, at: ViewContext, spot: int, steps: Steps
) -> list[tuple[float, float, float]]:
    """Send the beam to its DAC steps and measure where it falls, in m."""
    at.camera.instrument.move(steps)
    return person_at(at, scan.unit).digitise(spot, scan.samples)


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

_STEPS = re.compile(r"(=?)\s*([+-]?\d+)[\s,;]+([+-]?\d+)")


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
    taken : mapping of (up_down, left_right) to int, optional
        Steps at which other marks, by their numbers, were found in this view.
    """

    def __init__(
        self,
        operator: Operator,
        instrument: Instrument,
        laser: TwoMirror,
        view: str,
        unit: LengthUnit = LengthUnit.m,
        taken: Mapping[Steps, int] | None = None,
    ) -> None:
        self.operator = operator
        self.instrument = instrument
        self.laser = laser
        self.view = view
        self.unit = unit
        self.taken = taken or {}

    def aim(self, mark: Mark, start: Steps) -> Steps | None:
        """See `Person`; every line that is typed moves the beam, an empty one accepts."""
        beam = start
        self.instrument.move(beam)
        x, y, z = mark.position / LengthUnit.mm.value
        request = (
            f"View {self.view}, mark {mark.number} at ({x:g}, {y:g}, {z:g}) mm. Type DAC steps "
            "up-down and left-right to move by (+5 -3) or a place to go to (=120 -40), Enter when "
            f"the spot is on the mark, {HIDDEN} if it cannot be seen.\n"
        )
        while True:
            where = f"mark {mark.number}, beam at {beam[0]} {beam[1]}: "
            answer = self.operator.ask(f"{request}{where}")
            if answer.lower() == HIDDEN:
                return None
            if not answer and beam not in self.taken:
                return beam
            request = ""
            if not answer:
                request = (
                    f"mark {self.taken[beam]} was found at {beam[0]} {beam[1]}, where mark "
                    f"{mark.number} cannot be too: move the beam onto it, or type {HIDDEN}\n"
                )
            elif (wanted := _moved(beam, answer)) is None:
                request = f"{answer!r} is neither steps like +5 -3 nor a place like =120 -40\n"
            elif problem := self._beyond(wanted):
                request = f"{problem}\n"
            else:
                beam = wanted
                self.instrument.move(beam)

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

    def _beyond(self, beam: Steps) -> str:
        """Say what is wrong with a place that the board does not have."""
        low, high = self.laser.board.value
        if low <= min(beam) and max(beam) <= high:
            return ""
        return f"{beam[0]} {beam[1]} is beyond the board's steps, {low} to {high}"


def _moved(beam: Steps, answer: str) -> Steps | None:
    """Read where the beam shall stand, None if the answer does not say it."""
    match = _STEPS.fullmatch(answer)
    if match is None:
        return None
    up_down, left_right = int(match[2]), int(match[3])
    return (up_down, left_right) if match[1] else (beam[0] + up_down, beam[1] + left_right)


def _place(answer: str, unit: LengthUnit) -> Place | None:
    """Read three coordinates in m, None if the answer has not three finite numbers."""
    try:
        x, y, z = (float(part) * unit.value for part in re.split(r"[\s,;]+", answer))
    except ValueError:
        return None
    return (x, y, z) if np.isfinite([x, y, z]).all() else None
