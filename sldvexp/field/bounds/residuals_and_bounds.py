"""Residuals and bounds: the second way through the samples, with the solution.

Samples' velocities are interpolated from the same pixels, so that their errors are correlated.
With ``b = sum_k R_k v_k`` the noise of the pixels, independent of one another, gives the nodal
covariance ``sum_k K_k S_k K_k^T``, ``K_k = M^-1 R_k`` and S_k the pixels' variances. To it comes
the effect of the poses, see `sldvexp.field.bounds.pose_uncertainty`. All of M^-1 is known of a
small field; of a large one its rows are cut off after a few rings of neighbours, and the bounds of
a few nodes are computed exactly as well, to know how far the others may be off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sldvexp.field.bounds.efficiency import LeastVariance, is_best
from sldvexp.field.bounds.inverse import (
    InverseRows,
    NearInverse,
    NearRows,
    ViewInfluence,
    WholeInverse,
    view_influences,
)
from sldvexp.field.bounds.pose_uncertainty import PoseEffect, column_variances, kept_columns
from sldvexp.field.bounds.sparse_inverse_rows import rings_of
from sldvexp.field.equations.regions import RegionIterator, RegionSamples
from sldvexp.field.equations.sample_model import SAMPLES_IN_CACHE, FieldModel
from sldvexp.field.equations.system import NormalEquations, Solve
from sldvexp.field.streaming.compression import FrequencyModes
from sldvexp.field.visibility.view import View
from sldvexp.field.visibility.visibility import VolumeVisibility
from sldvexp.typing import Array, BoolArray, IndexArray

#: Columns that are worked on together; more where samples are few, up to so many values a view.
COLUMNS_AT_ONCE, VALUES_AT_ONCE = 16, 2**17


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
        """Begin with zeros."""
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
        theta : ndarray, shape (layer, surface_node, parameter, column)
        data : list of ndarray, shape (pixel, column)
        """
        used = (part.samples.valid & (part.at.pointwise.kept & part.owned)[:, None]).T
        has_row = ~np.any((part.model.rows.matrix != 0)[..., None] & ~used, axis=1)
        self.view_count += used.sum(axis=1)
        self.row_count += has_row.sum(axis=1)
        gaps = part.patch.sample_shape[0]
        samples = used.shape[1] // gaps
        columns = max(COLUMNS_AT_ONCE, VALUES_AT_ONCE // samples)
        for gap in range(gaps):
            start = gap * samples
            mine = part.owned[start : start + samples].nonzero()[0]
            for first in range(0, theta.shape[-1] if len(mine) else 0, columns):
                some = slice(first, first + columns)
                v = part.velocities_last([d[:, some] for d in data], gap)
                u = part.field_last(theta[..., some], gap)
                for at in range(mine[0], mine[-1] + 1, SAMPLES_IN_CACHE):
                    here = slice(at, min(at + SAMPLES_IN_CACHE, samples))
                    these = slice(start + here.start, start + here.stop)
                    seen = used[:, these], has_row[:, these]
                    self._add(part, these, some, seen, v[..., here], u[..., here])

    def _add(
        self,
        part: RegionSamples,
        here: slice,
        some: slice,
        seen: tuple[BoolArray, BoolArray],
        v: Array,
        u: Array,
    ) -> None:
        """Add some samples and columns.

        Parameters
        ----------
        seen : tuple of ndarray of bool, shape (view, sample) and (row, sample)
            Where views count, and where rows do.
        v, u : ndarray, shape (view, column, sample) and (parameter, column, sample)
            Velocities, and the field there.
        """
        used, has_row = seen
        left = v - np.einsum("pks,pcs->kcs", part.at.pointwise.design[here].T, u)
        left *= used[:, None]
        self.by_view[:, some] += np.einsum("kcs,kcs->kc", left, left)
        of_rows = np.tensordot(part.model.rows.matrix, left, axes=1)
        of_rows *= has_row[:, None]
        self.by_row[:, some] += np.einsum("rcs,rcs->rc", of_rows, of_rows)
        if part.model.contravariant:
            own = part.at.information[here, 0, 0] * part.owned[here]
            off = np.einsum("kps,kcs->pcs", part.at.solution[here].T, v) - u
            self.squares[:, some] += np.einsum("s,pcs,pcs->pc", own, off, off)
        else:
            weighted = part.at.pointwise.weight[here].times_last(left)
            self.squares[0, some] += np.einsum("kcs,kcs->c", left, weighted)


#: Parts in which bounds of some nodes are verified.
VERIFIED_PARTS = 2


@dataclass(frozen=True, eq=False)
class FieldBounds:
    """Residuals and variances, as the second way through the samples finds them.

    Attributes
    ----------
    noise : ndarray, shape (layer, surface_node, parameter, frequency), optional
        Variance from the pixels' noise, of a real part.
    pose : ndarray, shape (layer, surface_node, parameter, column), optional
        Variance from the poses.
    expected : ndarray, shape (equation, frequency), optional
        Sum of squares that the noise lets expect.
    error : float
        Largest relative error of a standard error found where it was computed exactly.
    efficiency : ndarray, shape (layer, surface_node, component), optional
        Least possible variance over this one, of the noise; see `sldvexp.field.bounds.efficiency`.
    others : dict of str to ndarray, shape (layer, surface_node, parameter, column)
        Variances from other sources, by their names in the budget.
    interpolation : ndarray, shape (layer, surface_node, parameter, column), optional
        Estimated error of the interpolation between pixels.
    """

    residuals: Residuals
    noise: Array | None
    pose: Array | None
    expected: Array | None
    error: float
    efficiency: Array | None
    others: dict[str, Array] = field(default_factory=dict)
    interpolation: Array | None = None


def residuals_only(parts: RegionIterator, theta: Array, data: list[Array]) -> FieldBounds:
    """Go through the samples without computing bounds."""
    left = Residuals.empty(parts.model, len(data), theta.shape[-1])
    for part in parts.disjoint():
        left.add(part, theta, data)
    return FieldBounds(left, None, None, None, np.nan, None)


def noise_only(parts: RegionIterator, system: NormalEquations) -> Array:
    """Compute the variances from the pixels' noise alone, (layer, surface_node, parameter).

    They do not depend on any velocity: images may be empty.
    """
    model, rings = parts.model, rings_of(parts.visibility.rule)
    small = system.is_small
    whole = (
        WholeInverse.from_system(system, model.parameters)
        if small
        else NearInverse.from_system(system, parts)
    )
    found = Bounds.empty(parts.visibility, model, np.zeros(len(model.pixel_std), int), 0)
    for part in parts.overlapping(rings, whole=small):
        found.add_noise(part, whole.of_part(part))
    return found.noise[..., 0]


def with_bounds(
    parts: RegionIterator,
    system: NormalEquations,
    solve: Solve,
    theta: Array,
    data: list[Array],
    determined: BoolArray,
    factor: Array,
    pose: PoseEffect | None,
    best: LeastVariance | None,
) -> FieldBounds:
    """Go through the samples and compute bounds as well.

    Parameters
    ----------
    solve : callable
        For what is verified, which is told with two digits.
    theta : ndarray, shape (layer, surface_node, parameter, column)
    data : list of ndarray, shape (pixel, column)
    determined : ndarray of bool, shape (layer, surface_node, parameter)
    factor : ndarray, shape (view, frequency)
        Each frequency's variance over the mean of all.
    pose : PoseEffect, optional
        None if the poses have no covariance.
    best : LeastVariance, optional
        None if it is not known, or that of the method itself.
    """
    visibility, model = parts.visibility, parts.model
    left = Residuals.empty(model, len(data), theta.shape[-1])
    factors, group = np.unique(factor, axis=0, return_inverse=True)
    found = Bounds.empty(visibility, model, group.ravel(), kept_columns(pose))
    small = system.is_small
    rings = rings_of(visibility.rule)
    whole = (
        WholeInverse.from_system(system, model.parameters)
        if small
        else NearInverse.from_system(system, parts)
    )
    least = np.full((*found.noise.shape[:2], 3), np.nan)
    errors: list[float] = [0.0] if small else []
    for part in parts.overlapping(rings, whole=small):
        left.add(part, theta, data)
        rows = whole.of_part(part)
        check = None
        if isinstance(rows, NearRows) and len(errors) < VERIFIED_PARTS:
            check = Verification.prepare(part, rows, system, solve, determined)
        of_best = None if best is None else best.of_part(part)
        least_here = found.add_noise(part, rows, of_best, check)
        if least_here is not None:
            least[:, part.region.own] = least_here
        right = None if pose is None else pose.right_sides(part)
        if pose is not None and right is not None:
            found.pose[:, part.region.own] = pose.variance(rows.times(right))
        if check is not None:
            errors.append(check.largest_error(found.noise.sum(axis=3), found.pose, pose, right))
        del part, rows, check, of_best, right  # before the next samples are looked at
    variance = None if pose is None else found.pose
    expected = 2 * found.expected @ factors
    own = found.noise[:, :, :3].sum(axis=3)
    # Errors that samples share may make another method better by little: then that is the least.
    least = own if is_best(model) else np.minimum(least, own)
    efficiency = np.divide(least, own, out=np.full_like(own, np.nan), where=own > 0)
    return FieldBounds(left, found.noise @ factors, variance, expected, max(errors), efficiency)


def variance_factors(views: Sequence[View], pixel_std: tuple[Array, ...]) -> Array:
    """Divide each frequency's variance by the mean of all, shape (view, frequency).

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


def data_modes(model: FieldModel, data: list[Array], factor: Array) -> FrequencyModes:
    """Find the few modes of the data that what depends on the velocities is computed for."""
    total = np.array([np.sum(std**2) for std in model.pixel_std])
    return FrequencyModes.from_data(data, np.repeat(total @ factor, 2))


@dataclass(eq=False)
class Bounds:
    """Variances of nodal values, filled part by part.

    Attributes
    ----------
    group : ndarray of int, shape (view,)
        Views whose noise changes alike with the frequency.
    noise : ndarray, shape (layer, surface_node, parameter, group)
        From the noise of the pixels of each group of views.
    pose : ndarray, shape (layer, surface_node, parameter, column)
        From the poses.
    expected : ndarray, shape (equation, group)
        Sum of squared residuals of one real part that the noise lets expect.
    """

    group: IndexArray
    noise: Array
    pose: Array
    expected: Array

    @classmethod
    def empty(
        cls, visibility: VolumeVisibility, model: FieldModel, group: IndexArray, columns: int
    ) -> Bounds:
        """Begin with zeros."""
        shape = (visibility.prisms.layers, visibility.prisms.surface_nodes, model.parameters)
        equations = model.parameters if model.contravariant else 1
        return cls(
            group,
            np.zeros((*shape, group.max() + 1)),
            np.zeros((*shape, columns)),
            np.zeros((equations, group.max() + 1)),
        )

    def add_noise(
        self,
        part: RegionSamples,
        rows: InverseRows,
        best: tuple[RegionSamples, InverseRows] | None = None,
        check: Verification | None = None,
    ) -> Array | None:
        """Add the noise of the part's own nodes, and of the residuals of the samples it owns.

        Parameters
        ----------
        best : tuple of RegionSamples and InverseRows, optional
            The same part in the model of least variance.
        check : Verification, optional
            Of the part, which gets its exact variances.

        Returns
        -------
        ndarray, shape (layer, own, parameter), optional
            The least variance.
        """
        own = part.region.own
        variances = [std**2 for std in part.model.pixel_std]
        for k, group in enumerate(self.group):
            self.expected[:, group] += _of_samples(part, k, variances[k])
        each = [(part, rows)] if best is None else [(part, rows), best]
        near = [(p, r) for p, r in each if isinstance(r, NearRows)]

        def of_view(k: int) -> list[tuple[Array, Array]]:
            influences = view_influences([p for p, _ in near], k)
            if check is not None:
                check.add(influences[0], k)
            return [
                r.of_view(influence, variances[k], fitted=p is part)
                for (p, r), influence in zip(near, influences, strict=True)
            ]

        # One after the other: what is in between takes a third of all memory of a small field.
        by_view = [of_view(k) for k in range(len(variances))] if near else []
        if isinstance(rows, WholeInverse):
            for group in range(self.noise.shape[3]):
                views = np.flatnonzero(self.group == group)
                self._add_group(own, group, _whole(part, rows, views))
        else:
            for k, found in enumerate(by_view):
                self._add_group(own, self.group[k], found[0])
        if best is None:
            return None
        if isinstance(best[1], WholeInverse):
            return _whole(*best, np.arange(len(variances)))[0]
        return np.sum([found[-1][0] for found in by_view], axis=0)

    def _add_group(self, own: IndexArray, group: int, found: tuple[Array, Array]) -> None:
        """Add the variances of some views, and what they take from the residuals."""
        nodal, fitted = found
        self.noise[..., group][:, own] += nodal
        self.expected[:, group] -= fitted if len(self.expected) > 1 else fitted.sum()


def _whole(part: RegionSamples, rows: InverseRows, views: IndexArray) -> tuple[Array, Array]:
    """Compute variances of some views together, of a small system."""
    assert isinstance(rows, WholeInverse)
    std, key = part.model.pixel_std, tuple(map(int, views))
    if key not in rows.known:
        influences = [part.influences[k] for k in views]
        rows.known[key] = rows.variances(influences, [std[k] ** 2 for k in views])
    return rows.known[key]


def _of_samples(part: RegionSamples, k: int, variance: Array) -> Array:
    """Sum the variances of a view's samples that the part owns, in every equation."""
    of_samples = (part.samples.by_view[k].weights.power(2) @ variance) * part.owned
    if part.model.contravariant:
        found: Array = of_samples @ (part.at.estimator[:, :, k] * part.at.solution[:, :, k])
        return found
    return np.array([of_samples @ part.at.pointwise.weight.of_views(k, k)])


#: Surface nodes of a part that are verified, each in one layer.
NODES = 4


@dataclass(frozen=True, eq=False)
class Verification:
    """Part of a field whose bounds are computed exactly as well.

    Parameters
    ----------
    determined : ndarray of bool, shape (layer, surface_node, parameter)
    layer, node : ndarray of int
        The nodes that are verified.
    rows : ndarray, shape (node * parameter, patch node * parameter)
        Of the inverse matrix, theirs.
    noise : ndarray, shape (view, node * parameter)
        Exact variances from the noise, view by view.
    """

    part: RegionSamples
    determined: BoolArray
    layer: IndexArray
    node: IndexArray
    rows: Array
    noise: Array

    @classmethod
    def prepare(
        cls,
        part: RegionSamples,
        rows: NearRows,
        system: NormalEquations,
        solve: Solve,
        determined: BoolArray,
    ) -> Verification:
        """Choose some nodes and solve for their rows of the inverse matrix."""
        layer, own = _chosen(rows, determined[:, part.region.own])
        node, block, parameters = part.region.own[own], system.block, determined.shape[2]
        unit = np.zeros((system.layers, system.graph.nodes, block, len(node), block))
        for i, (x, n) in enumerate(zip(layer, node, strict=True)):
            unit[x, n, :, i] = np.eye(block)
        columns = solve(unit.reshape(*unit.shape[:3], -1)).reshape(unit.shape)
        inverse = columns[:, part.patch.nodes]
        if block == 1:
            inverse = inverse * np.eye(parameters)[:, None]
        inverse = np.moveaxis(inverse, 3, 0).reshape(len(node), -1, parameters)
        of_nodes = np.swapaxes(inverse, 1, 2).reshape(len(node) * parameters, -1)
        noise = np.zeros((len(part.model.pixel_std), len(of_nodes)))
        return cls(part, determined, layer, node, of_nodes, noise)

    def add(self, influence: ViewInfluence, k: int) -> None:
        """Compute the exact variances that a view's noise gives."""
        of_pixels = influence.transposed_times(self.rows)
        self.noise[k] = self.part.model.pixel_std[k] ** 2 @ of_pixels**2

    def largest_error(
        self, noise: Array, kept: Array, pose: PoseEffect | None, right: Array | None
    ) -> float:
        """Find the largest relative error of the standard errors of some of the part's nodes.

        Parameters
        ----------
        noise : ndarray, shape (layer, surface_node, parameter)
            Variances from the noise.
        kept : ndarray, shape (layer, surface_node, parameter, ...)
            Those from the poses, as `pose` gives them.
        right : ndarray, optional
            The part's right-hand sides.
        """
        exact = self.noise.sum(axis=0)[:, None]
        if pose is not None and right is not None:
            of_nodes = pose.variance(self.rows @ right.reshape(self.rows.shape[1], -1))
            exact = exact + column_variances(pose, of_nodes)
        exact = exact.reshape(len(self.node), self.determined.shape[2], -1)
        worst = 0.0
        for x, n, of_node in zip(self.layer, self.node, exact, strict=True):
            known = self.determined[x, n] & np.all(of_node > 0, axis=1)
            of_pose = kept[x, n, known]
            of_pose = of_pose if pose is None else column_variances(pose, of_pose)
            ratio = np.sqrt((noise[x, n, known, None] + of_pose) / of_node[known])
            worst = max(worst, float(np.abs(ratio - 1).max(initial=0.0)))
        return worst


def _chosen(rows: NearRows, determined: BoolArray) -> tuple[IndexArray, IndexArray]:
    """Choose some nodes spread over a part's own, and one with the oddest information."""
    layers, count = determined.shape[:2]
    own = np.linspace(0, count - 1, min(NODES, count)).round().astype(np.intp)
    layer = np.arange(len(own)) * (layers - 1) // max(1, len(own) - 1)
    far = np.abs(rows.turn - np.eye(rows.turn.shape[-1])).max(axis=(2, 3))
    x, n = np.unravel_index(np.argmax(far * determined.all(axis=2)), far.shape)
    return np.append(layer, x), np.append(own, n)
