"""Record of a run: a small file in its folder, which others can see without opening data."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path

from sldvexp.errors import UserError
from sldvexp.files import read_json
from sldvexp.writing import whole_or_nothing

FILE = "record.json"


class State(StrEnum):
    """Where a run stands. A missed run is done, but an expectation was not met."""

    waiting = "waiting"
    running = "running"
    failed = "failed"
    missed = "missed"
    done = "done"

    @property
    def finished(self) -> bool:
        """True if it left a dataset."""
        return self in (State.done, State.missed)


@dataclass(frozen=True)
class Record:
    """State of one run.

    Parameters
    ----------
    state : State
    identity : str
        Of everything that decides the result, see `sldvexp.pipeline.provenance.identity`.
    reason : str
        The sentence about a failure.
    seconds : float
        How long it took.
    process : int
        That runs it or ran it.
    overrides : list of str
        What makes it differ from the experiment's file.
    inputs : dict of str to str
        Digests of the files it read.
    steps : dict of str to float, s
        How long each step took.
    reused : list of str
        Those that another run had done.
    """

    state: State = State.waiting
    identity: str = ""
    reason: str = ""
    seconds: float = 0.0
    process: int = 0
    overrides: list[str] = field(default_factory=list)
    inputs: dict[str, str] = field(default_factory=dict)
    steps: dict[str, float] = field(default_factory=dict)
    reused: list[str] = field(default_factory=list)


def write(folder: Path, record: Record) -> None:
    """Leave the record in the run's folder, whole or not at all."""
    with whole_or_nothing(folder / FILE, lasting=record.state.finished) as beside:
        beside.write_text(json.dumps(asdict(record), indent=1))


def read(folder: Path) -> Record:
    """Read the record of a run's folder; a waiting run's if there is none, or it is damaged."""
    try:
        found = read_json(folder / FILE)
        return Record(**{**found, "state": State(found["state"])})
    except (UserError, ValueError, TypeError, KeyError):
        return Record()


class Stopwatch:
    """Seconds since it was made, by a clock that never goes backwards."""

    def __init__(self) -> None:
        self._start = time.monotonic()

    def seconds(self) -> float:
        """Count seconds so far."""
        return time.monotonic() - self._start
