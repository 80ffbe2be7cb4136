"""Time left of a sweep, from the times that the steps of its finished runs took.

A run that is open takes the time of each step that it computes, and what is besides: reading,
writing, composing. A step that runs share is computed by the first of them alone; those are known
beforehand, since it is decided by the settings that it and the steps before it read. So one scan
for ten methods is counted once, and ten scans for ten seeds ten times. Times are medians over runs
without the first one, which loads the program besides; before there is a second they are told only
of runs beside which loading is nothing.
"""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Iterable, Sequence
from functools import cache

from sldvexp.config.experiment import Experiment
from sldvexp.pipeline.step import Step
from sldvexp.pipeline.steps import STEPS
from sldvexp.sweep.record import Record

#: Runs of so many seconds take long beside loading the program, s.
LONG = 30.0
#: Name of a step, and the overrides that decide what it adds.
Decided = tuple[str, tuple[str, ...]]
#: Keys of the configuration that a step may read.
KEYS = frozenset(Experiment.__dataclass_fields__)


class SweepTimeLeft:
    """Time left of the open runs of a sweep.

    Parameters
    ----------
    jobs : sequence of sequence of str
        The overrides of every run, in the order in which they are done.
    """

    def __init__(self, jobs: Sequence[Sequence[str]]) -> None:
        self._jobs = jobs
        self._open = dict.fromkeys(range(len(jobs)))
        self._known: set[Decided] = set()  # shared steps that are kept
        self._decided: dict[int, list[tuple[Step, Decided]]] = {}
        self._computed: dict[str, list[float]] = defaultdict(list)
        self._taken: dict[str, list[float]] = defaultdict(list)
        self._besides: list[float] = []
        self._seconds = self._passed = 0.0

    def add(self, number: int, record: Record, passed: float | None) -> None:
        """Note a run that has come to its end.

        Parameters
        ----------
        number : int
            Of the run, from 0.
        record : Record
        passed : float or None, s
            Since the run before came to its end, which is less than the run took if several are
            done at once; None if it was done before.
        """
        self._open.pop(number, None)
        for step, which in self._deciding(number):
            if step.shared and step.name in record.steps:
                self._known.add(which)
        if passed is None or not record.state.finished:
            return
        for name, seconds in record.steps.items():
            (self._taken if name in record.reused else self._computed)[name].append(seconds)
        self._besides.append(record.seconds - sum(record.steps.values()))
        if len(self._besides) != 1:
            self._seconds += record.seconds
            self._passed += passed
        elif record.seconds < LONG:
            self._besides[0] = float("nan")

    @property
    def seconds(self) -> float | None:
        """Time left, s; None if it cannot be told."""
        if not self._besides or (len(self._besides) == 1 and self._besides[0] != self._besides[0]):
            return None
        known, total = set(self._known), 0.0
        besides = _usual(self._besides)
        usually_taken, usually_computed = (
            {step.name: _usual(seconds[step.name]) for step in STEPS}
            for seconds in (self._taken, self._computed)
        )
        for number in self._open:
            total += besides
            for step, which in self._deciding(number):
                taken = step.shared and which in known
                known.add(which)
                total += (usually_taken if taken else usually_computed)[step.name]
        return total * (self._passed / self._seconds if self._seconds else 1.0)

    def _deciding(self, number: int) -> list[tuple[Step, Decided]]:
        """Find what decides every step of a run, or recall it."""
        if number not in self._decided:
            found = deciding(self._jobs[number])
            self._decided[number] = [(step, (step.name, found[step.name])) for step in STEPS]
        return self._decided[number]


def _usual(seconds: Sequence[float]) -> float:
    """Take the median without the first; zero if nothing is known."""
    return statistics.median(seconds[1:] or seconds) if seconds else 0.0


def deciding(overrides: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Choose the overrides of a run that decide what each step adds, by the step's name.

    Examples
    --------
    >>> found = deciding(["seed=2", "pose=edge", "scan.pixels=[3,4]", "experiment=plate"])
    >>> found["scan"]
    ('seed=2', 'scan.pixels=[3,4]', 'experiment=plate')
    >>> found = deciding(["reconstruction=absolute", "compare.a.robust=off", "compare.a.rows=all"])
    >>> found["comparison of the views"]
    ('compare.a.robust=off',)
    """
    names = {o: _name(o) for o in overrides}
    always = {o for o in overrides if _key(o) not in KEYS}
    found: dict[str, tuple[str, ...]] = {}
    for step in STEPS:
        before = _before(step)
        reads = {key for s in (step, *before) for key in s.reads}
        reads.update(names[o] for upstream in before for o in found[upstream.name])
        found[step.name] = tuple(o for o in overrides if o in always or _is_read(o, reads))
    return found


@cache
def _before(step: Step) -> tuple[Step, ...]:
    """Find the steps that make what a step needs."""
    earlier = STEPS[: STEPS.index(step)]
    names = step.after(earlier)
    return tuple(s for s in earlier if s.name in names)


def _is_read(override: str, reads: Iterable[str]) -> bool:
    """Tell whether an override gives what is read; who chooses a plugin keeps its usual settings.

    Such a choice may decide a setting that is read of the plugin after all, which costs time.
    """
    parts = _name(override).split(".")
    whole = len(parts) == 1 and "{" not in override
    for read in (key.split(".") for key in reads):
        met = all(r in ("*", p) for r, p in zip(read, parts, strict=False))
        if met and not (whole and len(read) > 1):
            return True
    return False


def _key(override: str) -> str:
    """Find the key of the configuration that an override is about, as ``laser``."""
    return _name(override).partition(".")[0]


def _name(override: str) -> str:
    """Find the dotted key that an override is about."""
    return override.lstrip("+~").partition("=")[0].rpartition("@")[2].replace("/", ".")
