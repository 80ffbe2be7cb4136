"""Rows of a shell's splines with the few coefficients alone that are not zero at a place.

A spline is not zero in ``degree + 1`` cells along each direction, so that of all coefficients those
of 16 + 16 + 36 functions matter at a place, and the same ones at all places of a cell. Products of
rows are then small dense products, cell by cell, and ``sum_p a_p a_p'`` is put together from them.
Functions around holes matter everywhere.

Where u0 and v0 follow w by ``c_uv = T c_w`` (`sldvexp.shell.least_stretch`), T is dense, and rows
would be as well. So the coefficients that they have by following are written behind the others,
``c -> E c``: rows of these are short again, and products with rows of c are those with E.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np

from sldvexp.shell.around_holes import HoleFunctions
from sldvexp.shell.linear_form import LinearForm, Term
from sldvexp.shell.splines import TensorSplines
from sldvexp.typing import Array, IndexArray, IntArray

#: Columns of coefficients that places have their own in memory of.
COLUMNS = 8


class _Following(Protocol):
    """How u0 and v0 follow w: T, shape (2, function, function)."""

    @property
    def following(self) -> Array: ...


class SplinedShell(Protocol):
    """Splines and functions around holes that the fields of a shell are made of."""

    @property
    def bending(self) -> TensorSplines: ...
    @property
    def membrane(self) -> TensorSplines: ...
    @property
    def around_holes(self) -> HoleFunctions: ...
    @property
    def stretch(self) -> _Following | None: ...
    @property
    def coefficients(self) -> int: ...


class _Block(NamedTuple):
    """Coefficients of one field in one kind of splines, from the place where they begin."""

    field: int
    of_w: bool
    begin: int


class Cells(NamedTuple):
    """Places cell by cell.

    Attributes
    ----------
    order : ndarray of int, shape (place,)
        Places of one cell after those of another.
    each : list of tuple of slice and ndarray of int
        Of a cell: its places, in that order, and its coefficients.
    """

    order: IndexArray
    each: list[tuple[slice, IntArray]]


@dataclass(frozen=True, eq=False)
class LocalRows:
    """Places on a shell, and the functions that are not zero there.

    Attributes
    ----------
    shell : SplinedShell
    coordinates : ndarray, shape (place, 2), m
    """

    shell: SplinedShell
    coordinates: Array

    @cached_property
    def _along(self) -> dict[tuple[bool, int], tuple[IntArray, Array]]:
        """Cells, and coordinates in the unit, of both kinds of splines and both directions."""
        found = {}
        for of_w, splines in ((False, self.shell.membrane), (True, self.shell.bending)):
            for axis, own in enumerate((splines.along_s, splines.along_t)):
                found[of_w, axis] = own.cell_of(self.coordinates[:, axis] / splines.unit)
        return found

    def _functions(self, of_w: bool, axis: int, order: int) -> Array:
        """Evaluate derivatives of the functions along s (0) or t (1), (place, degree + 1)."""
        key = (of_w, axis, order)
        if key not in self._known:
            splines = self._splines(of_w)
            own = (splines.along_s, splines.along_t)[axis]
            self._known[key] = own.local(*self._along[of_w, axis], order) / splines.unit**order
        return self._known[key]

    @cached_property
    def _known(self) -> dict[tuple[bool, int, int], Array]:
        return {}

    def _splines(self, of_w: bool) -> TensorSplines:
        return self.shell.bending if of_w else self.shell.membrane

    @cached_property
    def cells(self) -> Cells:
        """Places sorted by cell."""
        number = np.zeros(len(self.coordinates), np.intp)
        for (of_w, axis), (cell, _) in self._along.items():
            splines = self._splines(of_w)
            number = number * (splines.along_s, splines.along_t)[axis].cells + cell
        order = np.argsort(number, kind="stable")
        ends = np.flatnonzero(np.diff(number[order])) + 1
        begins = np.r_[0, ends].astype(np.intp)
        slices = [slice(a, b) for a, b in zip(begins, np.r_[ends, len(order)], strict=True)]
        own = self._coefficients(order[begins]) if len(order) else np.zeros((0, 0), np.int64)
        return Cells(order, list(zip(slices, own, strict=False)))

    def _coefficients(self, places: IndexArray) -> IntArray:
        """Find the coefficients that matter at places, shape (place, own)."""
        parts = []
        for block in blocks_of(self.shell):
            splines = self._splines(block.of_w)
            s = splines.along_s.functions[self._along[block.of_w, 0][0][places]]
            t = splines.along_t.functions[self._along[block.of_w, 1][0][places]]
            number = s[:, :, None] * splines.along_t.count + t[:, None, :]
            parts.append(block.begin + number.reshape(len(places), -1))
        first, holes = self.shell.coefficients, self.shell.around_holes.count
        around = np.arange(first - holes, first)
        return np.hstack([*parts, np.broadcast_to(around, (len(places), holes))])

    def row(self, form: LinearForm) -> Array:
        """Make the rows of a form, shape (place, own)."""
        count, parts = len(self.coordinates), []
        for block in blocks_of(self.shell):
            of_s = [
                factor[:, None] * self._functions(block.of_w, 0, i)
                for (field, i, _), factor in form.terms.items()
                if field == block.field
            ]
            of_t = [
                self._functions(block.of_w, 1, j)
                for field, _, j in form.terms
                if field == block.field
            ]
            functions = self._widths(block.of_w)
            if not of_s:
                parts.append(np.zeros((count, functions[0] * functions[1])))
                continue
            both = np.stack(of_s, axis=-1) @ np.stack(of_t, axis=1)
            parts.append(both.reshape(count, -1))
        around = np.zeros((count, self.shell.around_holes.count))
        for (field, i, j), factor in form.terms.items():
            if field == 2 and around.shape[1]:
                around += factor[:, None] * self.shell.around_holes(self.coordinates, i, j)
        return np.hstack([*parts, around])

    def _widths(self, of_w: bool) -> tuple[int, int]:
        splines = self._splines(of_w)
        return splines.along_s.degree + 1, splines.along_t.degree + 1

    def gram(self, rows: Array) -> Array:
        """Add up products of rows with one another over all places, ``sum_p a_p a_p'``.

        Parameters
        ----------
        rows : ndarray, shape (place, own)

        Returns
        -------
        ndarray, shape (coefficient, coefficient)
        """
        found = np.zeros((spread_count(self.shell),) * 2)
        rows = rows[self.cells.order]
        for some, own in self.cells.each:
            found[own[:, None], own] += rows[some].T @ rows[some]
        return put_together(self.shell, put_together(self.shell, found).T)

    def crossed(self, rows: Array, columns: Array) -> Array:
        """Add up products of rows with columns over all places, shape (coefficient, column).

        Parameters
        ----------
        rows : ndarray, shape (place, own)
        columns : ndarray, shape (place, column)
        """
        found = np.zeros((spread_count(self.shell), columns.shape[1]))
        rows, columns = rows[self.cells.order], columns[self.cells.order]
        for some, own in self.cells.each:
            found[own] += rows[some].T @ columns[some]
        return put_together(self.shell, found)

    def jets(self, terms: Sequence[Term]) -> Array:
        """Make the rows of derivatives of the fields, shape (place, term, own)."""
        parts = []
        for block in blocks_of(self.shell):
            width = self._widths(block.of_w)
            part = np.zeros((len(self.coordinates), len(terms), *width))
            for k, (field, i, j) in enumerate(terms):
                if field == block.field:
                    of_s, of_t = (
                        self._functions(block.of_w, axis, n) for axis, n in ((0, i), (1, j))
                    )
                    np.multiply(of_s[:, :, None], of_t[:, None, :], out=part[:, k])
            parts.append(part.reshape(*part.shape[:2], -1))
        around = np.zeros((*parts[0].shape[:2], self.shell.around_holes.count))
        for k, (field, i, j) in enumerate(terms):
            if field == 2 and around.shape[-1]:
                around[:, k] = self.shell.around_holes(self.coordinates, i, j)
        return np.concatenate([*parts, around], axis=-1)

    def values(self, theta: Array, terms: Sequence[Term]) -> Array:
        """Evaluate derivatives of fields with known coefficients, shape (place, term, column).

        Parameters
        ----------
        theta : ndarray, shape (coefficient, column)
        """
        columns = theta.shape[1]
        if columns > COLUMNS:
            parts = np.array_split(theta, -(-columns // COLUMNS), axis=1)
            return np.concatenate([self.values(part, terms) for part in parts], axis=-1)
        spread = spread_out(self.shell, theta)
        found = np.zeros((len(self.coordinates), len(terms), columns))
        for block in blocks_of(self.shell):
            mine = [k for k, (field, _, _) in enumerate(terms) if field == block.field]
            if not mine:
                continue
            patches = self._patches(spread, block)
            by_s: dict[int, Array] = {}
            for k in mine:
                _, i, j = terms[k]
                if i not in by_s:
                    of_s = self._functions(block.of_w, 0, i)[:, None, :]
                    by_s[i] = np.matmul(of_s, patches).reshape(len(of_s), -1, columns)
                of_t = self._functions(block.of_w, 1, j)[:, None, :]
                found[:, k] += np.matmul(of_t, by_s[i])[:, 0]
        for k, (field, i, j) in enumerate(terms):
            if field == 2 and self.shell.around_holes.count:
                around = theta[len(theta) - self.shell.around_holes.count :]
                found[:, k] += self.shell.around_holes(self.coordinates, i, j) @ around
        return found

    def of_forms(self, theta: Array, forms: Sequence[LinearForm]) -> Array:
        """Compute forms of fields with known coefficients, shape (place, form, column)."""
        terms = sorted({term for form in forms for term in form.terms})
        jets = self.values(theta, terms)
        found = np.zeros((len(self.coordinates), len(forms), theta.shape[1]))
        for k, form in enumerate(forms):
            for term, factor in form.terms.items():
                found[:, k] += factor[:, None] * jets[:, terms.index(term)]
        return found

    def _patches(self, spread: Array, block: _Block) -> Array:
        """Give every place the coefficients of its cell, (place, along s, along t and column)."""
        splines, columns = self._splines(block.of_w), spread.shape[1]
        s, t = splines.along_s, splines.along_t
        own = spread[block.begin : block.begin + splines.count].reshape(s.count, t.count, columns)
        by_cell = own[s.functions[:, None, :, None], t.functions[None, :, None, :]]
        by_cell = by_cell.reshape(s.cells * t.cells, s.degree + 1, -1)
        cell = self._along[block.of_w, 0][0] * t.cells + self._along[block.of_w, 1][0]
        return by_cell.take(cell, axis=0)


def blocks_of(shell: SplinedShell) -> list[_Block]:
    """List the blocks of the coefficients E c, but for those around holes."""
    n, w = shell.membrane.count, shell.bending.count
    found = [_Block(0, False, 0), _Block(1, False, n), _Block(2, True, 2 * n)]
    if shell.stretch is not None:
        behind = shell.coefficients
        found += [_Block(0, True, behind), _Block(1, True, behind + w)]
    return found


def spread_out(shell: SplinedShell, columns: Array) -> Array:
    """Compute E of coefficients, (coefficient, any)."""
    if shell.stretch is None:
        return columns
    return np.concatenate(
        [columns, *(t @ columns[_splines_of_w(shell)] for t in shell.stretch.following)]
    )


def put_together(shell: SplinedShell, spread: Array) -> Array:
    """Compute E' of products with rows of E c, shape (coefficient, any)."""
    if shell.stretch is None:
        return spread
    found, w = spread[: shell.coefficients].copy(), shell.bending.count
    for t, begin in zip(shell.stretch.following, (0, w), strict=True):
        first = shell.coefficients + begin
        found[_splines_of_w(shell)] += t.T @ spread[first : first + w]
    return found


def _splines_of_w(shell: SplinedShell) -> slice:
    begin = 2 * shell.membrane.count
    return slice(begin, begin + shell.bending.count)


def spread_count(shell: SplinedShell) -> int:
    """Count the coefficients E c."""
    follow = 0 if shell.stretch is None else 2 * shell.bending.count
    return shell.coefficients + follow
