"""Which point and which frequency every sample of single points is, and how that is said."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, IndexArray


@dataclass(frozen=True, eq=False)
class SamplePlaces:
    """Labels of samples, each a point at a frequency, or one of both alone.

    Attributes
    ----------
    labels : dict of str to tuple of str
        By what they number, as ``point``: how each of them is said.
    number : dict of str to ndarray of int, shape (sample,)
        By the same: which of the labels a sample has.
    """

    labels: dict[str, tuple[str, ...]]
    number: dict[str, IndexArray]

    @classmethod
    def from_coordinates(cls, values: xr.DataArray, dims: Sequence[str]) -> SamplePlaces:
        """Label the entries of an array, the last of its dimensions running fastest."""
        labels = {
            str(d): tuple(_said(str(d), of) for of in values[d].values.tolist()) for d in dims
        }
        grid = np.meshgrid(*[np.arange(len(own)) for own in labels.values()], indexing="ij")
        return cls(labels, {d: g.ravel() for d, g in zip(labels, grid, strict=True)})

    def take(self, kept: slice | Array) -> SamplePlaces:
        """Keep some samples."""
        return SamplePlaces(self.labels, {d: of[kept] for d, of in self.number.items()})

    def groupings(self) -> Iterator[tuple[IndexArray, list[str]]]:
        """Group the samples by point, by frequency, and each by itself.

        Yields
        ------
        ndarray of int, shape (sample,)
            The group of every sample.
        list of str
            How each group is said.
        """
        for count in range(1, len(self.labels) + 1):
            for dims in combinations(self.labels, count):
                shape = [len(self.labels[d]) for d in dims]
                group = np.ravel_multi_index(tuple(self.number[d] for d in dims), shape)
                of = np.unravel_index(np.arange(np.prod(shape)), shape)
                said = [
                    " at ".join(self.labels[d][i] for d, i in zip(dims, own, strict=True))
                    for own in zip(*of, strict=True)
                ]
                yield group, said


def _said(dim: str, label: object) -> str:
    """Say one label with what it numbers."""
    return f"{label:g} Hz" if dim == "frequency" else f"{dim} {label}"
