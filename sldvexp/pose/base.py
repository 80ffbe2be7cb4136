"""What every pose method has in common: its place in the run and its group of the dataset.

The covariance of all views together: views that share errors do not err independently.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sldvexp import dataset
from sldvexp.geometry.rotation import euler_from_rotation
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.uncertainty import euler_standard_error, half_width, standard_error
from sldvexp.targets.base import Target
from sldvexp.typing import Array

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


def pose_to_dataset(
    views: Sequence[str],
    rotation: ArrayLike,
    origin: ArrayLike,
    covariance: ArrayLike,
    dof: ArrayLike,
    confidence: float,
    adjusted: Sequence[str] = (),
    intrinsic: ArrayLike | None = None,
    joint: JointCovariance | None = None,
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
        Of the `EXTRINSICS` and `adjusted`; NaN where nothing is known of the uncertainty.
    dof : array_like, shape (view,)
        Degrees of freedom behind the covariance; infinite if it is known.
    confidence : float
        Level of the intervals.
    adjusted : sequence of str
        Intrinsics that the covariance is of besides the six `EXTRINSICS`.
    intrinsic : array_like, shape (view, adjusted), optional
    joint : JointCovariance, optional
        Of all views; kept if there are several.
    coords, **more
        Further coordinates and variables of the group.
    """
    rotation, covariance = np.asarray(rotation, float), np.asarray(covariance, float)
    euler_std, std = euler_standard_error(rotation, covariance), standard_error(covariance)
    origin_std = std[:, 3:6]
    dof = np.asarray(dof, float)
    parameters = [*EXTRINSICS, *adjusted]
    labels = {"view": list(views), "parameter": parameters, "parameter2": parameters}
    if len(adjusted):
        labels["adjusted"] = list(adjusted)
        more |= {"intrinsic": intrinsic, "intrinsic_std": std[:, 6:]}
        more["intrinsic_confidence"] = half_width(std[:, 6:], dof, confidence)
    if joint is not None and len(views) > 1:
        labels["unknown"] = labels["unknown2"] = joint.unknowns()
        more["joint_covariance"] = joint.matrix
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


@dataclass(frozen=True, eq=False)
class JointCovariance:
    """Covariance of the poses of all views and of their intrinsics.

    Parameters
    ----------
    views : sequence of str
    own, shared : sequence of str
        Intrinsics adjusted for each view and for all views.
    matrix : ndarray, shape (unknown, unknown)
        Of every view's `EXTRINSICS` and own intrinsics, view by view, then of the shared ones.
    """

    views: Sequence[str]
    own: Sequence[str]
    shared: Sequence[str]
    matrix: Array

    @property
    def adjusted(self) -> list[str]:
        """All adjusted intrinsics of a view."""
        return [*self.own, *self.shared]

    def unknowns(self) -> list[str]:
        """Names of the unknowns: ``view/parameter``, and the shared intrinsics as they are."""
        each = [label(v, p) for v in self.views for p in (*EXTRINSICS, *self.own)]
        return each + list(self.shared)

    def of_views(self) -> Array:
        """Each view's covariance, that of the shared intrinsics in it, shape (view, p, p).

        The parameters are `EXTRINSICS`, the own and the shared intrinsics.
        """
        size, first = len(EXTRINSICS) + len(self.own), len(self.matrix) - len(self.shared)
        common = np.arange(first, len(self.matrix))
        places = [np.r_[k : k + size, common] for k in range(0, first, size)]
        return np.array([self.matrix[np.ix_(p, p)] for p in places])


def label(view: str, parameter: str) -> str:
    """Name of a view's unknown in ``joint_covariance``."""
    return f"{view}/{parameter}"


def cross_covariance(pose: xr.Dataset, views: Sequence[str]) -> Array:
    """Covariance of some views' poses, between views too.

    Parameters
    ----------
    pose : xarray.Dataset
        The group ``pose``. Without ``joint_covariance`` its views are independent.
    views : sequence of str

    Returns
    -------
    ndarray, shape (view, 6, view, 6), rad and m
        Of the `EXTRINSICS`.
    """
    count, size = len(views), len(EXTRINSICS)
    if "joint_covariance" in pose:
        of = [label(v, p) for v in views for p in EXTRINSICS]
        whole = pose["joint_covariance"].sel(unknown=of, unknown2=of).values
        return np.asarray(whole.reshape(count, size, count, size))
    names = list(EXTRINSICS)
    own = pose["covariance"].sel(view=list(views), parameter=names, parameter2=names).values
    whole = np.zeros((count, size, count, size))
    whole[np.arange(count), :, np.arange(count)] = own
    return whole
