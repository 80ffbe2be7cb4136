"""Velocity images of many frequencies, reduced to few combinations of them.

What views see and what the noise and the poses do to a field depends on the frequencies only
through the modes that carry all of the data above the noise, and through the pixels' mean
variances: images of these stand for the whole, and fit into memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.dataset import views_without_pose
from sldvexp.errors import UserError
from sldvexp.field.equations.assembly import real_columns
from sldvexp.field.streaming.dask import Work
from sldvexp.field.visibility.view import RESTS, require_same
from sldvexp.lazy import scipy
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, BoolArray

#: Columns up to which each is its own combination.
FEW = 8
#: Columns beyond which few modes are looked for first, in so many steps over the columns.
MANY, MOST_LEADING = 512, 1 / 8
#: Steps between looks at what is found, and its largest residual over the largest eigenvalue.
STEPS, EXACT = 16, 1e-14
#: Part of a column's sum of squares that may be left out even if it is above the noise.
NEGLIGIBLE = 1e-6


@dataclass(frozen=True, eq=False)
class FrequencyModes:
    """Orthonormal combinations C of the data's columns, ``v = (v C^T) C`` but for noise.

    A pose that is known to a part of a pixel changes velocities by that part of their difference
    from pixel to pixel. Of the noise this does not show beside the noise itself.

    Attributes
    ----------
    combination : ndarray, shape (mode, column)
    """

    combination: Array

    @classmethod
    def from_data(cls, data: list[Array], noise: Array) -> FrequencyModes:
        """Find the modes of the pixels of all views.

        Parameters
        ----------
        data : list of ndarray, shape (pixel, column)
        noise : ndarray, shape (column,)
            Expected sum of squares of each column's noise.
        """
        if len(noise) > MANY:
            total = np.sum([np.einsum("pc,pc->c", d, d) for d in data], axis=0)
            leading = cls._leading(lambda x: np.sum([d.T @ (d @ x) for d in data], 0), total, noise)
            if leading is not None:
                return leading
        return cls.of_gram(np.sum([d.T @ d for d in data], axis=0), noise)

    @classmethod
    def of_gram(cls, gram: Array, noise: Array) -> FrequencyModes:
        """Find the modes of data with these products of columns, shape (column, column)."""
        columns, total = len(gram), np.diagonal(gram)
        if columns <= FEW:
            return cls(np.eye(columns))
        if columns > MANY:
            leading = cls._leading(lambda x: gram @ x, total, noise)
            if leading is not None:
                return leading
        powers, vectors = (part[..., ::-1] for part in np.linalg.eigh(gram))
        return cls(vectors[:, : _enough(powers, vectors, total, noise) or columns].T.copy())

    @classmethod
    def _leading(
        cls, times: Callable[[Array], Array], total: Array, noise: Array
    ) -> FrequencyModes | None:
        """Find few modes by Lanczos' method, as all of them take the cube of the columns.

        Parameters
        ----------
        times : callable
            Products with the Gram matrix.
        total : ndarray, shape (column,)
            Its diagonal.

        Returns
        -------
        FrequencyModes, optional
            None if few are not enough.
        """
        start = np.random.default_rng(len(total)).normal(size=len(total))
        for powers, vectors, residual in _lanczos(times, start, int(MOST_LEADING * len(total))):
            modes = _enough(powers, vectors, total, noise)
            if modes and residual[:modes].max() <= EXACT * powers[0]:
                return cls(vectors[:, :modes].T.copy())
        return None

    def of_part(self, columns: slice) -> FrequencyModes:
        """Keep the same modes of some columns only."""
        return FrequencyModes(self.combination[:, columns])

    def of_columns(self, values: Array) -> Array:
        """Compute the modes' values of (..., column)."""
        return values @ self.combination.T

    def to_columns(self, values: Array) -> Array:
        """Compute the columns' values of (..., mode)."""
        return values @ self.combination

    def quadratic(self, gram: Array) -> Array:
        """Compute ``c^T G c`` for every column c, from (..., mode, mode) to (..., column)."""
        squares = np.einsum("ic,jc->ijc", self.combination, self.combination)
        modes, columns = self.combination.shape
        return gram.reshape(*gram.shape[:-2], -1) @ squares.reshape(modes**2, columns)


