"""Poses solved from points: what the solvers return, and their place in the group ``pose``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import JointCovariance, describe_pose, pose_to_dataset
from sldvexp.pose.uncertainty import standard_error
from sldvexp.typing import Array, BoolArray


@dataclass(frozen=True, repr=False)
class PoseSolution:
    """Poses with their uncertainty; the leading (batch) dimension is missing for one problem.

    Parameters
    ----------
    rotation : ndarray, shape (..., 3, 3)
        World to laser, ``P_laser = rotation (P_world - origin)``.
    origin : ndarray, shape (..., 3), m
    intrinsics : dict of str to ndarray, shape (...)
        All of `INTRINSICS`, adjusted or not.
    parameters : tuple of str
        Names of the rows of `covariance`: the rotation vector of a small rotation of the laser
        frame (rad), the origin (m), and the adjusted intrinsics.
    covariance : ndarray, shape (..., parameters, parameters)
        Infinite where the noise cannot be estimated (`dof` is 0), or where `converged` is false.
    residual : ndarray, shape (..., points, 2), DAC steps
        Recorded minus predicted angles.
    cost : ndarray, shape (...)
        Minimum that was found: the sum of squared residuals, each over its standard deviation if
        known and in DAC steps if not, and of the priors' deviations in the same unit.
    sse_deg2 : ndarray, shape (...), deg^2
        Sum of squared residuals, without weights.
    dof : ndarray, shape (...)
        Degrees of freedom of the residuals; a prior may take any part between 0 and 1.
    s : ndarray, shape (...)
        Standard deviation of the residuals, DAC steps; if `noise_known`, in units of the given one.
        Infinite if `dof` is 0.
    noise_known : bool
        True if `covariance` rests on given standard deviations instead of `s`.
    converged : ndarray of bool, shape (...)
    has_other : ndarray of bool, shape (...)
        True where there is a second, distinct local minimum: a plane object has one as a rule.
    other_rotation, other_origin, other_cost : ndarray, shapes (..., 3, 3), (..., 3) and (...)
        The second solution; NaN where `has_other` is false.
    noise_dof : float
        Degrees of freedom behind the given standard deviations, if `noise_known`.
    """

    GROUP: ClassVar[str] = "pose"

    rotation: Array
    origin: Array
    intrinsics: dict[str, Array]
    parameters: tuple[str, ...]
    covariance: Array
    residual: Array
    cost: Array
    sse_deg2: Array
    dof: Array
    s: Array
    noise_known: bool
    converged: BoolArray
    has_other: BoolArray
    other_rotation: Array
    other_origin: Array
    other_cost: Array
    noise_dof: float = np.inf

    @property
    def covariance_dof(self) -> Array:
        """Degrees of freedom behind the covariance."""
        return np.where(self.noise_known, self.noise_dof, self.dof)

    @property
    def origin_std(self) -> Array:
        """Standard errors of the origin, shape (..., 3), m."""
        return standard_error(self.covariance)[..., 3:6]

    @property
    def residual_rms(self) -> Array:
        """Root mean square of the residuals, shape (...), DAC steps."""
        return np.sqrt(np.mean(self.residual**2, axis=(-1, -2)))

    def __repr__(self) -> str:
        points = self.residual.shape[-2]
        if self.origin.ndim > 1:
            rms = np.median(self.residual_rms)
            return (
                f"{len(self.origin)} poses from {points} points each: {self.converged.sum()} "
                f"found, residuals {rms:.3g} DAC steps rms in the median"
            )
        return f"pose from {points} points: " + describe_pose(
            self.origin, self.origin_std, float(self.residual_rms)
        )

    def single(self) -> list[PoseSolution]:
        """Each pose of a batch as a solution of its own."""
        if self.origin.ndim == 1:
            return [self]
        whole = ("intrinsics", "parameters", "noise_known", "noise_dof")
        names = [f.name for f in fields(self) if f.name not in whole]
        return [
            replace(
                self,
                intrinsics={name: value[k] for name, value in self.intrinsics.items()},
                **{name: getattr(self, name)[k] for name in names},
            )
            for k in range(len(self.origin))
        ]

    def to_dataset(
        self,
        views: Sequence[str] = (),
        *,
        number: ArrayLike | None = None,
        confidence: float = 0.95,
    ) -> xr.Dataset:
        """Make the group ``pose`` of a run, one view for each pose.

        Parameters
        ----------
        views : sequence of str, optional
            Names of the views; without them they are numbered from 1.
        number : array_like of int, shape (points,), optional
            Numbers of the points, the same in all views; from 1 without it.
        confidence : float
            Level of the intervals.
        """
        each = self.single()
        names = list(views) or [f"{k}" for k in range(1, len(each) + 1)]
        found = np.arange(1, self.residual.shape[-2] + 1) if number is None else np.asarray(number)
        return solutions_to_dataset(each, names, [found] * len(each), confidence)


@dataclass(frozen=True, eq=False, repr=False)
class JointSolution:
    """Poses of several views that were solved together.

    Parameters
    ----------
    solutions : list of PoseSolution
        One a view.
    joint : JointCovariance
        Names of the views, and the covariance between them.
    """

    GROUP: ClassVar[str] = "pose"

    solutions: list[PoseSolution]
    joint: JointCovariance

    def __repr__(self) -> str:
        each = zip(self.joint.views, self.solutions, strict=True)
        return "\n".join(f"view {name}, {solution!r}" for name, solution in each)

    def to_dataset(self, confidence: float = 0.95) -> xr.Dataset:
        """Make the group ``pose`` of a run; every view's points are numbered from 1."""
        number = [np.arange(1, len(s.residual) + 1) for s in self.solutions]
        return solutions_to_dataset(
            self.solutions, self.joint.views, number, confidence, self.joint
        )


