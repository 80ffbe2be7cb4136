"""Views of points: direction cosines and line-of-sight velocities, checked and in one layout."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp.errors import UserError
from sldvexp.typing import Array

#: Some points of a data set.
Points = slice | NDArray[np.int_]

#: Printed cosines carry four digits or fewer; a vector further from unit length is something else.
UNIT_TOLERANCE = 0.01


@dataclass(frozen=True)
class Views:
    """Line-of-sight velocities with their direction cosines, in the layout of the data set.

    Attributes
    ----------
    directions : ndarray, shape (view, point, axis)
    velocity : ndarray, shape (view, point, frequency), m/s
        Real or complex, single or double precision.
    std : ndarray, shape (view, 1 or point, 1 or frequency), optional, m/s
    """

    directions: Array
    velocity: NDArray[np.inexact]
    std: Array | None
    names: tuple[str, ...]

    @classmethod
    def checked(
        cls,
        directions: ArrayLike,
        velocity: ArrayLike,
        std: ArrayLike | None = None,
        names: Sequence[str] | None = None,
    ) -> Views:
        """Bring arrays into this layout; see `Reconstruction.reconstruct` for their shapes."""
        cosines = np.asarray(directions, float)
        data = _inexact(velocity)
        if cosines.ndim not in (2, 3) or cosines.shape[-1] != 3 or not cosines.size:
            raise UserError(
                f"direction cosines have shape {cosines.shape}; it must be (view, point, 3), or "
                "(view, 3) for one point"
            )
        one_point = cosines.ndim == 2
        if one_point:
            cosines, data = cosines[:, None], data[:, None] if data.ndim else data
        if data.ndim not in (2, 3) or data.shape[:2] != cosines.shape[:2] or not data.size:
            raise UserError(
                f"velocities of shape {np.shape(velocity)} do not fit direction cosines of shape "
                f"{np.shape(directions)}: both start with (view, point), or (view,) for one point"
            )
        data = data.reshape(*data.shape[:2], -1)
        labels = _names(names, len(data))
        _check_unit(cosines, labels)
        return cls(cosines, data, _std(std, data.shape, one_point, labels), labels)

    @property
    def std_by_frequency(self) -> bool:
        """Whether the weights change with frequency, and with them the matrices."""
        return self.std is not None and self.std.shape[2] > 1

    @property
    def real_components(self) -> int:
        """Real numbers in a sample: 2 for complex data, 1 for real."""
        return 2 if np.iscomplexobj(self.velocity) else 1

    def geometry(self, points: Points) -> tuple[Array, Array | None]:
        """Collect cosines and std of some points, as many as there are different matrices.

        Returns
        -------
        directions : ndarray, shape (view, system, axis)
            A system is a point or, if the std change with frequency, a point at a frequency.
        std : ndarray, shape (1 or system, view), optional
        """
        directions = self.directions[:, points]
        if self.std is None:
            return directions, None
        if self.std.shape[1:] == (1, 1):
            return directions, self.std[:, 0].T
        count, frequencies = directions.shape[1], self.std.shape[2]
        std = np.broadcast_to(self.std, (len(self.std), self.velocity.shape[1], frequencies))
        std = std[:, points].reshape(len(std), count * frequencies).T
        return np.repeat(directions, frequencies, axis=1), std

    def samples(self, points: Points) -> NDArray[np.inexact]:
        """Collect velocities for `geometry`, (view, system, frequency), the last contiguous."""
        data = self.velocity[:, points]
        if self.std_by_frequency:
            data = data.reshape(len(data), -1, 1)
        return data if data.strides[-1] == data.itemsize else np.ascontiguousarray(data)

    def fold(self, array: NDArray[Any]) -> NDArray[Any]:
        """Fold (system, ..., frequency or 1) to (point, ..., frequency or 1)."""
        if not self.std_by_frequency:
            return array
        by_point = array.reshape(-1, self.velocity.shape[2], *array.shape[1:-1])
        return np.moveaxis(by_point, 1, -1)

    def require_finite(self, points: slice) -> None:
        """Raise a `UserError` that names the first sample of these points that is not finite."""
        bad = np.argwhere(~np.isfinite(self.velocity[:, points]))
        if len(bad):
            view, point, frequency = bad[0]
            raise UserError(
                f"the velocity of view {self.names[view]} at point {point + points.start}, "
                f"frequency {frequency} (both counted from 0) is not a finite number; leave the "
                "point or the view out"
            )


def _inexact(velocity: ArrayLike) -> NDArray[np.inexact]:
    """Turn velocities into float32, float64 or their complex kin, whichever they are nearest to."""
    data = np.asarray(velocity)
    if data.dtype.char in "fdFD":
        return data
    try:
        return data.astype(complex if np.iscomplexobj(data) else float)
    except (TypeError, ValueError):
        raise UserError(f"velocities must be numbers, not {data.dtype}") from None


def _names(names: Sequence[str] | None, count: int) -> tuple[str, ...]:
    labels = tuple(str(k + 1) for k in range(count)) if names is None else tuple(map(str, names))
    if len(labels) != count:
        raise UserError(f"there are {count} views but {len(labels)} names: {', '.join(labels)}")
    twice = [name for name in labels if labels.count(name) > 1]
    if twice:
        raise UserError(f"two views are called {twice[0]}; every view needs a name of its own")
    return labels


def _check_unit(cosines: Array, names: tuple[str, ...]) -> None:
    length = np.sqrt(np.einsum("vpi,vpi->vp", cosines, cosines))
    bad = np.argwhere(~(np.abs(length - 1) <= UNIT_TOLERANCE))
    if len(bad):
        view, point = bad[0]
        raise UserError(
            f"the direction cosines of view {names[view]} at point {point} (counted from 0) have "
            f"length {length[view, point]:.4g}; they must be a unit vector towards the instrument"
        )


def _std(
    std: ArrayLike | None, shape: tuple[int, ...], one_point: bool, names: tuple[str, ...]
) -> Array | None:
    """Bring std into the shape (view, 1 or point, 1 or frequency)."""
    if std is None:
        return None
    noise = np.asarray(std, float)
    if one_point and noise.ndim == 2:
        noise = noise[:, None]
    noise = noise.reshape(*noise.shape, *[1] * (3 - noise.ndim))
    if noise.ndim != 3 or any(n not in (1, m) for n, m in zip(noise.shape, shape, strict=True)):
        raise UserError(
            f"the std have shape {np.shape(std)}, which does not fit velocities of shape {shape} "
            "(view, point, frequency): give one a view, one a view and point, or all"
        )
    noise = np.broadcast_to(noise, (shape[0], *noise.shape[1:]))
    bad = np.argwhere(~(np.isfinite(noise) & (noise > 0)))
    if len(bad):
        view, point, frequency = bad[0]
        raise UserError(
            f"the std of view {names[view]} at point {point}, frequency {frequency} (both counted "
            f"from 0) is {noise[view, point, frequency]}; it must be a positive number"
        )
    return noise
