"""Mistakes of a user, each said in one sentence: what, where, and what would be right."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from sldvexp.limits import shown


class UserError(Exception):
    """A mistake in the input. Its text is one sentence for the user; no traceback is shown."""


@dataclass(frozen=True)
class Problem:
    """One thing wrong with one field; `field` is a dotted path below the object that found it."""

    field: str
    message: str


class ConfigError(UserError):
    """All problems that one object of the configuration found in its own fields."""

    def __init__(self, problems: Iterable[Problem]):
        self.problems = tuple(problems)
        super().__init__("; ".join(f"{p.field}: {p.message}" for p in self.problems))


def words_of(error: BaseException) -> str:
    """Say an error of others in one line, whatever they made it of.

    Examples
    --------
    >>> words_of(ZeroDivisionError("division by zero"))
    'ZeroDivisionError: division by zero'
    """
    try:
        told = " ".join(str(error).split())
    except Exception:
        told = ""
    return shown(f"{type(error).__name__}: {told}" if told else type(error).__name__)


class Checks:
    """Collects every problem of a configuration object before complaining once.

    Examples
    --------
    >>> checks = Checks()
    >>> checks.positive("diameter", 0.8)
    >>> checks.done()
    """

    def __init__(self) -> None:
        self.problems: list[Problem] = []

    def require(self, ok: bool, field: str, message: str) -> None:
        """Note `message` about `field` unless `ok`."""
        if not ok:
            self.problems.append(Problem(field, message))

    def finite(self, field: str, *values: float) -> None:
        """Require finite numbers."""
        bad = [v for v in values if not math.isfinite(v)]
        self.require(not bad, field, f"must be finite, not {bad[0] if bad else None}")

    def positive(self, field: str, value: float) -> None:
        """Require a finite number above zero."""
        ok = math.isfinite(value) and value > 0
        self.require(ok, field, f"must be a positive number, not {value}")

    def non_negative(self, field: str, value: float) -> None:
        """Require a finite number of zero or more."""
        ok = math.isfinite(value) and value >= 0
        self.require(ok, field, f"must be zero or a positive number, not {value}")

    def probability(self, field: str, value: float) -> None:
        """Require a number between zero and one, both excluded."""
        self.require(0 < value < 1, field, f"must lie between 0 and 1, not {value}")

    def done(self) -> None:
        """Raise one `ConfigError` if anything was noted."""
        if self.problems:
            raise ConfigError(self.problems)


#: Words that people say for ours.
SYNONYMS = {
    "approach": "reconstruction",
    "artefact": "target",
    "calibration": "target",
    "camera": "laser",
    "data": "instrument",
    "describe": "show",
    "diff": "compare",
    "doc": "handbook",
    "docs": "handbook",
    "draw": "plot",
    "experiments": "experiment",
    "explain": "show",
    "figure": "plot",
    "figures": "plot",
    "find": "list",
    "geometry": "volume",
    "get": "show",
    "info": "show",
    "ls": "list",
    "manual": "handbook",
    "method": "reconstruction",
    "mirrors": "laser",
    "object": "target",
    "page": "report",
    "position": "pose",
    "registration": "pose",
    "repeat": "rerun",
    "save": "export",
    "scanner": "laser",
    "search": "list",
    "shape": "volume",
    "surface": "volume",
    "test": "check",
    "verify": "check",
    "write": "export",
}


def nearest(name: str, valid: Iterable[str]) -> str:
    """Say which names are valid and which one was probably meant.

    That is one that people call so, one that is a typing error or two away, or one of which the
    name is a part; a name that is only somewhat like another is no guess.

    Examples
    --------
    >>> nearest("absolut", ["absolute", "relative"])
    'did you mean absolute? Valid: absolute, relative'
    >>> nearest("method", ["pose", "reconstruction"])
    'did you mean reconstruction? Valid: pose, reconstruction'
    >>> nearest("nope", ["pose", "compare"])
    'Valid: compare, pose'
    """
    valid = sorted(valid)
    meant = _meant(name, valid)
    guess = f"did you mean {meant}? " if meant else ""
    return f"{guess}Valid: {', '.join(valid)}" if valid else "there are none"


def _meant(name: str, valid: Sequence[str]) -> str | None:
    """Find the valid name that was probably meant."""
    if (synonym := SYNONYMS.get(name)) in valid:
        return synonym
    if name and name in valid:  # as it is asked before anybody knows whether it has to be told
        return name
    slips = [(_slips(name.casefold(), each.casefold()), each) for each in valid]
    fewest, alike = min(slips, default=(math.inf, None))
    if fewest <= max(1, len(name) // 3) and 2 * fewest < len(name):
        return alike
    parts = [each for each in valid if len(name) > 2 and name in each]
    parts += [each for each in valid if len(each) > 2 and each in name]
    return min(parts, key=lambda each: abs(len(each) - len(name)), default=None)


def _slips(typed: str, meant: str) -> int:
    """Count the typing errors between two words: letters too many, missing, wrong or exchanged.

    This is the distance of optimal string alignment.
    """
    before, above = [0] * (len(meant) + 1), list(range(len(meant) + 1))
    for i, letter in enumerate(typed, 1):
        row = [i]
        for j, wanted in enumerate(meant, 1):
            least = min(above[j] + 1, row[j - 1] + 1, above[j - 1] + (letter != wanted))
            if i > 1 and j > 1 and (letter, typed[i - 2]) == (meant[j - 2], wanted):
                least = min(least, before[j - 2] + 1)
            row.append(least)
        before, above = above, row
    return above[-1]