def _enough(powers: Array, vectors: Array, total: Array, noise: Array) -> int:
    """Count the first modes that carry every column but for noise; 0 if all together do not."""
    carried = np.cumsum(powers * vectors**2, axis=1)
    accepted = np.maximum(2 * noise, NEGLIGIBLE * total)
    enough = np.all(total[:, None] - carried <= accepted[:, None], axis=0)
    return int(np.argmax(enough)) + 1 if enough.any() else 0


def _lanczos(
    times: Callable[[Array], Array], start: Array, most: int
) -> Iterator[tuple[Array, Array, Array]]:
    """Find the largest eigenvalues of a matrix G, with vectors and residuals, ever more exactly.

    ``G Q = Q T + b q e^T`` with orthonormal Q and a tridiagonal T, whose vectors s stand for the
    vectors ``Q s`` of G with the residuals ``b |s_last|``.
    """
    q, diagonal, beside = [start / np.linalg.norm(start)], [], []
    for step in range(1, most + 1):
        along = times(q[-1])
        diagonal.append(float(q[-1] @ along))
        basis = np.array(q)
        for _ in range(2):  # rounding errors of the first time are gone after the second
            along = along - (basis @ along) @ basis
        beside.append(float(np.linalg.norm(along)))
        exhausted = beside[-1] <= EXACT * max(diagonal)
        if step % STEPS == 0 or exhausted or step == most:
            value, s = scipy.linalg.eigh_tridiagonal(diagonal, beside[:-1])
            yield value[::-1], basis.T @ s[:, ::-1], beside[-1] * np.abs(s[-1, ::-1])
        if exhausted:
            return
        q.append(along / beside[-1])


@dataclass(frozen=True, eq=False)
class Compressed:
    """Images with their frequencies' modes in the place of the frequencies.

    Attributes
    ----------
    images : dict of str to xarray.Dataset
        Groups ``image/<view>``: the modes' velocities, and pixels' standard errors, root mean
        square over the frequencies.
    factor : ndarray, shape (view, frequency)
        Each frequency's variance over the mean of all.
    frequency : ndarray, shape (frequency,), Hz
    """

    images: dict[str, xr.Dataset]
    modes: FrequencyModes
    factor: Array
    frequency: Array


@dataclass(eq=False)
class _Sums:
    """Sums over a view's pixels of what all their frequencies have.

    Attributes
    ----------
    known : ndarray of bool, shape (pixel,)
        All velocities are finite and have a standard error.
    square : ndarray, shape (pixel,), m2/s2
        Mean square of the standard error over the frequencies.
    by_frequency : ndarray, shape (frequency,) or (1,)
        Sum of squares over the usable pixels.
    gram : ndarray, shape (column, column)
        Products of the velocities' columns.
    """

    known: BoolArray
    square: Array
    by_frequency: Array
    gram: Array


def compress(tree: Mapping[str, xr.Dataset], work: Work) -> Compressed:
    """Go through all images twice, some pixels at a time.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        With groups ``image/<view>`` whose velocities are Dask arrays, and ``pose``.

    Raises
    ------
    UserError
        If there are no images, they have no frequencies, or views differ in them.
    """
    images = streamed_images(tree)
    require_same({k.removeprefix("image/"): v for k, v in images.items()})
    if not images or any("frequency" not in v["velocity"].dims for v in images.values()):
        raise UserError("stream: there are no images with several frequencies; leave stream out")
    sums = {name: _sums(image, work) for name, image in images.items()}
    usable = {name: _usable(images[name]) & s.known for name, s in sums.items()}
    frequency = next(iter(images.values()))["frequency"].values
    factor, noise = [], np.zeros(2 * len(frequency))
    for name, s in sums.items():
        total = s.square[usable[name]].sum()
        factor.append(_factor(s, total, int(usable[name].sum()), len(frequency)))
        noise += np.repeat(total * factor[-1], 2)
    modes = FrequencyModes.of_gram(np.sum([s.gram for s in sums.values()], axis=0), noise)
    reduced = {name: _reduced(images[name], s, modes, work) for name, s in sums.items()}
    return Compressed(reduced, modes, np.array(factor), frequency)


