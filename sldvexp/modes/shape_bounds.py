"""Bounds of mode shapes that hold the error of their poles too.

Fields of modal images know the noise of pixels, each by itself. An error d of the poles' logarithms
changes all pixels alike, a shape by shares of itself and of its neighbours,

    dv_a = sum_i S_ia v_b(i) d_i,

b(i) being the mode that unknown i belongs to: mostly a factor and a phase of the whole shape. With
the covariance of the poles these are variances of every place, which add up with the others.
Strains are velocities over ``i w``.
"""

from __future__ import annotations

import numpy as np

from sldvexp import dataset
from sldvexp.lazy import xarray as xr
from sldvexp.statistics import student_factor
from sldvexp.typing import Array, ComplexArray

#: Name of this source of errors in a field's budget, and how sentences call it.
SOURCE, CALLED = "poles", "frequencies and damping of the modes"


def with_pole_errors(found: xr.Dataset, modes: xr.Dataset) -> xr.Dataset:
    """Widen the bounds of a field or of strains of modes by what the poles' errors do to them.

    Parameters
    ----------
    found : xarray.Dataset
        Group ``field`` or ``strain`` of the modal images, with a mode in the place of each line.
    modes : xarray.Dataset
        The group ``modes``.

    Examples
    --------
    One mode whose whole shape may be 3 % too large, beside 4 % of noise, of one part:

    >>> import numpy as np
    >>> from sldvexp import dataset
    >>> modes = dataset.group(
    ...     "modes",
    ...     {"part": ["real", "imaginary"], "pole_parameter": ["f", "z"], "mode": [1]},
    ...     pole_covariance=np.diag([0.0, 1.0]),
    ...     shape_change=[[[0], [0.03]], [[0], [0]]],
    ...     mixing_std=[[[0.03]], [[0.0]]],
    ... )
    >>> coords = {"frequency": [100.0], "component": ["z"], "part": ["real", "imaginary"]}
    >>> noise = np.full((2, 1, 1, 1), 0.04)
    >>> field = dataset.group("field", coords, velocity=[[[1.0 + 0j]]], velocity_std=noise[0],
    ...                       confidence=2 * noise[0], velocity_std_by_part=noise,
    ...                       confidence_by_part=2 * noise)
    >>> with_pole_errors(field, modes)["velocity_std"].values.round(3).tolist()
    [[[0.05]]]
    """
    covariance = modes["pole_covariance"].values
    if not np.isfinite(covariance).all():
        untold = [t for t in (found.attrs.get("not_included", ""), CALLED) if t]
        return found.assign_attrs(not_included="; ".join(untold))
    parts = modes["shape_change"].transpose("part", "pole_parameter", "mode").values
    change, mixing = parts[0] + 1j * parts[1], modes["mixing_std"].values
    level = float(found.attrs.get("confidence_level", 0.95))
    factor, wider = float(student_factor(level, np.inf)), found.copy()
    for name in _bounded(found):
        value = found[name].transpose(..., "frequency")
        # A field's lines are its modes; strains are velocities over their own frequencies.
        over = 1.0 if name == "velocity" else found["frequency"].values
        if np.iscomplexobj(value.values):
            shape = np.asarray(value.values * over, complex)
            added = pole_variance(shape, change, covariance) / over**2
        else:
            added = _of_sizes(value.values * over, mixing)[None] / over**2
        by_part = xr.DataArray(added, dims=("part", *value.dims)[-added.ndim :])
        _widen(wider, name, by_part, factor)
        if name == "velocity":
            wider = _with_source(wider, by_part)
    return wider


def pole_variance(shape: ComplexArray, change: ComplexArray, covariance: Array) -> Array:
    """Compute what the poles' errors add to the variance of each part of shapes.

    Parameters
    ----------
    shape : ndarray of complex, shape (..., mode)
    change : ndarray of complex, shape (2 mode, mode)
        Share of an unknown's mode that its error brings into a mode's shape.
    covariance : ndarray, shape (2 mode, 2 mode)

    Returns
    -------
    ndarray, shape (part, ..., mode)

    Examples
    --------
    >>> pole_variance(np.array([2.0]), np.array([[0], [0.5j]]), np.eye(2)).tolist()
    [[0.0], [1.0]]
    """
    both = np.concatenate([shape, shape], axis=-1)
    added = np.empty((2, *shape.shape))
    for mode in range(shape.shape[-1]):
        moved = both * change[:, mode]
        for part, own in enumerate((moved.real, moved.imag)):
            added[part, ..., mode] = np.einsum("...i,ij,...j->...", own, covariance, own)
    return added


def _of_sizes(size: Array, mixing: Array) -> Array:
    """Bound the variance of what grows with shapes and knows no phase, as von Mises stresses."""
    share = (mixing**2).sum(axis=0)
    np.fill_diagonal(share, np.diag(mixing[0]) ** 2)
    return np.asarray(size**2 @ share.T)


def _bounded(found: xr.Dataset) -> list[str]:
    """List the variables of all modes that have a standard error and follow the shape."""
    named = [str(name).removesuffix("_std") for name in found if str(name).endswith("_std")]
    follows = [name for name in named if name in found and not name.endswith("direction")]
    return [n for n in follows if n != "intercept" and "frequency" in found[n].dims]


def _widen(wider: xr.Dataset, name: str, added: xr.DataArray, factor: float) -> None:
    """Add a variance to all bounds of a variable, of each part where they are known."""
    bound = "confidence" if name in ("velocity", "strain") else f"{name}_confidence"
    bound = bound.replace("_strain_", "_")
    for of, scale in ((f"{name}_std", 1.0), (bound, factor)):
        by_part = f"{of}_by_part"
        if by_part in wider:
            wider[by_part] = _grown(wider[by_part], added * scale**2)
            larger = wider[by_part].max("part").transpose(*wider[of].dims)
            wider[of] = larger.assign_attrs(wider[of].attrs)
        elif of in wider:
            wider[of] = _grown(wider[of], added.max("part") * scale**2)


def _grown(bound: xr.DataArray, variance: xr.DataArray) -> xr.DataArray:
    """Add a variance to the square of a bound."""
    return ((bound**2 + variance) ** 0.5).transpose(*bound.dims).assign_attrs(bound.attrs)


def _with_source(wider: xr.Dataset, added: xr.DataArray) -> xr.Dataset:
    """Tell the poles' part of a field's standard error, and add it to the budget."""
    dims, total = wider["velocity"].dims, wider["velocity_std"] ** 2
    larger = wider["velocity_std_by_part"].fillna(0.0).argmax("part")
    own = added.isel(part=larger).transpose(*dims)
    spec = dataset.VARIABLES["field"][f"velocity_std_{SOURCE}"]
    told = {"units": spec.units, "long_name": spec.long_name}
    wider[f"velocity_std_{SOURCE}"] = dims, np.sqrt(own.values), told
    if "variance" not in wider:
        return wider
    # Of the larger part; which one that is may have changed.
    before = wider["variance"]
    rest = before * ((total - own) / before.sum("source"))
    budget = xr.concat([rest, own.expand_dims(source=[SOURCE])], "source")
    names = [*before["source"].values, SOURCE]
    wider = wider.drop_dims("source").assign_coords(source=names)
    wider["variance"] = before.dims, budget.transpose(*before.dims).values, before.attrs
    return wider
