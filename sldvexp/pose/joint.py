"""The covariance of all views together: views that share errors do not err independently."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import EXTRINSICS
from sldvexp.typing import Array


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
