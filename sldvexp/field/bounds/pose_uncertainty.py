"""Uncertainty of nodal values because poses, and intrinsics adjusted with them, are not exact.

A small change of a pose moves image points and directions. With the nodal values' derivatives J by
all poses and these poses' covariance C, the nodal covariance is ``J C J^T``: first order, which
holds as long as a pose is known to a small part of what the velocity image varies over. J depends
on the velocities; for many frequencies it is computed for their few modes and combined.

Where intrinsics were adjusted, their errors e and the poses' errors p have a joint covariance. The
part B e of p goes with e, ``B = C_pe C_ee^-1``; the rest has the covariance ``C_pp - B C_ep`` and
nothing to do with e. The rest's effect is that of poses alone; what remains is how the field
changes with e when the poses go along, found by solving with plus and minus one deviation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.field.bounds.compiled import CompiledKernels, kernels_for
from sldvexp.field.equations.regions import RegionSamples
from sldvexp.field.streaming.compression import FrequencyModes
from sldvexp.field.visibility.pose_slopes import PoseSlopes
from sldvexp.field.visibility.projection import ViewSamples, angle_slope, to_laser
from sldvexp.field.visibility.view import View
from sldvexp.lazy import xarray as xr
from sldvexp.pose import EXTRINSICS, INTRINSICS, cross_covariance, label, places
from sldvexp.typing import Array

#: Samples that stay in the cache, whatever is computed of them.
SAMPLES_AT_ONCE = 4096
#: Some samples, their derivatives by a pose, and the change of what a view sees of them.
Blocks = Iterator[tuple[slice, PoseSlopes, Array]]


@dataclass(frozen=True, eq=False)
class PoseEffect:
    """Effect of the poses: covariance and data for the derivatives by them.

    Parameters
    ----------
    covariance : ndarray, shape (6 views, 6 views)
    theta : ndarray, shape (layer, surface_node, parameter, mode)
        The solution of the modes.
    data : list of ndarray, shape (pixel, mode)
        Velocities of the modes.
    """

    covariance: Array
    modes: FrequencyModes
    theta: Array
    data: list[Array]

    @classmethod
    def from_modes(
        cls, covariance: Array, modes: FrequencyModes, theta: Array, data: list[Array]
    ) -> PoseEffect:
        """Reduce all columns of the solution and of the data to modes."""
        of_modes = [modes.of_columns(d) for d in data]
        return cls(covariance, modes, modes.of_columns(theta), of_modes)

    def variance(self, derivatives: Array) -> Array:
        """Compute the variance ``J C J^T`` of every column.

        Parameters
        ----------
        derivatives : ndarray, shape (..., 6 views * mode)

        Returns
        -------
        ndarray, shape (..., column)
        """
        j = derivatives.reshape(*derivatives.shape[:-1], len(self.covariance), -1)
        gram = np.swapaxes(j, -1, -2) @ (self.covariance @ j)
        return np.maximum(self.modes.quadratic(gram), 0.0)

    def changes(self, part: RegionSamples, u: Array) -> Iterator[tuple[int, Array]]:
        """Differentiate samples' velocities, less ``X u``, by the pose of the view that sees them.

        Parameters
        ----------
        u : ndarray, shape (sample, parameter, mode)

        Yields
        ------
        k : int
            The view; those that the rows leave out are left out.
        change : ndarray, shape (sample, 6, mode)
            ``dv - dx . u``.
        """
        for k, blocks in self._by_view(part, u):
            change = np.empty((len(u), POSE, u.shape[2]))
            for here, _, of_some in blocks:
                change[here] = np.moveaxis(of_some, -1, 0)
            yield k, change

    def _by_view(self, part: RegionSamples, u: Array) -> Iterator[tuple[int, Blocks]]:
        """Go through the views, and in each through some samples at a time.

        These are given with their derivatives by the pose, and the change as in `changes`, but of
        the shape (6, mode, sample).
        """
        samples, laser = part.samples, part.visibility.laser
        world = np.swapaxes(samples.frame, 1, 2) @ u[:, :3] if part.model.local else u[:, :3]
        world = np.moveaxis(world, 0, -1).copy()
        views = zip(part.visibility.views, samples.by_view, self.data, strict=True)

        def blocks(view: View, of_view: ViewSamples, data: Array) -> Blocks:
            slope = np.swapaxes(of_view.slopes(data), 1, 2).copy()
            of_gap = len(u) // part.patch.sample_shape[0]
            for first, last in _ends(part.patch.sample_shape[0], of_gap):
                here = slice(first, last)
                points, dac = samples.position[here], of_view.dac[here]
                slopes = PoseSlopes.from_points(view, laser, points, dac)
                yield here, slopes, slopes.change(slope[..., here], world[..., here])

        for k, each in enumerate(views):
            if part.at.pointwise.weight.have(k):
                yield k, blocks(*each)

    def _compiled(
        self, kernels: CompiledKernels, part: RegionSamples, u: Array, balance: Array
    ) -> Iterator[tuple[int, Array]]:
        """Sum right-hand sides of every view at the nodes, (layer, patch_node, parameter, ...)."""
        samples, laser, patch = part.samples, part.visibility.laser, part.patch
        world = np.swapaxes(samples.frame, 1, 2) @ u[:, :3] if part.model.local else u[:, :3]
        where = patch.corner, np.ascontiguousarray(patch.shape), patch.layers - 1, len(patch.nodes)
        axes = _axes(part) if len(balance) else np.eye(3)[None]
        for k, (view, seen) in enumerate(zip(part.visibility.views, samples.by_view, strict=True)):
            if not part.at.pointwise.weight.have(k):
                continue
            own, known = view.laser(laser), np.isfinite(seen.dac[:, :1] + seen.dac[:, 1:])
            by_step = angle_slope(own, np.where(known, seen.dac, 0.0))
            sums = kernels.pose_sums(
                where,
                (view.rotation, float(own.mirror_offset)),
                np.ascontiguousarray(to_laser(view, samples.position)),
                np.where(known, by_step, np.nan),
                seen.slopes(self.data[k]),
                np.ascontiguousarray(world),
                np.ascontiguousarray(part.at.estimator[:, :, k]),
                axes,
                np.ascontiguousarray(balance[:, k]),
            )
            yield k, sums.reshape(*sums.shape[:2], part.model.parameters, -1)

    def right_sides(self, part: RegionSamples) -> Array:
        """Set up right-hand sides of the derivatives by all poses, ``M dtheta = ...``.

        A change of view k's pose changes its velocity at a sample: ``dv = grad v . d dac`` and its
        row of X by dx. With what the view's rows leave, r = v - X u, the sample adds
        ``dx (Q r)_k + T_k (dv - dx . u)``. For the contravariant method u is what the sample's own
        rows give, and their inverse stands before dx.

        Returns
        -------
        ndarray, shape (layer, patch_node, parameter, 6 views * mode)
        """
        at, data = part.at, self.data
        count, parameters, views = at.estimator.shape
        shape = (part.patch.layers, len(part.patch.nodes), parameters)
        v = part.velocities(data)
        u = part.field(self.theta) if at.inverse is None else at.solution @ v
        found = np.zeros((*shape, views, POSE * data[0].shape[1]))
        nothing_left = at.inverse is not None and len(part.model.rows) == parameters
        balance = np.zeros((0, views, 0))
        if not nothing_left:
            balance = at.pointwise.weight.times(v - at.pointwise.design @ u)
        if (kernels := kernels_for(part.visibility)) is not None:
            for k, sums in self._compiled(kernels, part, u, balance):
                found[:, :, :, k] = sums
            return found.reshape(*shape, -1)
        columns = found.shape[-1]
        of_gap = count // part.patch.sample_shape[0]
        side = np.empty((parameters, columns, of_gap))
        for k, blocks in self._by_view(part, u):
            for here, slopes, change in blocks:
                gap, first = divmod(here.start, of_gap)
                some = slice(first, first + here.stop - here.start)
                of_samples = change.reshape(columns, -1)
                estimator = np.ascontiguousarray(at.estimator[here, :, k].T)
                np.multiply(estimator[:, None], of_samples, out=side[..., some])
                if not nothing_left:
                    turn = _turn(part, here, slopes)
                    added = turn[:, :, None] * np.ascontiguousarray(balance[here, k].T)
                    side[: len(turn), :, some] += added.reshape(len(turn), columns, -1)
                if some.stop == of_gap:
                    sums = part.patch.gap_to_nodes(side.reshape(-1, of_gap))
                    found[gap : gap + 2, :, :, k] += sums.reshape(2, *shape[1:], columns)
        return found.reshape(*shape, -1)


def _axes(part: RegionSamples) -> Array:
    """Find the matrices that `_turn` multiplies by; one alone where all samples have it."""
    axes = part.samples.frame if part.model.local else np.eye(3)[None]
    if part.at.inverse is None:
        return axes
    return np.ascontiguousarray(part.at.information * part.at.inverse[:, :, :3] @ axes)


def _ends(gaps: int, samples: int) -> Iterator[tuple[int, int]]:
    """Go through so many samples in each gap, some at a time, and never those of two gaps."""
    for start in range(0, gaps * samples, samples):
        for first in range(start, start + samples, SAMPLES_AT_ONCE):
            yield first, min(first + SAMPLES_AT_ONCE, start + samples)


def _turn(part: RegionSamples, here: slice, slopes: PoseSlopes) -> Array:
    """Differentiate ``M_s^-1 x`` by the pose, as dx is that of the components' directions.

    Of shape (parameter, 6, sample); M_s is the sample's own matrix where each is solved by itself.
    """
    turn, inverse = slopes.directions(), part.at.inverse
    if part.model.local:
        turn = np.einsum("sij,jps->ips", part.samples.frame[here], turn)
    if inverse is not None:
        weighted = part.at.information[here] * inverse[here, :, :3]
        turn = np.einsum("sij,jps->ips", weighted, turn)
    return turn


def pose_covariance(views: Sequence[View], joint: Array | None) -> Array | None:
    """Join the covariances of all poses, (6 views, 6 views); None if that of a view is not known.

    Raises
    ------
    UserError
        If the given one has another shape.
    """
    size = POSE * len(views)
    if joint is not None:
        if joint.shape != (size, size):
            raise UserError(
                f"the covariance of the poses has shape {joint.shape}; {len(views)} views need "
                f"({size}, {size})"
            )
        return joint
    found = np.zeros((size, size))
    for k, view in enumerate(views):
        if view.covariance is None:
            return None
        found[POSE * k : POSE * (k + 1), POSE * k : POSE * (k + 1)] = view.covariance
    return found


class ModeEffect(PoseEffect):
    """Keeps of each nodal value the covariance ``J C J^T`` of all modes, whatever the columns.

    A column's variance is then a quadratic form of it, see `column_variances`.
    """

    def variance(self, derivatives: Array) -> Array:
        """Compute covariances, shape (..., mode * mode); see `PoseEffect.variance`."""
        j = derivatives.reshape(*derivatives.shape[:-1], len(self.covariance), -1)
        gram = np.swapaxes(j, -1, -2) @ (self.covariance @ j)
        return gram.reshape(*gram.shape[:-2], -1)


def kept_columns(pose: PoseEffect | None) -> int:
    """Count the numbers that `PoseEffect.variance` gives of a nodal value; 1 without an effect."""
    if pose is None:
        return 1
    modes, columns = pose.modes.combination.shape
    return modes**2 if isinstance(pose, ModeEffect) else columns


def column_variances(pose: PoseEffect, kept: Array) -> Array:
    """Compute variances of the data's columns, from what `PoseEffect.variance` gave."""
    return of_modes(pose.modes, kept) if isinstance(pose, ModeEffect) else kept


