"""Names of points in tables of several views, as P01 or A-3, and the numbers that they get.

Names that differ in nothing but a number at their end keep that number; others are numbered in the
order of their first appearance. One name is one point in all views, and the run keeps the names.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from sldvexp.dataset import Finding, Severity

#: A number at the end of a name, which 64 bits hold.
NUMBERED = re.compile(r"(?P<stem>.*?)(?P<number>[0-9]{1,9})")


def number_names(names: Mapping[str, Sequence[str]]) -> dict[str, int]:
    """Give each name of the points of all views a number.

    Parameters
    ----------
    names : mapping of str to sequence of str
        Of each view's rows, by the view.

    Examples
    --------
    >>> number_names({"front": ["P02", "P01"], "left": ["P04", "P02"]})
    {'P02': 2, 'P01': 1, 'P04': 4}
    >>> number_names({"front": ["tip", "root"]})
    {'tip': 1, 'root': 2}
    """
    whole = list(dict.fromkeys(name for own in names.values() for name in own))
    parts = [NUMBERED.fullmatch(name) for name in whole]
    numbers = [int(part["number"]) for part in parts if part is not None]
    stems = {part["stem"] for part in parts if part is not None}
    if len(set(numbers)) == len(whole) and len(stems) == 1:
        return dict(zip(whole, numbers, strict=True))
    return {name: i for i, name in enumerate(whole, 1)}


def called(names: Mapping[int, str], node: int) -> str:
    """Name a point for a message: by its name, or as a node.

    Examples
    --------
    >>> called({1: "P01"}, 1), called({}, 1)
    ('point P01', 'node 1')
    """
    return f"point {names[node]}" if node in names else f"node {node}"


def told_of_names(numbers: Mapping[str, int]) -> list[Finding]:
    """Say that the points of all views have names, and how they are numbered."""
    if not numbers:
        return []
    ordered = sorted(numbers, key=lambda name: numbers[name])
    parts = [NUMBERED.fullmatch(name) for name in ordered]
    kept = [int(part["number"]) for part in parts if part] == sorted(numbers.values())
    by = "the numbers at their ends" if kept else "the order in which they first appear"
    text = (
        f"the {len(ordered)} points have names, {ordered[0]} to {ordered[-1]}, by which views are "
        f"matched; inside they are numbered by {by}"
    )
    return [Finding("names", "points", text, Severity.note, size=float(len(ordered)))]
