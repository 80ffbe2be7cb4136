"""What every pose method has in common: its place in the run and its group of the dataset."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import ArrayLike

    from sldvexp.laser.two_mirror import TwoMirror
    from sldvexp.target.base import Target

#: The six extrinsics: a small rotation vector of the laser frame (rad), the origin in the world (m).
EXTRINSICS = ("rotation_x", "rotation_y", "rotation_z", "x", "y", "z")


@dataclass
class PoseMethod(ABC):
    """A way to find where the instrument stood."""

    @abstractmethod
    def estimate(self, laser: TwoMirror, target: Target | None) -> dict[str, xr.Dataset]:
        """The pose of every view, with bounds.

        Parameters
        ----------
        laser : TwoMirror
        target : Target or None

        Returns
        -------
        dict of str to xarray.Dataset
            The group ``pose``, and ``registration`` if the method used points.

        Raises
        ------
        UserError
            If the data is wrong or cannot determine a pose.
        """

    def inputs(self) -> list[str]:
        """Files that the method reads, as the configuration names them."""
        return []


def pose_group(
    views: Sequence[str],
    rotation: ArrayLike,
    origin: ArrayLike,
    covariance: ArrayLike,
    dof: ArrayLike,
    confidence: float,
    parameters: Sequence[str] = EXTRINSICS,
    coords: dict[str, Any] | None = None,
    **more: ArrayLike | None,
) -> xr.Dataset:
    """The group ``pose`` with its standard errors and intervals.

    Parameters
    ----------
    views : sequence of str
    rotation : array_like, shape (view, 3, 3)
        World to laser.
    origin : array_like, shape (view, 3), m
    covariance : array_like, shape (view, parameter, parameter)
        Of the parameters below; NaN where nothing is known of the uncertainty.
    dof : array_like, shape (view,)
        Degrees of freedom behind the covariance; infinite if it is known.
    confidence : float
        Level of the intervals.
    parameters : sequence of str
        The six `EXTRINSICS`, then adjusted intrinsics.
    coords, **more
        Further coordinates and variables of the group.
    """
    import numpy as np

    from sldvexp import dataset
    from sldvexp.geometry.rotation import euler_from_rotation, euler_jacobian
    from sldvexp.statistics.student import student_factor

    covariance = np.asarray(covariance, float)
    jacobian = euler_jacobian(rotation)
    euler_covariance = jacobian @ covariance[:, :3, :3] @ np.swapaxes(jacobian, -1, -2)
    euler_std = np.sqrt(np.einsum("vii->vi", euler_covariance))
    origin_std = np.sqrt(np.einsum("vii->vi", covariance[:, 3:6, 3:6]))
    dof = np.asarray(dof, float)
    factor = student_factor(confidence, dof)[:, None]
    group = dataset.group(
        "pose",
        {"view": list(views), "parameter": list(parameters), "parameter2": list(parameters)}
        | (coords or {}),
        rotation=rotation,
        origin=origin,
        euler=euler_from_rotation(rotation),
        covariance=covariance,
        euler_std=euler_std,
        origin_std=origin_std,
        euler_confidence=factor * euler_std,
        origin_confidence=factor * origin_std,
        dof=dof,
        **more,
    )
    group.attrs["confidence_level"] = confidence
    return group