def streamed_images(tree: Mapping[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    """Collect the images of the views that a field is made of, in the order of the poses."""
    lost = views_without_pose(tree)
    names = [str(v) for v in tree["pose"]["view"].values]
    images = {k: tree[k] for v in names if v not in lost and (k := f"image/{v}") in tree}
    return {k: image for k, image in images.items() if not image.attrs.get("left_out")}


def slices(array: xr.DataArray, dim: str) -> Iterator[slice]:
    """List the chunks of an array along a dimension."""
    start = 0
    for size in array.chunksizes[dim]:
        yield slice(start, start + size)
        start += size


def pieces(image: xr.Dataset) -> Iterator[slice]:
    """Go through pixels that are looked at together: a chunk."""
    return slices(image["velocity"], "pixel")


def _usable(image: xr.Dataset) -> BoolArray:
    return np.asarray(image["flags"].values == 0)


def _sums(image: xr.Dataset, work: Work) -> _Sums:
    """Add up an image's sums, chunk by chunk of its pixels."""
    velocity, std, usable = image["velocity"].data, image["velocity_std"].data, _usable(image)
    found: list[_Sums] = []
    for each in work.map(_sums_of, ((velocity[p], std[p], usable[p]) for p in pieces(image))):
        if found:  # of each chunk but the pixels' own only the sums are kept
            each.gram += found[-1].gram
            each.by_frequency = each.by_frequency + found[-1].by_frequency
            found[-1].gram = np.zeros(0)
        found.append(each)
    known, square = (np.concatenate([getattr(s, n) for s in found]) for n in ("known", "square"))
    return _Sums(known, square, found[-1].by_frequency, found[-1].gram)


def _sums_of(velocity: NDArray[np.complexfloating], std: Array, usable: BoolArray) -> _Sums:
    std = std.reshape(len(std), -1).astype(float)
    known = np.isfinite(velocity).all(axis=1) & (np.isfinite(std) & (std >= 0)).all(axis=1)
    columns, square = real_columns(velocity, usable & known), std**2
    of_usable = square[usable & known].sum(axis=0)
    return _Sums(known, square.mean(axis=1), of_usable, columns.T @ columns)


def _factor(sums: _Sums, total: float, pixels: int, frequencies: int) -> Array:
    """Compute what `sldvexp.field.bounds.residuals_and_bounds.variance_factors` does."""
    if len(sums.by_frequency) != frequencies or not total > 0:
        return np.ones(frequencies)
    return sums.by_frequency / total


def _reduced(image: xr.Dataset, sums: _Sums, modes: FrequencyModes, work: Work) -> xr.Dataset:
    """Reduce an image to the modes; NaN where a velocity is not known."""
    velocity, usable = image["velocity"].data, _usable(image) & sums.known
    shared = work.share(modes)
    tasks = ((shared, velocity[p], usable[p]) for p in pieces(image))
    values = np.concatenate(list(work.map(_of_modes, tasks)))
    values[~sums.known] = np.nan
    small: dict[str, Any] = {
        "velocity": (("pixel", "frequency"), values, image["velocity"].attrs),
        "velocity_std": ("pixel", np.sqrt(sums.square), image["velocity_std"].attrs),
    }
    told = [name for name in ("dac", "flags", *RESTS) if name in image]
    kept = image[told].drop_vars("frequency", errors="ignore")
    return kept.assign(small).assign_coords(frequency=np.arange(values.shape[1], dtype=float))


def _of_modes(
    modes: FrequencyModes, velocity: NDArray[np.complexfloating], usable: BoolArray
) -> Array:
    return modes.of_columns(real_columns(velocity, usable))
