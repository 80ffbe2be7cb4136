"""One view's marks by a person at a keyboard: arrow keys, what comes back, where the rest lies.

The terminal shows one line that lives: the beam, its step, how far it is from where the mark is
expected, light and velocity. From the third mark on the guide predicts, from the fourth on it
compares, so that a wrong mark is seen when it is taken and not when the report is read.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import NoReturn

import numpy as np

from sldvexp.errors import UserError
from sldvexp.instrument import Instrument, InstrumentError, Status
from sldvexp.instrument.bench import light_level
from sldvexp.instrument.person import (
    AimingGuide,
    ExpectedPlace,
    Mark,
    Place,
    Steps,
    TakenBackError,
    mark_label,
)
from sldvexp.laser import TwoMirror
from sldvexp.session.camera import Camera, ViewContext
from sldvexp.session.keyboard import Key, Keyboard
from sldvexp.typing import IntArray
from sldvexp.units import LengthUnit

#: How often the light is looked at while no key is pressed, s.
PERIOD = 0.3
#: Characters of the bar.
BAR = 10
#: Steps of an arrow key, by the key that chooses them; Shift takes ten times as many.
STEP_KEYS = {"1": 1, "2": 10, "3": 100}

HELP = (
    "Arrow keys move the beam, by 1, 10 or 100 steps (keys 1, 2, 3; with Shift ten times as far); "
    "+5 -3 moves by and =120 -40 to typed steps; g goes where the mark is expected, g again where "
    "it may be instead; Enter takes it, h leaves it out as hidden; u takes the last one back, r an "
    "earlier one; ? shows this."
)
REVIEW = "Enter goes on, u takes the last one back, r an earlier one"
#: The same of marks of which no pose can be believed.
REFUTED = "r takes a mark again by its number, u the last one; Enter twice goes on all the same"

#: What a mark tells that was taken where it was predicted, without a move of the beam.
TELLS_NOTHING = "it tells nothing until you have moved to what you see"

#: Part of the mirrors' range beyond which an error leaves open where a mark is.
VAGUE = 0.1

#: What is to be done about a mark beyond the mirrors' reach.
LEAVE_OUT = "h leaves it out when it is asked for, or turn the instrument and begin this view anew"

_STEPS = re.compile(r"(=?)\s*([+-]?\d+)[\s,;]+([+-]?\d+)")


class AtKeyboard:
    """A `Person` who sits at a terminal with arrow keys.

    Parameters
    ----------
    at : ViewContext
    guide : AimingGuide
        Of this view's marks; what is taken is told it by whoever asks this person.
    keyboard : Keyboard
        Open.
    """

    def __init__(self, at: ViewContext, guide: AimingGuide, keyboard: Keyboard) -> None:
        self.at, self.guide, self.keyboard = at, guide, keyboard
        self.step, self.level = 10, LightLevel()
        self.moved = False
        self._reported: dict[str, Steps] = {}
        self._beyond: set[str] = set()  # marks that were told to be out of the mirrors' reach
        keyboard.say(HELP)

    @cached_property
    def ways(self) -> dict[str, IntArray]:
        """Direction of each arrow in steps, as seen from the instrument."""
        up, left = np.diag(self.at.laser.ways)
        return {"up": up, "down": -up, "left": left, "right": -left}

    def aim(self, mark: Mark, start: Steps) -> Steps | None:
        """See `Person`."""
        self._report()
        aim = _Aim(self, mark, start)
        steps = aim.result()
        self.moved = aim.moved
        return steps

    def digitise(self, spot: int, samples: int) -> list[Place]:
        """See `Person`; nobody who points at marks is asked for it."""
        raise NotImplementedError

    def review(self, found: Mapping[int, Steps | None]) -> None:
        """See `Reviewer`; marks that cannot be right are not let pass by one key."""
        for name in self.guide.taken:
            self.keyboard.say(f"{name}: {self.in_words(name)}")
        if still := self.guide.unmoved:
            self.keyboard.say(
                f"{len(still)} of {len(self.guide.taken)} marks "
                f"{'were taken where they were' if len(still) > 1 else 'was taken where it was'} "
                f"predicted and {'are' if len(still) > 1 else 'is'} left out of the pose: "
                f"{', '.join(still)}. r takes one again; if the spot is right on it, move off and "
                "back"
            )
        trouble = self.guide.trouble()
        if told := trouble or self._doubts():
            self.keyboard.say(told)
        warned = not trouble
        while True:
            self.keyboard.status(REFUTED if trouble else REVIEW)
            key = self.keyboard.key()
            if key is not None and key.name == "enter":
                if warned:
                    return
                warned = True
                self.keyboard.say(f"The pose of this view would rest on these: {trouble}")
            elif key is not None:
                self.take_back(key)

    def in_words(self, name: str) -> str:
        """Say where a mark was taken, and how that agrees with the others."""
        beam, found = self.guide.taken[name], self.guide.residual(name)
        taken = f"taken at {beam[0]} {beam[1]}"
        if name in self.guide.unmoved:
            return f"{taken}, where it was predicted: {TELLS_NOTHING}"
        if found is None:
            return taken
        (up_down, left_right), (first, second) = found.steps, found.std
        return (
            f"{taken}, {up_down:+.1f} {left_right:+.1f} steps from where the others put it "
            f"(+- {first:.1f} {second:.1f}){', too far' if found.beside else ''}"
        )

    def take_back(self, key: Key) -> None:
        """Take back what a key says, if it says so.

        Raises
        ------
        TakenBackError
            For the session to ask about that mark again.
        """
        said = self.guide.said
        if key.name == "u" and said:
            self._open_again(said[-1])
        if key.name == "u":
            self.keyboard.say("nothing is taken yet")
        if key.name == "r" and (line := typed(self.keyboard, "again: mark ", "")) is not None:
            if (name := f"mark {line.strip()}") in said:
                self._open_again(name)
            self.keyboard.say(
                f"{line!r} is not a mark that was taken or left out: {', '.join(said)}"
            )

    def _open_again(self, name: str) -> NoReturn:
        """Take a mark back, and say which."""
        self.keyboard.status("")  # what it asks is answered
        self.keyboard.say(f"{name} taken back: aim at it again")
        raise TakenBackError(int(name.rpartition(" ")[2]))

    def _report(self) -> None:
        """Say what follows from the marks, once for each state of them."""
        taken = dict(self.guide.taken)
        if taken != self._reported:
            before, self._reported = self._reported, taken
            for name in list(taken)[-1:]:
                if before.get(name) != taken[name]:  # else one behind it was taken back
                    self.keyboard.say(f"{name}: {self.in_words(name)}")
            if told := self._doubts():
                self.keyboard.say(told)
            for name, told in self.guide.out_of_reach().items():
                if name not in self._beyond:
                    self._beyond.add(name)
                    self.keyboard.say(f"{told}: {LEAVE_OUT}")

    def _doubts(self) -> str:
        """Say which marks contradict one another, else why their pose is weak."""
        return self.guide.contradiction() or self.guide.weakness()


class _Aim:
    """Bring the beam onto one mark."""

    def __init__(self, person: AtKeyboard, mark: Mark, start: Steps) -> None:
        self.person, self.keyboard, self.mark, self.beam = person, person.keyboard, mark, start
        self.name = mark_label(mark.number)
        self.instrument: Instrument = person.at.camera.instrument
        self.expected = self._expected()
        self.vague = self.expected is not None and is_vague(self.expected, person.at.laser)
        if self.vague:
            self.expected = None
        self.goals = list(_goals(self.expected))
        self.goal, self.at_goal = 0, 0  # place that g goes to next, and that it went to last
        self.looked, self.moved = False, False

    def result(self) -> Steps | None:
        """Follow the keys until the mark is taken, or left out."""
        self.instrument.move(self.beam)
        self.keyboard.say(
            f"View {self.person.at.view}, {self.name} at {in_mm(self.mark)}{self._where()}"
        )
        while True:
            self._show()
            key = self.keyboard.key(PERIOD)
            if key is None:
                continue
            if key.name == "h" or (key.name == "enter" and self._is_taken()):
                self.keyboard.status("")
                return None if key.name == "h" else self.beam
            if key.name != "enter":
                self._do(key)

    def _do(self, key: Key) -> None:
        """Do what any other key says."""
        if key.name in self.person.ways:
            step = self.person.step * (10 if key.shift else 1)
            up_down, left_right = (
                (self.beam + step * self.person.ways[key.name]).astype(int).tolist()
            )
            self._go_by_hand((up_down, left_right))
        elif key.name in STEP_KEYS:
            self.person.step = STEP_KEYS[key.name]
        elif key.name in ("+", "-", "="):
            line = typed(self.keyboard, "move: ", key.name)
            wanted = None if line is None else moved(self.beam, line.strip())
            if wanted is not None:
                self._go_by_hand(wanted)
            elif line is not None:
                self.keyboard.say(f"{line!r} is neither steps like +5 -3 nor a place like =120 -40")
        elif key.name == "g":
            self._go_on()
        elif key.name == "?":
            self.keyboard.say(HELP)
        else:
            self.person.take_back(key)

    def _go_by_hand(self, wanted: Steps) -> None:
        """Move the beam where somebody wants it, whatever is predicted."""
        self.moved |= self._go(wanted)

    def _go(self, wanted: Steps) -> bool:
        """Move the beam, unless the board has no such place; say whether it has."""
        if problem := beyond_board(wanted, self.person.at.laser):
            self.keyboard.say(problem)
            return False
        self.beam = wanted
        self.instrument.move(wanted)
        return True

    def _go_on(self) -> None:
        """Go where the mark is expected, or may be instead."""
        if self.vague:
            self.keyboard.say(self._open())
            return
        if self.goals:
            if self.goals == [self.beam]:
                self.keyboard.say(
                    f"{self.name} is expected where the beam stands, and the marks taken give no "
                    "other place that the mirrors reach: move the beam onto it if it is beside"
                )
            at = self.goal % len(self.goals)
            if self._go(self.goals[at]):
                self.at_goal, self.moved = at, False
            self.goal += 1
            return
        try:
            self.person.guide.predict(self.name)
        except UserError as error:
            self.keyboard.say(str(error))

    def _expected(self) -> ExpectedPlace | None:
        try:
            return self.person.guide.predict(self.name)
        except UserError:
            return None

    def _where(self) -> str:
        """Say where the mark is expected."""
        if self.vague:
            return f"; {self._open()}"
        if self.expected is None:
            told = self.person.guide.out_of_reach().get(self.name, "")
            return f"; {told}: h leaves it out" if told else ""
        (up_down, left_right), std = np.rint(self.expected.dac), self.expected.std
        more = len(self.goals) - 1
        instead = f", or at {more} other place{'s' * (more > 1)}" if more > 0 else ""
        return (
            f", expected at {up_down:.0f} {left_right:.0f} steps (+- {std[0]:.1f} {std[1]:.1f})"
            f"{instead}: g goes there"
        )

    def _open(self) -> str:
        """Say that the marks do not tell where this one is."""
        names = " and ".join(", ".join(self.person.guide.taken).rsplit(", ", 1))
        return (
            f"{names} do not tell yet where {self.name} is, as when they lie nearly in a line or "
            "fit several poses: bring the beam onto it with the arrow keys"
        )

    def _is_taken(self) -> bool:
        """Tell whether the mark can be where the beam stands, and that not by prediction alone."""
        where = f"{self.beam[0]} {self.beam[1]}"
        for name, steps in self.person.guide.taken.items():
            if steps == self.beam and name != self.name:
                self.keyboard.say(
                    f"{name} was taken at {where}, where {self.name} cannot be too: move the beam "
                    "onto it, or press h if it cannot be seen"
                )
                return False
        if len(self.goals) > 1 and self.beam in self.goals and not self.looked:
            # Taken unseen, it would confirm whichever pose it was predicted by.
            self.looked = True
            self.keyboard.say(
                f"{where} is but one of {len(self.goals)} places where {self.name} may be: Enter "
                "again if the spot is on it"
            )
            return False
        return True

    def _show(self) -> None:
        """Draw the line that lives; what a narrow terminal has no room for is left out."""
        parts = [self.name, f"beam {self.beam[0]} {self.beam[1]}"]
        if self.goals:
            at = self.at_goal
            off = np.subtract(self.goals[at], self.beam)
            parts.append(f"to go {off[0]:+d} {off[1]:+d}")
            if len(self.goals) > 1:
                parts.append(f"to place {at + 1} of {len(self.goals)}")
        step = f"step {self.person.step}"
        if self.keyboard.is_waiting:  # whoever holds a key down shall not wait for the light
            parts.append(step)
        else:
            light, *volts = self.person.level.read(self.person.at.camera, self.instrument)
            parts += [light, step, *volts]
        self.keyboard.status(fitting(parts, self.keyboard.columns))


class LightLevel:
    """Light and velocity where the beam stands, in words; nothing of an instrument without them."""

    def __init__(self) -> None:
        self._can = True

    def read(self, camera: Camera, instrument: Instrument) -> list[str]:
        """Sample a pixel, and say what came back."""
        if not self._can:
            return ["no level"]
        try:
            pixel = camera.look()
            light = light_level(instrument, pixel)
        except InstrumentError as error:
            # A dead connection shows at the next move; to move, no instrument needs to sample.
            self._can = False
            return ["no level", str(error)]
        volts = pixel.counts[0] * np.asarray(pixel.volts_per_count)[:, None]
        velocity, reference = volts.std(axis=1)
        over = np.any(pixel.status & Status.over_range)
        return [
            f"light [{bar(light)}]{' over range' if over else ''}",
            f"velocity {velocity:.4f} V",
            f"reference {reference:.4f} V",
        ]


def bar(level: float) -> str:
    """Draw a level from 0 to 1.

    Examples
    --------
    >>> bar(0.42), bar(1.0)
    ('####......', '##########')
    """
    full = round(BAR * min(max(level, 0.0), 1.0))
    return "#" * full + "." * (BAR - full)


def fitting(parts: list[str], width: int) -> str:
    """Join the first of some words, two blanks between them, as many as a line has room for.

    Examples
    --------
    >>> fitting(["mark 1", "beam 0 0", "step 10"], 18)
    'mark 1  beam 0 0'
    """
    line = parts[0]
    for part in parts[1:]:
        if len(line) + 2 + len(part) >= width:
            break
        line += f"  {part}"
    return line


def typed(keyboard: Keyboard, request: str, begun: str) -> str | None:
    """Let a line be typed in the last line; None if it is given up with Escape."""
    line = begun
    while True:
        keyboard.status(f"{request}{line}")
        key = keyboard.key()
        if key is None:
            continue
        if key.name == "enter":
            return line
        if key.name == "escape" or (key.name == "backspace" and not line):
            return None
        if key.name == "backspace":
            line = line[:-1]
        elif len(key.name) == 1 and key.name.isprintable():
            line += key.name


def is_vague(expected: ExpectedPlace, laser: TwoMirror) -> bool:
    """Tell whether a mark's expected place says nothing, as its error is a large part of the range.

    An error that only spans the places of several poses does not: each of them can be gone to.
    """
    low, high = laser.board.value
    spanned = max((np.abs(other - expected.dac).max() for other in expected.others), default=0.0)
    return bool(np.max(expected.std) > max(VAGUE * (high - low), spanned))


def _goals(expected: ExpectedPlace | None) -> Iterator[Steps]:
    """Give whole steps of all places where a mark may be, the likeliest first."""
    for dac in [] if expected is None else [expected.dac, *expected.others]:
        up_down, left_right = np.rint(dac).astype(int).tolist()
        yield up_down, left_right


def in_mm(mark: Mark) -> str:
    """Say where a mark stands."""
    x, y, z = mark.position / LengthUnit.mm.value
    return f"({x:g}, {y:g}, {z:g}) mm"


def beyond_board(beam: Steps, laser: TwoMirror) -> str:
    """Say what is wrong with a place that the board does not have."""
    low, high = laser.board.value
    if low <= min(beam) and max(beam) <= high:
        return ""
    return f"{beam[0]} {beam[1]} is beyond the board's steps, {low} to {high}"


def moved(beam: Steps, answer: str) -> Steps | None:
    """Read where the beam shall stand, None if the answer does not say it.

    Examples
    --------
    >>> moved((10, 20), "+5 -3"), moved((10, 20), "=7, 8"), moved((10, 20), "left")
    ((15, 17), (7, 8), None)
    """
    match = _STEPS.fullmatch(answer)
    if match is None:
        return None
    up_down, left_right = int(match[2]), int(match[3])
    return (up_down, left_right) if match[1] else (beam[0] + up_down, beam[1] + left_right)
