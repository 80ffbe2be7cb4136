"""Poses refined by the velocity images of all views, ``pose.refine=images``.

The joint fit of a smooth field and of all poses, each with the prior that its own method gave, is
repeated until the poses stand still: images tell where beams hit, to a fraction of a millimetre
where the calibration tells one. What they tell is the place that a beam hits, not rotation and
origin apart, so that no number is free of its prior. A motion of all views together, with a field
that moves along, is nearly free; the priors hold it, and how much it is known better than before is
told apart. The pose of a view that disagrees is not refined but repaired, see
`sldvexp.verdict.diagnosis`. Where it was, it is adjusted anew with the others from where it was
stated, free of the same prior: the repaired pose comes from these images already, and as a prior it
would count them twice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.field import View
from sldvexp.geometry import rotation_from_vector, vector_from_rotation
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import JointCovariance, pose_to_dataset
from sldvexp.typing import Array
from sldvexp.verdict.beams import PixelBeams
from sldvexp.verdict.comparison import Bench, compare_views, prior_factor
from sldvexp.verdict.diagnosis import widened
from sldvexp.verdict.explanation import POSE
from sldvexp.verdict.joint_fit import JointFit
from sldvexp.verdict.pixel_data import PixelData

#: Steps of the joint adjustment.
STEPS = 3


@dataclass(frozen=True, eq=False)
class RefinedPoses:
    """Poses after the joint adjustment.

    Attributes
    ----------
    moves : ndarray, shape (view, 6)
        Rotation vectors (rad) and displacements (m) from the stated poses.
    covariance : ndarray, shape (6 view, 6 view)
    hit_before, hit_after : ndarray, shape (view,), m
        Standard error of the place that a beam hits, r.m.s. over the pixels.
    common : float
        Standard error of the common motion of all views after the adjustment over that before, of
        the direction in which it has gained least.
    agrees : bool
        True if no view is rejected at the refined poses.
    """

    moves: Array
    covariance: Array
    hit_before: Array
    hit_after: Array
    common: float
    agrees: bool


def refine(
    bench: Bench, stated: Sequence[View], covariance: Array, free: Mapping[int, Sequence[int]]
) -> RefinedPoses:
    """Adjust all poses to all images.

    Parameters
    ----------
    bench : Bench
        At the poses as they are known so far, from where the adjustment starts.
    stated : sequence of View
        At the poses that the images have told nothing of yet.
    covariance : ndarray, shape (6 view, 6 view)
        Of these.
    free : mapping of int to sequence of int
        Numbers of a view's pose that a repair has freed.
    """
    count = POSE * len(bench.data)
    before = (bench.prior @ bench.prior.T)[:count, :count]
    errors = np.r_[_moves(stated, [d.view for d in bench.data]).ravel(), 0.0]
    bench = _as_stated(bench, stated, covariance, free)
    standard: Array = np.asarray(np.linalg.lstsq(bench.prior, errors)[0], float)
    fit = JointFit(bench.data, bench.designs(bench.prior @ standard), bench.prior, standard)
    for _ in range(STEPS):
        fit = bench.again(fit)
    after = fit.covariance[:count, :count]
    tested = compare_views(bench, fit)
    return RefinedPoses(
        fit.poses[:count].reshape(-1, POSE),
        after,
        _hit_errors(fit, before),
        _hit_errors(fit, after),
        _common(before, after, len(bench.data)),
        not tested.rejects,
    )


def _as_stated(
    bench: Bench, stated: Sequence[View], covariance: Array, free: Mapping[int, Sequence[int]]
) -> Bench:
    """Put views back to where they were stated, repaired ones without the prior that was wrong."""
    data = [_usable(d, view, bench) for d, view in zip(bench.data, stated, strict=True)]
    prior = prior_factor(covariance, len(data), bench.surface.thickness)
    found = replace(bench, data=data, prior=prior)
    for k, numbers in free.items():
        found = widened(found, k, np.array(numbers))
    return found


def _usable(data: PixelData, view: View, bench: Bench) -> PixelData:
    """Take another place of a view, and of its pixels those that have not been left out since."""
    kept = view.usable[data.pixel]
    of = {name: getattr(data, name)[kept] for name in ("pixel", "velocity", "weight", "std")}
    return PixelData(view, **of, beams=PixelBeams.trace(view, bench.surface, of["pixel"]))


def _moves(stated: Sequence[View], views: Sequence[View]) -> Array:
    """Find by what stated poses were moved, shape (view, 6), rad and m."""
    pairs = list(zip(stated, views, strict=True))
    turned = [vector_from_rotation(v.rotation @ s.rotation.T) for s, v in pairs]
    return np.hstack([turned, [v.origin - s.origin for s, v in pairs]])


def _hit_errors(fit: JointFit, covariance: Array) -> Array:
    """Propagate a covariance of the poses to the places that the beams hit, shape (view,), m."""
    found = []
    for k, design in enumerate(fit.designs):
        own = covariance[POSE * k : POSE * (k + 1), POSE * k : POSE * (k + 1)]
        moves = design.beams.point_by_pose
        found.append(np.sqrt(np.mean(np.einsum("nip,pq,niq->n", moves, own, moves))))
    return np.array(found)


def _common(before: Array, after: Array, views: int) -> float:
    """Compare what is known of the mean displacement of all origins, before and after."""
    mean = np.zeros((3, POSE * views))
    for k in range(views):
        mean[:, POSE * k + 3 : POSE * (k + 1)] = np.eye(3) / views
    was, now = (np.diag(mean @ c @ mean.T) for c in (before, after))
    known = was > 0
    return float(np.sqrt((now[known] / was[known]).max())) if known.any() else np.nan


def moved_poses(pose: xr.Dataset, moves: Array, covariance: Array) -> xr.Dataset:
    """Move the views of a group ``pose``.

    Parameters
    ----------
    moves : ndarray, shape (view, 6)
        Rotation vectors of the laser frames (rad) and displacements of the origins (m).
    covariance : ndarray, shape (6 view, 6 view)
        Of all poses together.

    Raises
    ------
    UserError
        If intrinsics were adjusted with the poses: their errors go with the old ones.
    """
    if "adjusted" in pose.coords:
        raise UserError(
            "pose: poses with adjusted intrinsics cannot be moved by the images; leave out "
            "pose.adjust and pose.shared"
        )
    views = [str(v) for v in pose["view"].values]
    rotation = rotation_from_vector(moves[:, :3]) @ pose["rotation"].values
    origin = pose["origin"].values + moves[:, 3:]
    joint = JointCovariance(views, (), (), covariance)
    found = pose_to_dataset(
        views,
        rotation,
        origin,
        joint.of_views(),
        pose["dof"].values,
        float(pose.attrs.get("confidence_level", 0.95)),
        joint=joint,
    )
    others = pose.drop_vars([n for n in pose.variables if n in found.variables])
    others = others.drop_dims([d for d in ("unknown", "unknown2") if d in others.dims])
    return found.assign(others.data_vars).assign_attrs(pose.attrs)
