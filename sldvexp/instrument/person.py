"""A person beside the instrument, who does what it cannot: see marks, hold a digitizer.

What a person found in an earlier run, in the place of the person.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from sldvexp.errors import UserError
from sldvexp.files import read_json
from sldvexp.instrument.protocol import InstrumentError
from sldvexp.typing import Array
from sldvexp.writing import make_folder, whole_or_nothing

#: Bytes of a kept answer at most.
LONGEST = 2**20

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

    def aim(self, mark: Mark, start: Steps) -> Steps | None:
        """See `Person`."""
        answer = self._answer(mark_name(mark.number))
        return None if answer is None else (answer[0], answer[1])

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


def mark_name(number: int) -> str:
    """Name the answer about a mark."""
    return f"mark_{number}"


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
