"""Velocity images as text: one paragraph for all views."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import xarray as xr


def image_text(tree: Mapping[str, xr.Dataset]) -> str:
    """What the images of a run hold, a line for each view; empty if there are none.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        Groups ``image/<view>``.

    Returns
    -------
    str
        Pixels, flagged ones by kind, and for each frequency the largest amplitude and the median
        standard error of the others.
    """
    images = {k.removeprefix("image/"): g for k, g in tree.items() if k.startswith("image/")}
    return "\n".join(_view_text(view, image) for view, image in images.items())


def _view_text(view: str, image: xr.Dataset) -> str:
    """One view's line."""
    grid = " x ".join(map(str, np.atleast_1d(image.attrs.get("shape", []))))
    name = f"Image of the view {view}" + (f" ({grid})" if grid else "")
    good = image.isel(pixel=image["flags"].values == 0)
    largest = np.abs(good["velocity"].values).max(axis=0)
    std = np.median(good["velocity_std"].values, axis=0)
    found = "; ".join(
        f"{hertz:g} Hz: at most {1000 * amplitude:.4g} mm/s, median std {1000 * error:.2g} mm/s"
        for hertz, amplitude, error in zip(image["frequency"].values, largest, std, strict=True)
    )
    return f"{name}: {image.attrs['summary']}; {found}"
