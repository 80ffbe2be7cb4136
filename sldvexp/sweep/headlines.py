"""The few numbers of a run that a comparison of runs looks at."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import xarray as xr

#: Variables of each group, and its attributes behind an @; dimensions such as view are kept.
HEADLINES: dict[str, tuple[str, ...]] = {
    "pose": ("s", "sse", "origin_std", "euler_std"),
    "point": ("velocity", "velocity_std", "sse", "s", "rcond"),
    "field": ("@residual_std", "@sse", "@cond", "@dof", "@samples", "residual_std_by_view"),
    "check": ("@passed", "@quantities"),
}

#: A headline has at most so many numbers: points or frequencies by the thousand are no headline.
MOST_NUMBERS = 100


def headlines(tree: xr.DataTree) -> dict[str, xr.DataArray]:
    """Headline results of one run.

    Parameters
    ----------
    tree : xarray.DataTree
        As `sldvexp.dataset.load` gives it.

    Returns
    -------
    dict of str to xarray.DataArray
        ``pose.s``, ``field.residual_std``, ``examined.truth.error`` and so on.
    """
    return {name: array for name, array in _all(tree) if array.size <= MOST_NUMBERS}


def _all(tree: xr.DataTree) -> Iterator[tuple[str, xr.DataArray]]:
    for group, names in HEADLINES.items():
        if group in tree.children:
            yield from _of_group(tree[group].to_dataset(), group, names)
    for parent, like in (("examined", None), ("compare", "point")):
        if parent not in tree.children:
            continue
        for name, child in tree[parent].children.items():
            dataset = child.to_dataset()
            wanted = HEADLINES[like] if like else tuple(map(str, dataset.data_vars))
            yield from _of_group(dataset, f"{parent}.{name}", wanted)


def _of_group(
    group: xr.Dataset, prefix: str, names: tuple[str, ...]
) -> Iterator[tuple[str, xr.DataArray]]:
    for name in names:
        key = name.removeprefix("@")
        if name.startswith("@") and key in group.attrs:
            yield f"{prefix}.{key}", xr.DataArray(float(group.attrs[key]))
        elif name in group.data_vars and group[name].dtype.kind in "iufcb":
            array = group[name].load()
            kept = [c for c in array.coords if c in array.dims]
            yield f"{prefix}.{name}", array.drop_vars([c for c in array.coords if c not in kept])


def number(array: xr.DataArray) -> float:
    """One number that stands for a headline: the root mean square of its entries."""
    values = np.abs(np.asarray(array, complex)).ravel()
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
