"""Headlines: the few numbers of a run that a comparison of runs looks at."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sldvexp.check.field_pattern import OUT_OF_PLANE
from sldvexp.lazy import xarray as xr

#: Variables of each group, and its attributes behind an @; dimensions such as view are kept.
HEADLINES: dict[str, tuple[str, ...]] = {
    "pose": ("s", "sse", "origin_std", "euler_std"),
    "point": ("velocity", "velocity_std", "sse", "s", "rcond", "efficiency"),
    "field": (
        *("@residual_std", "@sse", "@cond", "@rcond", "@dof", "@samples"),
        "residual_std_by_view",
    ),
    "check": ("@passed", "@quantities"),
}

#: Groups that headlines are in, or in groups below them.
PARENTS = (*HEADLINES, "examined", "compare")

#: A headline has at most so many numbers: points or frequencies by the thousand are no headline.
MOST_NUMBERS = 100


def headlines(tree: xr.DataTree) -> dict[str, xr.DataArray]:
    """Pick the headlines of one run.

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
    if "field" in tree.children:
        yield from _of_field(tree["field"].to_dataset(), "field")
    for parent, like in (("examined", None), ("compare", "point")):
        if parent not in tree.children:
            continue
        for name, child in tree[parent].children.items():
            dataset, prefix = child.to_dataset(), f"{parent}.{name}"
            if like and "element" in dataset.coords:
                yield from _of_group(dataset, prefix, HEADLINES["field"])
                yield from _of_field(dataset, prefix)
                continue
            wanted = HEADLINES[like] if like else tuple(map(str, dataset.data_vars))
            yield from _of_group(dataset, prefix, wanted)


def _of_group(
    group: xr.Dataset, prefix: str, names: tuple[str, ...]
) -> Iterator[tuple[str, xr.DataArray]]:
    for name in names:
        key = name.removeprefix("@")
        if name.startswith("@") and key in group.attrs:
            # pooled from the variable of its name, if there is one, and in its units
            about = group[key].attrs if key in group.data_vars else {"units": "1"}
            yield f"{prefix}.{key}", xr.DataArray(float(group.attrs[key]), attrs=about)
        elif name in group.data_vars and group[name].dtype.kind in "iufcb":
            array = group[name].load()
            kept = [c for c in array.coords if c in array.dims]
            yield f"{prefix}.{name}", array.drop_vars([c for c in array.coords if c not in kept])


def _of_field(field: xr.Dataset, prefix: str) -> Iterator[tuple[str, xr.DataArray]]:
    """Yield what Table 5.7 says by equation, and the standard errors in the surface and out of it.

    Root mean squares over frequencies, and standard errors over nodes too.
    """
    for name, combine in (("residual_std", _root_mean_square), ("sse", np.sum)):
        if name in field:
            array = field[name].load()
            others = [d for d in array.dims if d != "equation"]
            found = array.reduce(combine, others, keep_attrs=True)
            yield f"{prefix}.{name}_by_equation", found
    if "velocity_std" in field:
        std = field["velocity_std"].load()
        out = field["component"].isin(OUT_OF_PLANE)
        for name, which in (("std_in_plane", ~out), ("std_out_of_plane", out)):
            found = std.sel(component=which).reduce(_root_mean_square, keep_attrs=True)
            yield f"{prefix}.{name}", found


def _root_mean_square(values: np.ndarray, axis: int | tuple[int, ...] | None = None) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return np.sqrt(np.nanmean(np.square(values), axis=axis))


def number(array: xr.DataArray) -> float:
    """Reduce a headline to one number: the root mean square of its entries."""
    values = np.abs(np.asarray(array, complex)).ravel()
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")
