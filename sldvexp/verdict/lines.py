"""Frequencies that views are compared at: the strongest few of many.

``E_f = sum (|v|^2 - 2 s^2)`` over the usable pixels of all views is the energy of a frequency
beyond what noise of the standard error s has. A wrong view or a bad pixel is so at all frequencies,
so that few strong ones tell it, and of images that do not fit into memory no more is read at once.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from sldvexp.dataset import views_without_pose
from sldvexp.field.visibility.view import require_same
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, IndexArray
from sldvexp.verdict.repairs import Repair

#: Frequencies that views are compared at; of more, the strongest.
MOST_LINES = 16


def at_few_lines(groups: Mapping[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    """Load the images of a run, of many frequencies the strongest ones only.

    Parameters
    ----------
    groups : mapping of str to xarray.Dataset
        With the groups ``pose`` and ``image/<view>``, which may be in files.

    Returns
    -------
    dict of str to xarray.Dataset
        Those groups; an image that is as it was is the same object.
    """
    kept = {k: g for k, g in groups.items() if k == "pose" or k.startswith("image/")}
    lost = [f"image/{name}" for name in views_without_pose(groups)]
    images = {
        k: g
        for k, g in kept.items()
        if k.startswith("image/") and k not in lost and not g.attrs.get("left_out")
    }
    if images:
        require_same({k.removeprefix("image/"): g for k, g in images.items()})
    lines = _strongest(list(images.values()))
    return kept | {
        k: _loaded(g if lines is None else g.isel(frequency=lines), g) for k, g in images.items()
    }


def carried_over(
    whole: Mapping[str, xr.Dataset],
    before: Mapping[str, xr.Dataset],
    after: Mapping[str, xr.Dataset],
    repairs: Sequence[Repair],
) -> dict[str, xr.Dataset]:
    """Change the groups of a run as those of few frequencies were changed.

    Velocities that are in files stay there: a repair of theirs is done when they are read.

    Parameters
    ----------
    whole : mapping of str to xarray.Dataset
        Of all frequencies.
    before, after : mapping of str to xarray.Dataset
        Of few, see `at_few_lines`.
    repairs : sequence of Repair
        Those done in between.

    Returns
    -------
    dict of str to xarray.Dataset
        The groups that changed.
    """
    changed = dict(whole)
    for repair in repairs:
        changed |= repair.apply(changed)
    for name, group in after.items():
        if group is before.get(name):
            continue
        if name == "pose":
            changed[name] = group
        else:
            flagged = changed[name].assign(flags=group["flags"].variable)
            changed[name] = flagged.assign_attrs(group.attrs)
    return {name: group for name, group in changed.items() if group is not whole.get(name)}


def _loaded(few: xr.Dataset, image: xr.Dataset) -> xr.Dataset:
    """Load some frequencies of an image; the image itself if it is there already."""
    return few if few is image and not few.chunks else few.compute()


def _strongest(images: Sequence[xr.Dataset]) -> IndexArray | None:
    """Choose the strongest frequencies of some images, in their order; None if all are taken."""
    if not images or images[0].sizes.get("frequency", 0) <= MOST_LINES:
        return None
    energy = np.sum([_energy(image) for image in images], axis=0)
    return np.sort(np.argsort(-energy, kind="stable")[:MOST_LINES])


def _energy(image: xr.Dataset) -> Array:
    """Sum up the squares of an image beyond those of the noise, shape (frequency,)."""
    velocity, noise = image["velocity"], image["velocity_std"]
    squares = velocity.real.astype(float) ** 2 + velocity.imag.astype(float) ** 2 - 2 * noise**2
    usable = image["flags"] == 0
    return np.asarray(squares.where(usable).sum("pixel").transpose("frequency").values, float)
