"""How far nodal values may be off because the poses are not known exactly.

A small change of a pose moves image points and directions. With the nodal values' derivatives J by
all poses and these poses' covariance C, the nodal covariance is ``J C J^T``.

The poses' effect on more frequencies than are kept at a time: that on their few modes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.field.equations.regions import RegionSamples
from sldvexp.field.streaming.compression import FrequencyModes
from sldvexp.field.visibility.view import View
from sldvexp.typing import Array

#: Parameters of a pose.
POSE = 6


@dataclass(frozen=True, eq=False)
class PoseEffect:
    """What is needed for the derivatives by the poses.

    Parameters
    ----------
    covariance : ndarray, shape (6 views, 6 views)
    modes : FrequencyModes
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
        """That on all columns of the solution and the data."""
        of_modes = [modes.of_columns(d) for d in data]
        return cls(covariance, modes, modes.of_columns(theta), of_modes)

    def variance(self, derivatives: Array) -> Array:
        """Variance ``J C J^T`` of every column.

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

    def right_sides(self, part: RegionSamples) -> Array:
        """Right-hand sides of the derivatives by all poses, ``M dtheta = ...``.

        A change of view k's pose changes its velocity at a sample: ``dv = grad v . d dac`` and its
        row of X by dx. With what the view's rows leave, r = v - X u, the sample adds
        ``dx (Q r)_k + T_k (dv - dx . u)``. For the contravariant method u is what the sample's own
        rows give, and their inverse stands before dx.

        Parameters
        ----------
        part : RegionSamples

        Returns
        -------
        ndarray, shape (layer, patch_node, parameter, 6 views * mode)
        """
        at, look, data = part.at, part.look, self.data
        samples, parameters, views = at.estimator.shape
        shape = (part.patch.layers, len(part.patch.nodes), parameters)
        v = part.velocities(data)
        u = part.field(self.theta) if at.inverse is None else at.estimator @ v
        balance = at.pointwise.weight @ (v - at.pointwise.design @ u)
        found = np.zeros((*shape, views, POSE * data[0].shape[1]))
        for k, (view, seen) in enumerate(zip(part.looks.views, look.seen, strict=True)):
            if not at.pointwise.weight[:, k].any():  # the rows leave this view out
                continue
            by_dac, turn = seen.pose_derivative(view, part.looks.laser, look.position)
            if part.model.local:
                turn = look.frame @ turn
            slope = np.stack([g @ data[k] for g in seen.gradient], axis=1)
            change = np.swapaxes(by_dac, 1, 2) @ slope - np.swapaxes(turn, 1, 2) @ u[:, :3]
            side = at.estimator[:, :, k, None, None] * change[:, None]
            before = turn if at.inverse is None else at.inverse[:, :, :3] @ turn
            side[:, : before.shape[1]] += before[..., None] * balance[:, k, None, None]
            found[:, :, :, k] = part.patch.to_nodes(side.reshape(samples, -1)).reshape(*shape, -1)
        return found.reshape(*shape, -1)


def pose_covariance(views: Sequence[View], joint: Array | None) -> Array | None:
    """Covariance of all poses, (6 views, 6 views); None if that of a view is not known.

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
        """Covariances, shape (..., mode * mode); see `PoseEffect.variance`."""
        j = derivatives.reshape(*derivatives.shape[:-1], len(self.covariance), -1)
        gram = np.swapaxes(j, -1, -2) @ (self.covariance @ j)
        return gram.reshape(*gram.shape[:-2], -1)


def kept_columns(pose: PoseEffect | None) -> int:
    """How many numbers `PoseEffect.variance` gives of a nodal value; 1 without an effect."""
    if pose is None:
        return 1
    modes, columns = pose.modes.combination.shape
    return modes**2 if isinstance(pose, ModeEffect) else columns


def column_variances(pose: PoseEffect, kept: Array) -> Array:
    """Variances of the data's columns, from what `PoseEffect.variance` gave."""
    return of_modes(pose.modes, kept) if isinstance(pose, ModeEffect) else kept


def of_modes(modes: FrequencyModes, covariance: Array) -> Array:
    """Variances of the modes' columns, from (..., mode * mode) to (..., column)."""
    count = len(modes.combination)
    gram = covariance.reshape(*covariance.shape[:-1], count, count)
    return np.maximum(modes.quadratic(gram), 0.0)
