"""Strains of a run, and the places where they are largest, for figures and tables alike."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from sldvexp.dataset import COMPARED_STRAIN, RunData
from sldvexp.geometry import peaks
from sldvexp.lazy import xarray as xr

#: Hot spots of one frequency at most.
MOST_SPOTS = 5


def hottest_places(strain: xr.Dataset) -> list[int]:
    """Find the largest local maxima of the stress, or else of the extension, the highest first.

    Parameters
    ----------
    strain : Dataset
        The group ``strain`` at one frequency.

    Returns
    -------
    list of int
        Places, of maxima that are above their bounds and stand out by them.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> strain = group("strain", {}, von_mises=[0.0, 3e5, 1e5, 2e5],
    ...                von_mises_confidence=[1e4] * 4, triangle=[[0, 1, 2], [1, 2, 2], [2, 3, 3]])
    >>> hottest_places(strain)
    [1, 3]
    """
    if "von_mises" in strain:
        values, bound = (strain[n].values for n in ("von_mises", "von_mises_confidence"))
    else:
        values, bound = (
            strain[n].values[:, 0] for n in ("principal_strain", "principal_confidence")
        )
    triangles = strain["triangle"].values
    every = (np.ascontiguousarray(of, kind) for of, kind in ((values, float), (bound, float)))
    return list(_peaks(*(of.tobytes() for of in every), np.int64(triangles).tobytes()))


@lru_cache(maxsize=4)
def _peaks(values: bytes, bound: bytes, triangles: bytes) -> tuple[int, ...]:
    """Find peaks once for the figures and tables of a page."""
    own, width = (np.frombuffer(of, float) for of in (values, bound))
    corners = np.frombuffer(triangles, np.int64).reshape(-1, 3)
    return tuple(peaks(own, corners, width, MOST_SPOTS))


def strains_of(run: RunData) -> dict[str, xr.Dataset]:
    """Find the strains of a run by the names of their fields, first that of the field itself.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> found = group("strain", {}, frame=[np.eye(3)])
    >>> list(strains_of(RunData({"compare_strain/spline": found, "strain": found})))
    ['field', 'spline']
    """
    own = {"field": run.groups["strain"]} if run.has("strain", "frame") else {}
    return own | run.below(COMPARED_STRAIN, "frame")
