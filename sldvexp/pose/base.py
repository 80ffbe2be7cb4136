"""What every pose method has in common: its place in the run and its group of the dataset."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import ArrayLike

    from sldvexp.laser.two_mirror import TwoMirror
    from sldvexp.target.base import Target

#: The six extrinsics: a small rotation vector of the laser frame (rad) and the origin (m).
EXTRINSICS = ("rotation_x", "rotation_y", "rotation_z", "x", "y", "z")


@dataclass
class PoseMethod(ABC):
    """A way to find where the instrument stood."""

    @abstractmethod
    def estimate(
        self, laser: TwoMirror, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> dict[str, xr.Dataset]:
        """The pose of every view, with bounds.

        Parameters
        ----------
        laser : TwoMirror
        target : Target or None
        tree : mapping of str to xarray.Dataset
            What the run has so far; scanned edges are the groups ``edge/<view>``.

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
    from sldvexp.geometry.rotation import euler_from_rotation
    from sldvexp.pose.statistics import euler_standard_error, half_width, standard_error

    rotation, covariance = np.asarray(rotation, float), np.asarray(covariance, float)
    euler_std = euler_standard_error(rotation, covariance)
    origin_std = standard_error(covariance)[:, 3:6]
    dof = np.asarray(dof, float)
    labels = {"view": list(views), "parameter": list(parameters), "parameter2": list(parameters)}
    group = dataset.group(
        "pose",
        labels | (coords or {}),
        rotation=rotation,
        origin=origin,
        euler=euler_from_rotation(rotation),
        covariance=covariance,
        euler_std=euler_std,
        origin_std=origin_std,
        euler_confidence=half_width(euler_std, dof, confidence),
        origin_confidence=half_width(origin_std, dof, confidence),
        dof=dof,
        **more,
    )
    group.attrs["confidence_level"] = confidence
    return group
