"""`check=truth`: a field against what truly happens in the virtual lab, component by component.

The field is compared where each column of nodes through the layers crosses the true surface,
linearly between the layers, as the element does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.config.registry import register
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, IndexArray


@register("check", "truth")
@dataclass
class Truth(Check):
    """How far the field is from the truth on the true surface, and how often its bounds hold.

    The field is taken where each column of nodes crosses the true surface, linearly between the
    layers, as the element does; so are the bounds of its real and imaginary part, which are then no
    smaller than the exact ones.

    Parameters
    ----------
    of : str
        Which field: ``field``, or the name of one in ``compare``.
    """

    of: str = "field"

    def examine(self, run: Examination) -> xr.Dataset:
        """Find errors and coverage of each component at each frequency, and in all of them."""
        tree = run.groups
        if "truth" not in tree:
            raise UserError(
                "check=truth needs a field and the virtual lab's truth: choose a volume, a "
                "reconstruction and scene=plate"
            )
        field = run.field_of(self.of)
        columns = Columns.from_volume(tree["volume"], tree["truth"]["height"].values)
        truth = columns.at_surface(tree["truth"]["velocity"].values)
        found = columns.at_surface(field["velocity"].values)
        if "n" in field["component"].values:
            truth = np.einsum("nca,naf->ncf", tree["volume"]["frame"].values[columns.inside], truth)
        of_parts = field["confidence_by_part"].transpose("part", *field["velocity"].dims).values
        bound = np.stack([columns.at_surface(part) for part in of_parts])
        coords = {"component": field["component"].values, "frequency": field["frequency"].values}
        group = dataset.group(
            "examined/truth",
            coords,
            **errors_and_coverage(found - truth, truth, bound),
        )
        group.attrs |= {"columns": len(columns.inside), "field": self.of}
        return group


def errors_and_coverage(
    error: NDArray[np.inexact], truth: NDArray[np.inexact], bound: Array
) -> dict[str, Array]:
    """Compare errors with the truth's size, and with their intervals.

    Parameters
    ----------
    error, truth : ndarray of complex, shape (place, component, frequency)
        NaN where nothing is known.
    bound : ndarray, shape (part, place, component, frequency)
        Half-widths of the intervals.

    Returns
    -------
    dict of str to ndarray, shape (component, frequency) or (component,)
    """
    parts = np.stack([error.real, error.imag])
    known = np.isfinite(parts) & np.isfinite(bound)
    with np.errstate(invalid="ignore"):
        covered = (np.abs(parts) <= bound) & known
    size = np.sqrt(np.nanmean(np.abs(truth) ** 2, axis=0))
    rms = np.sqrt(np.nanmean(np.abs(error) ** 2, axis=0))
    return {
        "relative_error": rms / size,
        "rms_error": rms,
        "rms_bound": np.sqrt(np.nanmean(bound**2, axis=(0, 1))),
        "covered": covered.sum(axis=(0, 1)) / known.sum(axis=(0, 1)),
        "relative_error_in_all": np.linalg.norm(rms, axis=1) / np.linalg.norm(size, axis=1),
        "covered_in_all": covered.sum(axis=(0, 1, 3)) / known.sum(axis=(0, 1, 3)),
    }


@dataclass(frozen=True, eq=False)
class Columns:
    """Where the columns of nodes cross a surface.

    Attributes
    ----------
    inside : ndarray of int, shape (column,)
        Surface nodes whose column crosses it.
    below : ndarray of int, shape (column,)
        Layer below the crossing.
    share : ndarray, shape (column,)
        Of the layer above it.
    """

    layers: int
    inside: IndexArray
    below: IndexArray
    share: Array

    @classmethod
    def from_volume(cls, volume: xr.Dataset, height: Array) -> Columns:
        """Find columns that cross height 0.

        Parameters
        ----------
        volume : xarray.Dataset
            The group ``volume``.
        height : ndarray, shape (node,), m
            Of every node above the surface; NaN where it has none below or above.

        Raises
        ------
        UserError
            If no column crosses it.
        """
        layers = volume.sizes["layer"]
        by_layer = height.reshape(layers, -1)
        crossing = (by_layer[:-1] <= 0) & (by_layer[1:] >= 0)
        inside = np.flatnonzero(crossing.any(axis=0))
        if not len(inside):
            raise UserError(
                f"the surface lies outside of the volume: its layers are {np.nanmin(height):.3g} "
                f"to {np.nanmax(height):.3g} m above it; move the volume with volume.offset"
            )
        below = crossing[:, inside].argmax(axis=0)
        low, high = by_layer[below, inside], by_layer[below + 1, inside]
        share = np.divide(-low, high - low, out=np.zeros(len(inside)), where=high > low)
        return cls(layers, inside, below, share)

    def at_surface(self, nodal: NDArray[np.inexact]) -> NDArray[np.inexact]:
        """Interpolate nodal values (node, ...) on the surface, shape (column, ...)."""
        by_layer = nodal.reshape(self.layers, -1, *nodal.shape[1:])
        share = self.share.reshape(-1, *[1] * (nodal.ndim - 1))
        low, high = by_layer[self.below, self.inside], by_layer[self.below + 1, self.inside]
        return np.asarray((1 - share) * low + share * high)