def solutions_to_dataset(
    solutions: Sequence[PoseSolution],
    views: Sequence[str],
    number: Sequence[ArrayLike],
    confidence: float,
    joint: JointCovariance | None = None,
    left_out: Sequence[tuple[ArrayLike, Array]] | None = None,
) -> xr.Dataset:
    """Make the group ``pose`` of single views' solutions.

    Parameters
    ----------
    solutions : sequence of PoseSolution
        One a view, without a batch dimension.
    views : sequence of str
        Their names.
    number : sequence of array_like of int
        Numbers of each view's points; residuals of points that a view lacks are NaN.
    confidence : float
        Level of the intervals.
    joint : JointCovariance, optional
        Between the views.
    left_out : sequence of (numbers, residuals), optional
        Further points of each view, on which its pose does not rest. Their residuals are shown, and
        count nowhere.
    """

    def each(name: str) -> Array:
        return np.array([getattr(s, name) for s in solutions])

    others = left_out or []
    every = np.unique(np.concatenate([np.asarray(n) for n in (*number, *(n for n, _ in others))]))
    residual = np.full((len(solutions), len(every), 2), np.nan)
    for i, (own, s) in enumerate(zip(number, solutions, strict=True)):
        residual[i, np.searchsorted(every, own)] = s.residual
    rms = np.sqrt(np.nanmean(residual**2, axis=(1, 2)))
    for i, (own, beside) in enumerate(others):
        residual[i, np.searchsorted(every, own)] = beside
    dof, sse = each("dof"), each("sse_deg2")
    adjusted = solutions[0].parameters[6:]
    with np.errstate(divide="ignore", invalid="ignore"):
        s_deg = np.sqrt(sse / dof)
    return pose_to_dataset(
        views,
        each("rotation"),
        each("origin"),
        each("covariance"),
        each("covariance_dof"),
        confidence,
        adjusted=adjusted,
        intrinsic=np.array([[s.intrinsics[a] for a in adjusted] for s in solutions]),
        joint=joint,
        coords={"point": every},
        residual=residual,
        residual_rms=rms,
        s=np.array([_noise(s) for s in solutions]),
        s_deg=s_deg,
        sse=sse,
        cost=each("cost"),
        other_found=each("has_other"),
        other_origin=each("other_origin"),
        other_rotation=each("other_rotation"),
        other_cost=each("other_cost"),
    )


def _noise(solution: PoseSolution) -> float:
    """Estimate the standard deviation of a mirror reading, DAC steps, whatever the weights."""
    if not solution.noise_known or solution.dof <= 0:
        return float(solution.s)
    return float(np.sqrt(np.sum(solution.residual**2) / solution.dof))
