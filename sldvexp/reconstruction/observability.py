"""Observability of a point: what its views do not determine, and what they still do.

Directions of velocity that change no row span the null space. A component is determined if the null
space does not lean towards it by more than `LEAN`; where some are not, the velocity along the
orthogonal directions is given instead.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.reconstruction.system import PointSystem
from sldvexp.typing import Array, BoolArray

#: A component counts as determined if the undetermined directions lean towards it by less (cosine).
LEAN = 1e-3
AXES = ("x", "y", "z")


def blank(values: NDArray[Any], where: BoolArray) -> None:
    """Make numbers NaN, of complex ones both parts: numpy's NaN alone has the imaginary part 0."""
    values[where] = complex(np.nan, np.nan) if np.iscomplexobj(values) else np.nan


@dataclass(frozen=True)
class ObservedSubspace:
    """Velocity along directions that are determined, at the points where not all components are.

    Attributes
    ----------
    point : ndarray of int, shape (deficient,)
        Indices of these points.
    rank : ndarray of int, shape (deficient,)
        How many directions are determined, 0 to 2.
    direction : ndarray, shape (deficient, 3, axis)
        Orthonormal; the first `rank` are determined, the others span what is not.
    velocity, std, confidence : ndarray, shape (deficient, 3, frequency), m/s
        Along these directions, bounds of real and imaginary part each; NaN beyond `rank`.
    """

    point: NDArray[np.int_]
    rank: NDArray[np.int_]
    direction: Array
    velocity: NDArray[np.inexact]
    std: Array
    confidence: Array


def undetermined(null: Array) -> Array:
    """Project onto the velocities that change no row, shape (point, axis, axis).

    Parameters
    ----------
    null : ndarray, shape (point, parameter, parameter)
        Rows that span the undetermined parameters, filled with zeros (`PointFit.null`). An
        intercept among them is left out: what remains of each row is a direction all the same.
    """
    _, size, direction = np.linalg.svd(null[..., :3], full_matrices=False)
    kept = direction * (size > LEAN)[..., None]
    return np.swapaxes(kept, -1, -2) @ kept


def determined_intercept(null: Array) -> BoolArray:
    """Test whether the full model's intercept is determined, shape (point,)."""
    return np.linalg.norm(null[..., 3], axis=-1) <= LEAN


def determined_components(null: Array) -> BoolArray:
    """Test which of x, y and z are determined, shape (point, component)."""
    return np.sqrt(np.diagonal(undetermined(null), axis1=-2, axis2=-1)) <= LEAN


def observed_subspace(
    system: PointSystem, points: NDArray[np.int_], noise: Array, factor: Array
) -> ObservedSubspace:
    """Compute velocities along the determined directions of some points.

    Parameters
    ----------
    points : ndarray of int, shape (deficient,)
    noise : ndarray, shape (deficient, frequency)
        Size of the noise that `PointFit.cofactor` is in units of.
    factor : ndarray, shape (deficient,)
        Half-width of the confidence interval over the standard error.
    """
    views = system.views
    fit = system.fit(points)
    assert fit.null is not None  # these points are deficient
    lost = undetermined(fit.null)
    rank = 3 - np.round(np.trace(lost, axis1=-2, axis2=-1)).astype(int)
    kept_first = _basis(np.eye(3) - lost) + _last(_basis(lost))
    beyond = np.arange(3) >= rank[:, None]
    solution = kept_first @ fit.solution[:, :3]
    velocity = np.einsum("pij,jpf->pif", solution, views.samples(points))
    covariance = kept_first @ fit.cofactor[:, :3, :3] @ np.swapaxes(kept_first, -1, -2)
    root = np.sqrt(np.maximum(np.diagonal(covariance, axis1=-2, axis2=-1), 0.0))
    root[beyond] = np.nan
    blank(velocity, beyond)
    std = views.fold(root[..., None]) * noise[:, None]
    each = slice(None, None, len(rank) // len(points))  # one of a point's frequencies
    return ObservedSubspace(
        point=points,
        rank=rank[each],
        direction=kept_first[each],
        velocity=views.fold(velocity),
        std=std,
        confidence=std * factor[:, None, None],
    )


def _basis(projector: Array) -> Array:
    """Find orthonormal rows that span a projector's range, filled with zeros; axes where they fit.

    Gram-Schmidt on its columns, the longest one left first.
    """
    rest = projector.copy()
    basis = np.zeros_like(rest)
    for k in range(3):
        length = np.linalg.norm(rest, axis=-2)
        # Rounding must not decide between columns of equal length.
        longest = np.argmax(np.round(length, 9), axis=-1)[:, None]
        size = np.take_along_axis(length, longest, axis=-1)
        column = np.take_along_axis(rest, longest[:, None], axis=-1)[..., 0]
        unit = np.where(size > 0.5, column / np.where(size > 0.5, size, 1.0), 0.0)
        basis[:, k] = unit
        rest = rest - unit[:, :, None] * (unit[:, None] @ rest)
    return basis


def _last(basis: Array) -> Array:
    """Order the rows so that those of zeros stand first."""
    order = np.argsort(np.any(basis != 0, axis=-1), axis=-1, kind="stable")
    return np.take_along_axis(basis, order[..., None], axis=-2)


def describe(subspace: ObservedSubspace, system: PointSystem) -> str:
    """Name the undetermined directions in one sentence, or those of the first such point."""
    rows = system.rows
    every_view = np.linalg.matrix_rank(rows.matrix) == len(system.views.names)
    subject = "the views" if every_view else f"the rows {rows}"
    verb = "do not determine" + (" beside an intercept" if system.intercept else "")
    total = system.views.directions.shape[1]
    same = np.ptp(np.abs(subspace.direction), axis=0).max() < 10 * LEAN
    directions = " and ".join(_named(d) for d in subspace.direction[0][subspace.rank[0] :])
    sentence = f"{subject} {verb} the velocity along {directions}"
    if len(subspace.point) < total or not same:
        sentence += f" at point {subspace.point[0]} (counted from 0)"
    if len(subspace.point) > 1 and (len(subspace.point) < total or not same):
        sentence += f"; at {len(subspace.point)} of {total} points something is not determined"
    return sentence


def _named(direction: Array) -> str:
    """Write a unit vector in numbers and, along an axis, with its name."""
    numbers = ", ".join(f"{x + 0.0:.2f}" for x in np.round(direction, 2))
    along = [name for name, x in zip(AXES, direction, strict=True) if abs(x) > 1 - LEAN]
    return f"({numbers})" + (f" ({along[0]})" if along else "")
