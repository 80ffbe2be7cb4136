"""Rows: the views, and differences of views, that a method uses (Eqs 5.3, 5.8 and 5.9).

Every method applies a row matrix A to both sides of ``v = D V``: ``A v = (A D) V``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError, nearest
from sldvexp.typing import Array


@dataclass(frozen=True)
class RowSet:
    """Rows of the identity (one view) or differences of two of them.

    Attributes
    ----------
    matrix : ndarray, shape (row, view)
        The matrix A.
    labels : tuple of str
        Each row as it is written: ``2`` or ``2-1``, with the views' names.
    note : str
        What their choice leaves open, in a sentence; empty if nothing.
    """

    matrix: Array
    labels: tuple[str, ...]
    note: str = ""

    def __str__(self) -> str:
        return ",".join(self.labels)

    def __len__(self) -> int:
        return len(self.labels)

    def __add__(self, other: RowSet) -> RowSet:
        return RowSet(np.vstack([self.matrix, other.matrix]), self.labels + other.labels)

    def take(self, indices: Sequence[int] | NDArray[np.int_]) -> RowSet:
        """Take the rows with these indices, in their order."""
        return RowSet(self.matrix[list(indices)], tuple(self.labels[i] for i in indices))

    @property
    def has_views(self) -> bool:
        """Whether any row is a single view, not a difference: only such rows see an intercept."""
        return bool(np.any(self.matrix.sum(axis=1) != 0))


@dataclass(frozen=True)
class RowChoice:
    """Rows that a strategy may use.

    Attributes
    ----------
    candidates : RowSet
        Rows that it may contain, and that ``best`` searches.
    every : RowSet, optional
        The rows called ``all``, if the strategy has such a set.
    count : int, optional
        How many rows it needs, neither fewer nor more.
    """

    candidates: RowSet
    every: RowSet | None = None
    count: int | None = None


def views(names: Sequence[str]) -> RowSet:
    """Take each view by itself (Eq 5.3)."""
    return RowSet(np.eye(len(names)), tuple(names))


def differences(names: Sequence[str]) -> RowSet:
    """Take every pairwise difference, the later view minus the earlier."""
    return _differences(names, list(combinations(range(len(names)), 2)))


def differences_from_first(names: Sequence[str]) -> RowSet:
    """Subtract the first view from all others (Eq 5.8)."""
    return _differences(names, [(0, k) for k in range(1, len(names))])


def _differences(names: Sequence[str], pairs: Sequence[tuple[int, int]]) -> RowSet:
    identity = np.eye(len(names))
    matrix = np.array([identity[j] - identity[i] for i, j in pairs]).reshape(-1, len(names))
    return RowSet(matrix, tuple(f"{names[j]}-{names[i]}" for i, j in pairs))


def parse(text: str, names: Sequence[str]) -> RowSet:
    """Parse rows written as in the dissertation, ``1-5,2,4``, or with names, ``top-left,right``.

    Parameters
    ----------
    text : str
        Views, or differences of two views, separated by commas. A view is its name or its
        number, counted from 1; a name wins over a number.

    Raises
    ------
    UserError
        If a row names no view, subtracts a view from itself, or is given twice.
    """
    identity = np.eye(len(names))
    matrix: list[Array] = []
    labels: list[str] = []
    for token in (part.strip() for part in text.split(",")):
        plus, minus = _parse_row(token, names)
        row = identity[plus] if minus is None else identity[plus] - identity[minus]
        label = names[plus] if minus is None else f"{names[plus]}-{names[minus]}"
        if any(np.array_equal(row, r) or np.array_equal(row, -r) for r in matrix):
            raise UserError(f"the rows {text} contain {token} twice; each row may stand there once")
        matrix.append(row)
        labels.append(label)
    return RowSet(np.array(matrix), tuple(labels))


def _parse_row(token: str, names: Sequence[str]) -> tuple[int, int | None]:
    """Find the view and the view that is subtracted from it, if any."""
    single = _view_index(token, names)
    if single is not None:
        return single, None
    # A name may itself contain a minus sign: try every place where the two could part.
    for cut in (k for k, letter in enumerate(token) if letter == "-"):
        plus, minus = (_view_index(t.strip(), names) for t in (token[:cut], token[cut + 1 :]))
        if plus is not None and minus is not None:
            if plus == minus:
                raise UserError(f"the row {token} subtracts a view from itself; name two views")
            return plus, minus
    raise UserError(
        f"the row '{token}' is no view (a name, or a number from 1 to {len(names)}) and no "
        f"difference of two; {nearest(token, names)}"
    )


def _view_index(token: str, names: Sequence[str]) -> int | None:
    if token in names:
        return list(names).index(token)
    if token.isdecimal() and 1 <= int(token) <= len(names):
        return int(token) - 1
    return None


def check(rows: RowSet, choice: RowChoice, needed: int) -> None:
    """Refuse rows that a strategy does not use, or that are too few for it.

    Parameters
    ----------
    needed : int
        Fewest rows that the model can be solved from.

    Raises
    ------
    UserError
    """
    # A single view's row sums to one, a difference's to zero.
    used = {bool(total) for total in choice.candidates.matrix.sum(axis=1)}
    for total, label in zip(rows.matrix.sum(axis=1), rows.labels, strict=True):
        if bool(total) not in used:
            kind = "a single view" if total else "a difference of views"
            raise UserError(
                f"the row {label} is {kind}, which this method does not use; "
                "reconstruction=combined takes any mixture"
            )
    if choice.count is not None and len(rows) != choice.count:
        raise UserError(f"exactly {choice.count} rows are needed, but {rows} are {len(rows)}")
    if choice.count is not None and np.linalg.matrix_rank(rows.matrix) < choice.count:
        raise UserError(
            f"the rows {rows} depend on one another; {choice.count} must be independent"
        )
    if len(rows) < needed:
        raise UserError(f"at least {needed} rows are needed, but there are {len(rows)}: {rows}")
