"""Second way through the samples, with the solution: residuals and bounds.

What the field leaves of the measured velocities.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.field.bounds.inverse import NearInverse, NearRows, WholeInverse
from sldvexp.field.bounds.node_variance import Bounds, Verification
from sldvexp.field.bounds.pose_uncertainty import PoseEffect, kept_columns
from sldvexp.field.bounds.sparse_inverse_rows import rings_of
from sldvexp.field.equations.regions import RegionIterator, RegionSamples
from sldvexp.field.equations.sample_model import FieldModel
from sldvexp.field.equations.system import NormalEquations, Solve
from sldvexp.field.streaming.compression import FrequencyModes
from sldvexp.field.visibility.view import View
from sldvexp.typing import Array, BoolArray

#: Columns that are worked on together.
COLUMNS_AT_ONCE = 16


@dataclass(eq=False)
class Residuals:
    """Sums of squares of the residuals; real and imaginary parts are columns.

    Attributes
    ----------
    squares : ndarray, shape (equation, column), m2/s2
        What the method minimises: of all rows, weighted as they are, or of each component for the
        contravariant method.
    by_view : ndarray, shape (view, column), m2/s2
        Of ``v_k - X_k theta``, all weighted alike.
    by_row : ndarray, shape (row, column), m2/s2
        Of the method's rows.
    view_count, row_count : ndarray of int
        How many samples are behind them.
    """

    squares: Array
    by_view: Array
    by_row: Array
    view_count: NDArray[np.int_]
    row_count: NDArray[np.int_]

    @classmethod
    def empty(cls, model: FieldModel, views: int, columns: int) -> Residuals:
        """Zeros."""
        rows, equations = len(model.rows), model.parameters if model.contravariant else 1
        return cls(
            np.zeros((equations, columns)),
            np.zeros((views, columns)),
            np.zeros((rows, columns)),
            np.zeros(views, int),
            np.zeros(rows, int),
        )

    def add(self, part: RegionSamples, theta: Array, data: list[Array]) -> None:
        """Add the samples that a part owns.

        Parameters
        ----------
        part : RegionSamples
        theta : ndarray, shape (layer, surface_node, parameter, column)
        data : list of ndarray, shape (pixel, column)
        """
        used = part.look.valid & (part.at.pointwise.kept & part.owned)[:, None]
        has_row = ~np.any((part.model.rows.matrix != 0)[None] & ~used[:, None], axis=2)
        self.view_count += used.sum(axis=0)
        self.row_count += has_row.sum(axis=0)
        samples = len(used) // part.patch.sample_shape[0]
        for gap in range(part.patch.sample_shape[0]):
            here = slice(gap * samples, (gap + 1) * samples)
            weights = [seen.weights[here] for seen in part.look.seen]
            for first in range(0, theta.shape[-1], COLUMNS_AT_ONCE):
                some = slice(first, first + COLUMNS_AT_ONCE)
                v = np.stack([w @ d[:, some] for w, d in zip(weights, data, strict=True)], axis=1)
                u = part.field(theta[..., some], gap)
                left = (v - part.at.pointwise.design[here] @ u) * used[here, :, None]
                self._add(part, here, some, has_row[here], v, u, left)

    def _add(
        self,
        part: RegionSamples,
        here: slice,
        some: slice,
        has_row: BoolArray,
        v: Array,
        u: Array,
        left: Array,
    ) -> None:
        """Add some samples and columns: velocities, the field there, and what it leaves of them."""
        self.by_view[:, some] += np.einsum("skc,skc->kc", left, left)
        of_rows = (part.model.rows.matrix @ left) * has_row[..., None]
        self.by_row[:, some] += np.einsum("src,src->rc", of_rows, of_rows)
        if part.model.contravariant:
            own = part.at.information[here, :, 0] * part.owned[here, None]
            off = (part.at.estimator[here] @ v - u) * own[..., None]
            self.squares[:, some] += np.einsum("spc,spc->pc", off, off)
        else:
            weighted = part.at.pointwise.weight[here] @ left
            self.squares[0, some] += np.einsum("skc,skc->c", left, weighted)


#: Parts in which bounds of some nodes are verified.
VERIFIED_PARTS = 2


@dataclass(frozen=True, eq=False)
class FieldBounds:
    """What the second way finds.

    Attributes
    ----------
    residuals : Residuals
    noise : ndarray, shape (layer, surface_node, parameter, frequency), optional
        Variance from the pixels' noise, of a real part.
    pose : ndarray, shape (layer, surface_node, parameter, column), optional
        Variance from the poses.
    expected : ndarray, shape (equation, frequency), optional
        Sum of squares that the noise lets expect.
    error : float
        Largest relative error of a standard error found where it was computed exactly.
    efficiency : ndarray, shape (layer, surface_node, component), optional
        Gauss-Markov bound over variance.
    """

    residuals: Residuals
    noise: Array | None
    pose: Array | None
    expected: Array | None
    error: float
    efficiency: Array | None


def residuals_only(parts: RegionIterator, theta: Array, data: list[Array]) -> FieldBounds:
    """Go through the samples without computing bounds."""
    left = Residuals.empty(parts.model, len(data), theta.shape[-1])
    for part in parts.disjoint():
        left.add(part, theta, data)
    return FieldBounds(left, None, None, None, np.nan, None)


def with_bounds(
    parts: RegionIterator,
    system: NormalEquations,
    solve: Solve,
    theta: Array,
    data: list[Array],
    determined: BoolArray,
    factor: Array,
    pose: PoseEffect | None,
) -> FieldBounds:
    """Go through the samples and compute bounds as well.

    Parameters
    ----------
    parts : RegionIterator
    system : NormalEquations
    solve : Solve
    theta : ndarray, shape (layer, surface_node, parameter, column)
    data : list of ndarray, shape (pixel, column)
    determined : ndarray of bool, shape (layer, surface_node, parameter)
    factor : ndarray, shape (view, frequency)
        Each frequency's variance over the mean of all.
    pose : PoseEffect, optional
        None if the poses have no covariance.
    """
    looks, model = parts.looks, parts.model
    left = Residuals.empty(model, len(data), theta.shape[-1])
    factors, group = np.unique(factor, axis=0, return_inverse=True)
    found = Bounds.empty(looks, model, group.ravel(), kept_columns(pose))
    small = system.is_small
    rings = rings_of(looks.rule)
    whole = (
        WholeInverse.from_system(system, model.parameters)
        if small
        else NearInverse.from_system(system, rings)
    )
    errors: list[float] = [0.0] if small else []
    for part in parts.overlapping(rings, whole=small):
        left.add(part, theta, data)
        rows = whole.of_part(part)
        found.add_noise(part, rows)
        found.add_efficiency(part)
        right = None if pose is None else pose.right_sides(part)
        if pose is not None and right is not None:
            found.pose[:, part.region.own] = pose.variance(rows.times(right))
        if isinstance(rows, NearRows) and len(errors) < VERIFIED_PARTS:
            noise = found.noise.sum(axis=3)
            check = Verification(part, pose, right, noise, found.pose, determined)
            errors.append(check.largest_error(rows, system, solve))
    variance = None if pose is None else found.pose
    expected = 2 * found.expected @ factors
    return FieldBounds(
        left, found.noise @ factors, variance, expected, max(errors), found.efficiency
    )


def variance_factors(views: Sequence[View], pixel_std: tuple[Array, ...]) -> Array:
    """Each frequency's variance over the mean of all, shape (view, frequency).

    White noise has the same variance at all frequencies, or differs by a factor that all pixels of
    a view have in common; this factor is taken from the pixels' mean.
    """
    factors = []
    for view, std in zip(views, pixel_std, strict=True):
        frequencies = view.velocity.shape[1]
        if view.std.ndim == 1 or frequencies == 1:
            factors.append(np.ones(frequencies))
            continue
        mean = np.mean(view.std[view.usable] ** 2, axis=0)
        total = np.mean(std[view.usable] ** 2)
        factors.append(mean / total if total > 0 else np.ones(frequencies))
    return np.array(factors)


def pose_effect(
    model: FieldModel,
    theta: Array,
    data: list[Array],
    factor: Array,
    covariance: Array | None,
) -> PoseEffect | None:
    """What the poses' covariance does to the velocities; None if it is not known."""
    if covariance is None:
        return None
    total = np.array([np.sum(std**2) for std in model.pixel_std])
    modes = FrequencyModes.from_data(data, np.repeat(total @ factor, 2))
    return PoseEffect.from_modes(covariance, modes, theta, data)
