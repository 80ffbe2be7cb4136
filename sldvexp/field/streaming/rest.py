"""Pixels at rest beside a structure, told by all lines of images that do not fit into memory.

Before the lines are combined, as `sldvexp.field.visibility.background` does with images in memory.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.field.streaming.compression import pieces, slices, streamed_images
from sldvexp.field.streaming.dask import Work
from sldvexp.field.visibility.background import without_background
from sldvexp.field.visibility.rest import (
    BorderSums,
    border_sums,
    breaks_off,
    is_lattice,
    limit_of,
    sizes,
)
from sldvexp.field.visibility.view import RESTS, shape_of, views_of
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, BoolArray
from sldvexp.volume import Volume


def tell_rest(
    tree: Mapping[str, xr.Dataset], laser: TwoMirror, volume: Volume, work: Work
) -> dict[str, xr.Dataset]:
    """Flag pixels of a run's images that rest beside the structure, and say what told it.

    Goes through all images once, some pixels at a time, and once more, some frequencies at a time,
    through lattices with a pixel at rest at their border.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        With groups ``image/<view>`` whose velocities are Dask arrays, and ``pose``.
    """
    if volume.sight.background:
        return dict(tree)
    told = {name: _told(image, work) for name, image in streamed_images(tree).items()}
    found = dict(tree)
    for view in without_background(
        views_of({"pose": tree["pose"], **told}, laser), laser, volume.prisms()
    ):
        name = f"image/{view.name}"
        rests = np.asarray(view.flags) & ~told[name]["flags"].values
        flags = tree[name]["flags"]
        of_lines: dict[str, Any] = {n: told[name][n] for n in RESTS}
        of_lines["flags"] = flags.copy(data=flags.values | rests)
        found[name] = tree[name].assign(of_lines)
    return found


def _told(image: xr.Dataset, work: Work) -> xr.Dataset:
    """Sum up what all lines of an image tell, in the place of its velocities."""
    velocity, std = image["velocity"].data, image["velocity_std"].data
    usable = np.asarray(image["flags"].values == 0)
    each = [*work.map(_of_pixels, ((velocity[p], std[p], usable[p]) for p in pieces(image)))]
    size, known = (np.concatenate([of[i] for of in each]) for i in (0, 1))
    limit = limit_of(image.sizes["frequency"], any(imaginary for _, _, imaginary in each))
    off = _breaks_off(image, size, usable & known, limit, work)
    unknown = np.where(known, 0, 1).astype(np.uint8)  # which is complained about later
    small = image[["dac"]].drop_vars("frequency", errors="ignore")
    return small.assign(
        velocity=("pixel", np.zeros(len(size), complex), image["velocity"].attrs),
        velocity_std=("pixel", np.ones(len(size)), image["velocity_std"].attrs),
        flags=("pixel", image["flags"].values | unknown),
        rest_size=("pixel", size, {"limit": limit}),
        breaks_off=("pixel", off),
    )


def _of_pixels(
    velocity: NDArray[np.complexfloating], std: Array, usable: BoolArray
) -> tuple[Array, BoolArray, bool]:
    """Sum up some pixels: sizes, whether all is known, whether there are imaginary parts."""
    by_line = std.reshape(len(std), -1)
    known = np.isfinite(velocity).all(axis=1) & (np.isfinite(by_line) & (by_line >= 0)).all(axis=1)
    usable = usable & known
    return sizes(velocity, std, usable), known, bool(np.imag(velocity[usable]).any())


def _breaks_off(
    image: xr.Dataset, size: Array, usable: BoolArray, limit: float, work: Work
) -> BoolArray:
    """Find where an image breaks off at its border, see `RestSums`."""
    lattice, nothing = shape_of(image), np.zeros(len(usable), bool)
    if not is_lattice(lattice):
        return nothing
    rests = (~usable | (size < limit)).reshape(lattice)
    if not any(np.rot90(rests, turn)[0].any() for turn in range(4)):
        return nothing
    velocity, std = image["velocity"].data, image["velocity_std"].data
    shared = work.share(usable)
    tasks = (
        (velocity[:, f], std[:, f] if std.ndim > 1 else std, shared, lattice)
        for f in slices(image["velocity"], "frequency")
    )
    total: BorderSums | None = None
    for found in work.map(border_sums, tasks):
        total = found if total is None else [a + b for a, b in zip(total, found, strict=True)]
    return nothing if total is None else breaks_off(total, limit, usable, lattice)
