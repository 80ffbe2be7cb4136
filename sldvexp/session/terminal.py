"""The person at the terminal: told where to point, asked what the digitizer shows."""

from __future__ import annotations

import re
from collections.abc import Mapping

import numpy as np

from sldvexp.instrument.person import Mark, Place, Steps
from sldvexp.instrument.protocol import Instrument
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.session.operator import Operator
from sldvexp.units import LengthUnit

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
        """What is wrong with a place that the board does not have."""
        low, high = self.laser.board.value
        if low <= min(beam) and max(beam) <= high:
            return ""
        return f"{beam[0]} {beam[1]} is beyond the board's steps, {low} to {high}"


def _moved(beam: Steps, answer: str) -> Steps | None:
    """Where the beam shall stand, None if the answer does not say it."""
    match = _STEPS.fullmatch(answer)
    if match is None:
        return None
    up_down, left_right = int(match[2]), int(match[3])
    return (up_down, left_right) if match[1] else (beam[0] + up_down, beam[1] + left_right)


def _place(answer: str, unit: LengthUnit) -> Place | None:
    """Three coordinates in m, None if the answer has not three finite numbers."""
    try:
        x, y, z = (float(part) * unit.value for part in re.split(r"[\s,;]+", answer))
    except ValueError:
        return None
    return (x, y, z) if np.isfinite([x, y, z]).all() else None
