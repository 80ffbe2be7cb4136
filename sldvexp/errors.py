"""Mistakes of a user, each said in one sentence: what, where, and what would be right."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
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


def nearest(name: str, valid: Iterable[str]) -> str:
    """Say which names are valid and which one was probably meant.

    Examples
    --------
    >>> nearest("absolut", ["absolute", "relative"])
    'did you mean absolute? Valid: absolute, relative'
    """
    valid = sorted(valid)
    close = difflib.get_close_matches(name, valid, n=1, cutoff=0.5)
    guess = f"did you mean {close[0]}? " if close else ""
    return f"{guess}Valid: {', '.join(valid)}" if valid else "there are none"
