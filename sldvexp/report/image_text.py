"""Velocity images as text: one paragraph for all views."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sldvexp.lazy import xarray as xr

#: Frequencies that a line tells of, those of the largest amplitudes.
MOST_FREQUENCIES = 4


def image_text(tree: Mapping[str, xr.Dataset]) -> str:
    """What the images of a run hold, a line for each view; empty if there are none.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        Groups ``image/<view>``.

    Returns
    -------
    str
        Pixels, flagged ones by kind, and for the strongest frequencies the largest amplitude and
        the median standard error.
    """
    images = {k.removeprefix("image/"): g for k, g in tree.items() if k.startswith("image/")}
    return "\n".join(_view_text(view, image) for view, image in images.items())


def _view_text(view: str, image: xr.Dataset) -> str:
    """One view's line."""
    grid = " x ".join(map(str, np.atleast_1d(image.attrs.get("shape", []))))
    name = f"Image of the view {view}" + (f" ({grid})" if grid else "")
    good = image.isel(pixel=image["flags"].values == 0)
    largest = abs(good["velocity"]).max("pixel").values
    hertz = image["frequency"].values
    shown = np.sort(np.argsort(-largest, kind="stable")[:MOST_FREQUENCIES])
    found = "; ".join(
        f"{hertz[i]:g} Hz: at most {1000 * largest[i]:.4g} mm/s, "
        f"median std {1000 * _std(good, i):.2g} mm/s"
        for i in shown
    )
    rest = f"; {len(hertz) - len(shown)} more frequencies" if len(shown) < len(hertz) else ""
    return f"{name}: {image.attrs['summary']}; {found}{rest}"


def _std(image: xr.Dataset, frequency: int) -> float:
    """The median standard error at a frequency; pixels may have one for all."""
    at = image["velocity_std"].isel(frequency=frequency, missing_dims="ignore")
    return float(np.median(at.values))
