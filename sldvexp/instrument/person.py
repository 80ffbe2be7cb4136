"""A person beside the instrument, who does what it cannot: see marks, hold a digitizer.

What a person found in an earlier run, in the place of the person.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from sldvexp.errors import UserError
from sldvexp.files import read_json
from sldvexp.geometry import KnownPose
from sldvexp.instrument.protocol import InstrumentError
from sldvexp.typing import Array
from sldvexp.writing import make_folder, whole_or_nothing

#: Bytes of a kept answer at most.
LONGEST = 2**20

#: Word of a kept answer about a mark that was taken where it was predicted.
UNMOVED = "unmoved"

Steps = tuple[int, int]
Place = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Mark:
    """A fiducial mark.

    Parameters
    ----------
    number : int
    position : ndarray, shape (3,), m
        As measured.
    std : ndarray, shape (3,), m
        Standard deviation of that.
    """

    number: int
    position: Array
    std: Array


class Person(Protocol):
    """Who points the beam and measures where it falls."""

    def aim(self, mark: Mark, start: Steps) -> Steps | None:
        """Return bring the beam onto a mark.

        Parameters
        ----------
        start : (up_down, left_right), steps
            Where the beam may begin.

        Returns
        -------
        (up_down, left_right), steps, or None if the mark cannot be seen from here.

        Raises
        ------
        TakenBackError
            If an earlier mark shall be aimed at again first.
        """

    def digitise(self, spot: int, samples: int) -> list[Place]:
        """Measure several times where the beam falls as it stands, in m.

        Parameters
        ----------
        spot : int
            Which spot of the view this is, from 1.
        samples : int
            How often.
        """


class ExpectedPlace(Protocol):
    """DAC steps at which a mark is expected, and their standard deviations, shape (2,)."""

    @property
    def dac(self) -> Array:
        """Steps, not rounded."""

    @property
    def std(self) -> Array:
        """Standard deviations of both."""

    @property
    def others(self) -> list[Array]:
        """Steps where it may be instead."""


class ResidualOfMark(Protocol):
    """Steps of a mark less those where the others put it, and their standard deviations."""

    @property
    def steps(self) -> Array:
        """Of both mirrors."""

    @property
    def std(self) -> Array:
        """Standard deviations of both."""

    @property
    def beside(self) -> bool:
        """True if that is more than errors explain."""


class AimingGuide(Protocol):
    """Knows marks of a view by their names, and tells from those taken where the others lie.

    Whoever runs a session may give one: here nothing is known of poses.
    """

    @property
    def taken(self) -> dict[str, Steps]:
        """Marks with their steps, in the order in which they were taken."""

    @property
    def unmoved(self) -> list[str]:
        """Marks that were taken where they were predicted, and tell nothing."""

    @property
    def open(self) -> list[str]:
        """Marks of which nothing was said, in the order in which they were given."""

    @property
    def stand(self) -> tuple[Array, Array] | None:
        """Rotation and origin, m, of the instrument by the marks taken; None if they tell none."""

    @property
    def said(self) -> list[str]:
        """Marks that were taken or cannot be seen, in the order in which that was said."""

    def take(self, name: str, dac: Sequence[float], unmoved: bool = False) -> None:
        """Take a mark at some steps; unmoved if nobody has moved the beam from a prediction."""

    def hide(self, name: str) -> None:
        """Note that a mark cannot be seen."""

    def repeat(self, name: str) -> Steps | None:
        """Open a mark again; give the steps where it was."""

    def predict(self, name: str) -> ExpectedPlace:
        """Tell where a mark lies; UserError if that is not known."""

    def out_of_reach(self) -> dict[str, str]:
        """Say of open marks that the mirrors do not reach by how much that is, by their names."""

    def residual(self, name: str) -> ResidualOfMark | None:
        """Compare a mark with where the others put it; None if they do not say."""

    def contradiction(self) -> str:
        """Say in one sentence which marks contradict one another; empty if none do."""

    def weakness(self) -> str:
        """Say in one sentence why little follows from the marks; empty if enough does."""

    def trouble(self) -> str:
        """Say in one sentence why nothing can be believed of the marks; empty if it can."""


#: Makes a guide for the marks of a view, whose rough pose may be known.
GuideMaker = Callable[[Sequence[Mark], KnownPose | None], AimingGuide]


class TakenBackError(Exception):
    """A person wants to answer about an earlier mark again.

    Parameters
    ----------
    number : int
        Of the mark.
    """

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


@runtime_checkable
class HandOnBeam(Protocol):
    """A person of whom is known if the beam was moved by hand, and not by a prediction alone."""

    @property
    def moved(self) -> bool:
        """True if it was moved onto the mark that was aimed at last."""


@runtime_checkable
class Reviewer(Protocol):
    """A person who looks at all marks of a view before the session goes on."""

    def review(self, found: Mapping[int, Steps | None]) -> None:
        """Look at them, by their numbers; raise `TakenBackError` to take one again."""


@runtime_checkable
class Attended(Protocol):
    """An instrument that brings a person along, as a simulated one does."""

    @property
    def person(self) -> Person:
        """Who is there."""


class RecordedPerson:
    """A `Person` who gives the answers that a view's folder has kept.

    Parameters
    ----------
    folder : Path
        Of the view.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.moved = True

    def aim(self, mark: Mark, start: Steps) -> Steps | None:
        """See `Person`."""
        steps, unmoved = steps_of(self._answer(mark_name(mark.number)))
        self.moved = not unmoved
        return steps

    def digitise(self, spot: int, samples: int) -> list[Place]:
        """See `Person`."""
        answer = self._answer(spot_name(spot))
        if len(answer) != samples:
            raise InstrumentError(
                f"{self.folder}: spot {spot} was digitised {len(answer)} times; scan.samples must "
                "say the same"
            )
        return [(x, y, z) for x, y, z in answer]

    def _answer(self, name: str) -> Any:
        kept = read_answer(self.folder / f"{name}.json")
        if kept is None:
            raise InstrumentError(
                f"{self.folder}: has no {name.replace('_', ' ')}; a recording can only be scanned "
                "as it was"
            )
        return kept["answer"]