def of_modes(modes: FrequencyModes, covariance: Array) -> Array:
    """Compute variances of the modes' columns, from (..., mode * mode) to (..., column)."""
    count = len(modes.combination)
    gram = covariance.reshape(*covariance.shape[:-1], count, count)
    return np.maximum(modes.quadratic(gram), 0.0)


POSE = len(EXTRINSICS)
#: Variance, over the largest, below which a combination of the intrinsics has no error of its own.
NO_ERROR = 1e-12


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """Errors of poses, and of intrinsics adjusted with them, as far as they are known.

    Attributes
    ----------
    covariance : ndarray, shape (6 views, 6 views), rad and m
        Of the poses' errors, without those that go with the intrinsics'.
    pose : ndarray, shape (error, view, 6), rad and m
        What the poses are off by when an independent error of the intrinsics has one standard
        deviation.
    intrinsic : ndarray, shape (error, view, 5)
        What the intrinsics themselves are off by then, in the order of `INTRINSICS`.
    """

    covariance: Array
    pose: Array
    intrinsic: Array

    @classmethod
    def from_dataset(cls, pose: xr.Dataset, views: Sequence[str]) -> PoseErrors | None:
        """Read the errors of some views from the group ``pose``; None if one has no covariance."""
        adjusted = [str(a) for a in pose["adjusted"].values] if "adjusted" in pose.coords else []
        whole = _covariance(pose, views, adjusted)
        if not np.isfinite(whole).all():
            return None
        count = len(views)
        poses = whole[:, :POSE, :, :POSE].reshape(POSE * count, POSE * count)
        e = whole[:, POSE:, :, POSE:].reshape(2 * [count * len(adjusted)])
        together = whole[:, :POSE, :, POSE:].reshape(POSE * count, count * len(adjusted))
        size = np.sqrt(np.where(np.diag(e) > 0, np.diag(e), 1.0))
        variance, direction = np.linalg.eigh(e / np.outer(size, size))
        own = variance > NO_ERROR * variance.max(initial=0.0)
        direction, deviation = direction[:, own], np.sqrt(variance[own])
        of_poses = together @ (direction / size[:, None] / deviation)
        of_e = size[:, None] * direction * deviation
        intrinsic = np.zeros((len(deviation), count, len(INTRINSICS)))
        intrinsic[:, :, places(adjusted)] = of_e.T.reshape(len(deviation), count, len(adjusted))
        return cls(
            poses - of_poses @ of_poses.T,
            of_poses.T.reshape(len(deviation), count, POSE),
            intrinsic,
        )

    @property
    def whole(self) -> Array:
        """Covariance of the poses' errors, with those that go with the intrinsics'."""
        of_intrinsics = self.pose.reshape(len(self.pose), len(self.covariance))
        return np.asarray(self.covariance + of_intrinsics.T @ of_intrinsics)

    def moved(self, views: Sequence[View]) -> Iterator[tuple[list[View], list[View]]]:
        """Move the views by each independent error, added and subtracted."""
        for pose, intrinsic in zip(self.pose, self.intrinsic, strict=True):
            each = list(zip(views, pose, intrinsic, strict=True))
            yield [_moved(v, p, e) for v, p, e in each], [_moved(v, -p, -e) for v, p, e in each]


def _moved(view: View, pose: Array, intrinsic: Array) -> View:
    """Change a view's pose and intrinsics by this much."""
    assert view.intrinsics is not None
    return replace(view.moved(pose), intrinsics=view.intrinsics + intrinsic)


def _covariance(pose: xr.Dataset, views: Sequence[str], adjusted: Sequence[str]) -> Array:
    """Collect the covariance of views' poses and intrinsics, shape (view, 6 + adjusted, ...twice).

    A shared intrinsic has the same error in all views.
    """
    if not adjusted:
        return cross_covariance(pose, views)
    count, names = len(views), [*EXTRINSICS, *adjusted]
    if "joint_covariance" not in pose:
        own = pose["covariance"].sel(view=list(views), parameter=names, parameter2=names).values
        whole = np.zeros((count, len(names), count, len(names)))
        whole[np.arange(count), :, np.arange(count)] = own
        return whole
    known = set(map(str, pose["unknown"].values))
    of = [label(v, n) if label(v, n) in known else n for v in views for n in names]
    whole = pose["joint_covariance"].sel(unknown=of, unknown2=of).values
    return np.asarray(whole.reshape(count, len(names), count, len(names)))
