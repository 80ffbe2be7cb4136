"""Answers to questions that differ from ones that were answered only in numbers.

``--cfg job seed=5`` is the page of ``--cfg job`` but for one line. A number takes the place of one
of its own kind only: a page shows that of a setting which holds integers, floating-point numbers
or truth values. What is anything else is asked of the program.

Nothing that takes time is imported; see `sldvexp.config.kept`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from sldvexp.cli import answers

#: A setting that gives a number or a truth value, with the dotted key of a table's entry.
KEY = r"((?:[A-Za-z_]\w*\.)*[A-Za-z_]\w*)"
NUMBER = re.compile(KEY + r"=(-?(?:0|[1-9]\d{0,14})(?:\.\d{1,15})?|true|false)")
#: Kinds of numbers as a page shows them.
INTEGER, FLOAT = re.compile(r"-?\d+"), re.compile(r"-?\d+\.\d+(?:e[+-]\d+)?")
TRUTH = ("true", "false")
#: Spaces before what is in a table.
INDENT = 2


def answer(arguments: Sequence[str]) -> str | None:
    """Find the answer to a question that was asked with other numbers, or without them.

    Parameters
    ----------
    arguments : sequence of str
        The command line without the program's name.

    Returns
    -------
    str or None
        None if there is none, or the numbers do not fit it.
    """
    others, numbers = _apart(arguments)
    if not numbers:
        return None
    names = (answers.question(others), name(arguments))
    pages = (page for page in map(answers.answer, names) if page is not None)
    return next((with_numbers(page, numbers) for page in pages), None)


def name(arguments: Sequence[str]) -> str:
    """Name the answer to a question whatever its numbers are; empty if it has none."""
    others, numbers = _apart(arguments)  # no question of its own has keys without values
    return answers.question([*others, *sorted(numbers)]) if numbers else ""


def with_numbers(page: str, numbers: Mapping[str, str]) -> str | None:
    r"""Put numbers in the places of others; None if one has no place of its kind.

    Parameters
    ----------
    page : str
        Tables in YAML, as ``--cfg job`` prints them.
    numbers : mapping of str to str
        By dotted keys.

    Examples
    --------
    >>> print(with_numbers("seed: 0\npose:\n  step: 0.5\n  name: a", {"pose.step": "0.00001"}))
    seed: 0
    pose:
      step: 1.0e-05
      name: a
    >>> with_numbers("seed: 0", {"seed": "0.5"})
    """
    lines = page.split("\n")
    for key, number in numbers.items():
        at = _line(lines, key.split("."))
        if at is None:
            return None
        start, _, shown = lines[at].partition(": ")
        changed = _as(shown, number)
        if changed is None:
            return None
        lines[at] = f"{start}: {changed}"
    return "\n".join(lines)


def _apart(arguments: Sequence[str]) -> tuple[list[str], dict[str, str]]:
    """Take numbers out of a command line; none if its other settings may set the same keys."""
    found = [NUMBER.fullmatch(argument) for argument in arguments]
    others = [a for a, number in zip(arguments, found, strict=True) if not number]
    numbers = {number[1]: number[2] for number in found if number}
    keys = [other.partition("=")[0].lstrip("+~") for other in others]
    if any(_meet(key, number) for key in keys for number in numbers):
        return [*arguments], {}
    if any("{" in other or "@" in other for other in others):
        return [*arguments], {}
    return others, numbers


def _meet(other: str, number: str) -> bool:
    """Tell whether a setting may set what a number sets; a choice from a group comes before it."""
    nested = f"{other}.".startswith(f"{number}.") or f"{number}.".startswith(f"{other}.")
    return other == number or ("." in other and nested)


def _line(lines: Sequence[str], parts: Sequence[str]) -> int | None:
    """Find the line of an entry: below the lines of its tables, and indented as entries are."""
    at, end = -1, len(lines)
    for depth, part in enumerate(parts):
        start = f"{' ' * (INDENT * depth)}{part}:"
        found = (k for k in range(at + 1, end) if lines[k].startswith(start))
        at = next(found, -1)
        if at < 0:
            return None
        inside = " " * (INDENT * (depth + 1))
        end = next((k for k in range(at + 1, end) if not lines[k].startswith(inside)), end)
    return at


def _as(shown: str, number: str) -> str | None:
    """Write a number as YAML does in the place of one of its kind; None if it is of another."""
    if number in TRUTH:
        return number if shown in TRUTH else None
    if INTEGER.fullmatch(number) and INTEGER.fullmatch(shown):
        return str(int(number))
    if FLOAT.fullmatch(number) and FLOAT.fullmatch(shown):
        told = repr(float(number))
        return told if "." in told else told.replace("e", ".0e")
    return None
