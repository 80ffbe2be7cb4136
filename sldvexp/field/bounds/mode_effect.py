"""The poses' effect on more frequencies than are kept at a time: that on their few modes."""

from __future__ import annotations

import numpy as np

from sldvexp.field.bounds.pose_uncertainty import PoseEffect
from sldvexp.field.streaming.frequency_modes import FrequencyModes
from sldvexp.typing import Array


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
