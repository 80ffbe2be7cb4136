"""Linear forms in u0, v0, w and their derivatives, with coefficients of their own at every place.

Motion and strain of a shell are such forms, ``sum c(p) d^(i+j) f / ds^i dt^j`` over fields f. They
are added and multiplied while they are a few numbers a place, and turned into rows of the splines'
coefficients, or values, only at the end.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from sldvexp.typing import Array

#: A field, 0 for u0, 1 for v0 and 2 for w, and how often it is differentiated by s and t.
Term = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class LinearForm:
    """A linear form at several places.

    Attributes
    ----------
    terms : mapping of (field, i, j) to ndarray, shape (place,)
    """

    terms: Mapping[Term, Array]

    @classmethod
    def of(cls, field: int, places: int, i: int = 0, j: int = 0) -> LinearForm:
        """Take a derivative of one field itself."""
        return cls({(field, i, j): np.ones(places)})

    def __add__(self, other: LinearForm) -> LinearForm:
        found = dict(self.terms)
        for term, factor in other.terms.items():
            found[term] = found[term] + factor if term in found else factor
        return LinearForm(found)

    def __mul__(self, factor: Array | float) -> LinearForm:
        """Multiply it at every place, without terms that are zero everywhere."""
        scaled = {term: factor * own for term, own in self.terms.items()}
        return LinearForm({term: own for term, own in scaled.items() if np.any(own)})

    def shifted(self, axis: int) -> LinearForm:
        """Differentiate the fields, but not the coefficients, by s (0) or t (1)."""
        return LinearForm(
            {(f, i + (axis == 0), j + (axis == 1)): own for (f, i, j), own in self.terms.items()}
        )


def summed(forms: list[LinearForm]) -> LinearForm:
    """Add forms up."""
    total = LinearForm({})
    for form in forms:
        total = total + form
    return total


def differentiated(
    make: Callable[[Array], list[LinearForm]], coordinates: Array, axis: int, step: float
) -> list[LinearForm]:
    """Differentiate forms by s (0) or t (1): their fields exactly, coefficients by differences.

    Parameters
    ----------
    make : callable
        From coordinates, (place, 2), m, to forms there.
    step : float, m
        Of the differences; coefficients vary as slowly as the surface bends.
    """
    by = step * np.eye(2)[axis]
    here, ahead, behind = make(coordinates), make(coordinates + by), make(coordinates - by)
    return [
        own.shifted(axis) + (up + down * -1.0) * (1 / (2 * step))
        for own, up, down in zip(here, ahead, behind, strict=True)
    ]
