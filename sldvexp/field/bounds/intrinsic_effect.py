"""How far nodal values may be off because intrinsics were adjusted with the poses.

The errors e of the intrinsics and p of the poses have a joint covariance. The part B e of p goes
with e, ``B = C_pe C_ee^-1``; the rest has the covariance ``C_pp - B C_ep`` and nothing to do with
e. The rest's effect is that of poses alone; what remains is how the field changes with e when the
poses go along.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.field.visibility.view import View
from sldvexp.geometry.rotation import rotation_from_vector
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import EXTRINSICS, cross_covariance, label
from sldvexp.pose.intrinsics import places
from sldvexp.pose.least_squares import INTRINSICS
from sldvexp.typing import Array

POSE = len(EXTRINSICS)
#: Variance, over the largest, below which a combination of the intrinsics has no error of its own.
NO_ERROR = 1e-12


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """What is known of the errors of poses, and of intrinsics adjusted with them.

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
        """Those of some views of the group ``pose``; None if one has no covariance."""
        adjusted = [str(a) for a in pose["adjusted"].values] if "adjusted" in pose.coords else []
        whole = _covariance(pose, views, adjusted)
        if not np.isfinite(whole).all():
            return None
        count = len(views)
        poses = whole[:, :POSE, :, :POSE].reshape(POSE * count, POSE * count)
        e = whole[:, POSE:, :, POSE:].reshape(2 * [count * len(adjusted)])
        together = whole[:, :POSE, :, POSE:].reshape(POSE * count, -1)
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

    def moved(self, views: Sequence[View]) -> Iterator[tuple[list[View], list[View]]]:
        """The views with each independent error added and subtracted."""
        for pose, intrinsic in zip(self.pose, self.intrinsic, strict=True):
            each = list(zip(views, pose, intrinsic, strict=True))
            yield [_moved(v, p, e) for v, p, e in each], [_moved(v, -p, -e) for v, p, e in each]

    def variance(self, views: Sequence[View], solved: Callable[[list[View]], Array]) -> Array:
        """Variance of the solution, from how it changes between plus and minus one deviation.

        Parameters
        ----------
        views : sequence of View
        solved : callable
            From views to the solution.
        """
        changes = [(solved(more) - solved(less)) / 2 for more, less in self.moved(views)]
        return np.asarray(sum(change**2 for change in changes))


def _moved(view: View, pose: Array, intrinsic: Array) -> View:
    """A view whose pose and intrinsics are other ones by this much."""
    assert view.intrinsics is not None
    return replace(
        view,
        rotation=rotation_from_vector(pose[:3]) @ view.rotation,
        origin=view.origin + pose[3:],
        intrinsics=view.intrinsics + intrinsic,
    )


def _covariance(pose: xr.Dataset, views: Sequence[str], adjusted: Sequence[str]) -> Array:
    """Covariance of some views' poses and intrinsics, shape (view, 6 + adjusted, ...twice).

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
