"""What the pose solver is given, checked and brought into shape."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.errors import UserError, nearest
from sldvexp.pose.least_squares import INTRINSICS
from sldvexp.typing import Array, BoolArray, IndexArray

#: Points whose second largest spread is below this part of the largest lie on one line.
COLLINEAR = 1e-6


@dataclass(frozen=True)
class Observations:
    """A stack of problems, the points in the last dimension.

    Parameters
    ----------
    points : ndarray, shape (batch or 1, 3, points), m
        In the world, relative to their centroid.
    centroid : ndarray, shape (batch or 1, 3), m
    normal : ndarray, shape (batch or 1, 3)
        Direction in which the points spread least.
    angles : ndarray, shape (batch, 2, points), rad
    step : ndarray, shape (2,), rad
    std : ndarray, shape (batch or 1, 1, points), DAC steps
        Standard deviations of the angles; one step if unknown.
    noise_known : bool
        Whether `std` was given.
    nominal : ndarray, shape (5,)
        Values of `INTRINSICS`.
    prior_std : dict of int to float
        Positions in `INTRINSICS` of those to adjust; infinite for a free one.
    batched : bool
        Whether the input had a batch dimension.
    """

    points: Array
    centroid: Array
    normal: Array
    angles: Array
    step: Array
    std: Array
    noise_known: bool
    nominal: Array
    prior_std: dict[int, float]
    batched: bool

    def part(self, block: slice) -> Observations:
        """Those problems; what they share is kept."""

        def of(a: Array) -> Array:
            return a if len(a) == 1 else a[block]

        return replace(
            self,
            points=of(self.points),
            centroid=of(self.centroid),
            normal=of(self.normal),
            angles=self.angles[block],
            std=of(self.std),
        )


def observations(
    object_points: ArrayLike,
    angles: ArrayLike,
    step: ArrayLike,
    mirror_offset: float,
    adjust: Mapping[str, float],
    std: ArrayLike | None,
) -> Observations:
    """Check the arguments of `sldvexp.pose.single_view.solve_pose`.

    Raises
    ------
    UserError
        At the first mistake.
    """
    points, recorded = np.asarray(object_points, float), np.asarray(angles, float)
    _check_shapes(points, recorded)
    batched = recorded.ndim == 3
    points = points.reshape(-1, *points.shape[-2:])
    recorded = recorded.reshape(-1, *recorded.shape[-2:])
    _check_all(np.isfinite(points).all(axis=-1), "the coordinates", "must be finite")
    in_front = (np.abs(recorded) < np.pi / 2).all(axis=-1)
    _check_all(in_front, "the angles", "must lie between -90 and 90 degrees")
    differ = (recorded != recorded[:, :1]).any(axis=(1, 2))
    _check_all(differ, "the angles", "must differ from point to point")
    steps = np.broadcast_to(np.asarray(step, float), (2,))
    if not (np.isfinite(steps) & (steps > 0)).all():
        raise UserError(f"the angle of a DAC step must be positive, not {steps.tolist()} rad")
    _check_adjust(mirror_offset, adjust, recorded.shape[-2], std is not None)

    points = points.swapaxes(-1, -2)
    centroid = points.mean(axis=-1)
    points = points - centroid[..., None]
    return Observations(
        points=points,
        centroid=centroid,
        normal=_least_spread(points),
        angles=np.ascontiguousarray(recorded.swapaxes(-1, -2)),
        step=steps,
        std=_deviations(std, recorded.shape[:2], batched),
        noise_known=std is not None,
        nominal=np.array([mirror_offset, 1.0, 0.0, 1.0, 0.0]),
        prior_std={INTRINSICS.index(name): float(prior) for name, prior in adjust.items()},
        batched=batched,
    )


def place(index: IndexArray, batch: int) -> str:
    """Say of which problem, or which point (problem, point); the problem only if there are many."""
    point = f" of point {index[1] + 1}" if len(index) > 1 else ""
    return point + (f" of pose {index[0] + 1} of {batch}" if batch > 1 else "")


def _check_shapes(points: Array, angles: Array) -> None:
    lead = angles.shape[:-2]
    fits = (
        len(lead) <= 1
        and angles.ndim >= 2
        and angles.shape[-1] == 2
        and points.shape in ((angles.shape[-2], 3), (*lead, angles.shape[-2], 3))
    )
    if not fits:
        raise UserError(
            "object points and angles must be (points, 3) and (points, 2), or the same with a "
            f"batch before them, not {points.shape} and {angles.shape}"
        )
    if angles.shape[-2] < 3:
        raise UserError(f"a pose needs at least 3 points, not {angles.shape[-2]}")
    if not angles.size:
        raise UserError("there is no pose to solve: the batch is empty")


def _check_all(ok: BoolArray, what: str, right: str) -> None:
    """Raise about the first (problem, point) that is not `ok`."""
    if not ok.all():
        raise UserError(f"{what}{place(np.argwhere(~ok)[0], len(ok))} {right}")


def _check_adjust(
    mirror_offset: float, adjust: Mapping[str, float], points: int, noise_known: bool
) -> None:
    if not math.isfinite(mirror_offset):
        raise UserError(f"mirror_offset must be finite, not {mirror_offset}")
    for name, prior in adjust.items():
        if name not in INTRINSICS:
            raise UserError(f"no intrinsic is called {name}; {nearest(name, INTRINSICS)}")
        if not prior > 0:
            raise UserError(f"the prior of {name} must be a positive number or inf, not {prior}")
    free = 6 + sum(math.isinf(prior) for prior in adjust.values())
    if 2 * points < free:
        raise UserError(f"{points} points give {2 * points} angles, too few for {free} unknowns")
    if 2 * points == free and len(adjust) > free - 6 and not noise_known:
        raise UserError(
            f"{points} points leave no residuals that tell the noise, so that a prior has no "
            "weight beside them: give std, or more points"
        )


def _deviations(std: ArrayLike | None, shape: tuple[int, ...], batched: bool) -> Array:
    """Standard deviations, shape (batch or 1, 1, points), DAC steps."""
    if std is None:
        return np.ones((1, 1, shape[1]))
    try:
        given = np.broadcast_to(np.asarray(std, float), shape)
    except ValueError:
        raise UserError(
            f"std must have one value a point, {shape if batched else shape[1:]}, "
            f"not {np.shape(std)}"
        ) from None
    _check_all(np.isfinite(given) & (given > 0), "the std", "must be positive")
    return given[:, None, :]


def _least_spread(points: Array) -> Array:
    """Direction in which centred points (..., 3, N) spread least, shape (..., 3).

    Raises
    ------
    UserError
        If they spread in one direction only.
    """
    square, direction = np.linalg.eigh(points @ points.swapaxes(-1, -2))
    line = np.argwhere(~(square[..., 1] > COLLINEAR**2 * square[..., 2]))
    if len(line):
        raise UserError(
            f"the object points{place(line[0], len(points))} lie on one line: "
            "a pose needs points that span a plane"
        )
    return direction[..., 0]