def mark_name(number: int | str) -> str:
    """Name the answer about a mark, or about those of a pattern."""
    return f"mark_{number}"


def mark_label(number: int) -> str:
    """Name a mark for people, and for an `AimingGuide`."""
    return f"mark {number}"


def answer_of(steps: Steps | None, unmoved: bool) -> list[Any] | None:
    """Write down where a mark was found; unmoved if that is where it was predicted.

    Examples
    --------
    >>> answer_of((3, -4), False), answer_of((3, -4), True), answer_of(None, False)
    ([3, -4], [3, -4, 'unmoved'], None)
    """
    return None if steps is None else [*steps, *[UNMOVED] * unmoved]


def steps_of(answer: Sequence[Any] | None) -> tuple[Steps | None, bool]:
    """Read what `answer_of` wrote.

    Examples
    --------
    >>> steps_of([3, -4, "unmoved"]), steps_of(None)
    (((3, -4), True), (None, False))
    """
    return (None, False) if answer is None else ((answer[0], answer[1]), UNMOVED in answer[2:])


def spot_name(spot: int) -> str:
    """Name the answer about a digitised spot."""
    return f"spot_{spot}"


def write_answer(path: Path, question: Any, answer: Any) -> None:
    """Keep what a person answered, whole or not at all."""
    make_folder(path.parent)
    with whole_or_nothing(path) as beside:
        beside.write_text(json.dumps({"question": question, "answer": answer}))


def read_answer(path: Path) -> dict[str, Any] | None:
    """Read a kept question and its answer; None if there is none or its file is damaged."""
    try:
        kept = read_json(path, LONGEST)
    except (UserError, ValueError):
        return None
    return kept if isinstance(kept, dict) and {"question", "answer"} <= set(kept) else None
