"""Pose of one view from edges of a part's outline on scan lines.

An edge at e on a line along u, and the outline that the mesh has there at e + t u, leave the
residual -t. Gauss-Newton on the pose with Tukey's weights, whose cutoff shrinks from far beyond the
rough pose's error to a few scales, finds the pose that most edges agree with; edges beyond the last
cutoff are left out, and the rest is solved by least squares, with the covariance ``(J'WJ)^-1``. An
edge errs as the fit of its profile states and, besides, by the mirrors' pointing, alike for all
edges: its variance p^2 is that which makes ``sum r^2 / (std^2 + p^2)`` as large as the degrees of
freedom, and none if the sum is smaller without it. Errors are taken as independent and normal, but
for hysteresis: all lines come out of the part, so that it displaces all edges outwards or inwards,
as a part further away or nearer would, and no residual shows it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sldvexp.errors import UserError
from sldvexp.laser import PartOutline, TwoMirror, steps_of_dac
from sldvexp.lazy import scipy
from sldvexp.lazy import xarray as xr
from sldvexp.pose.least_squares import turned
from sldvexp.statistics import NORMAL_MEDIAN, f_test
from sldvexp.typing import Array, BoolArray

#: Part of the outline's extent in steps within which edges are matched to it.
REACH = 0.35
#: Part of the extent by which edges may lie beside the outline of a part that looks alike.
NEAR = 0.01
#: Tukey's cutoff in scales, how much wider it is at first, how it shrinks.
CUTOFF, WIDER, SHRINKING = 4.7, 30.0, 0.7
#: Steps with shrinking cutoff, then most steps to the least squares.
ROBUST_STEPS, STEPS = 14, 30
#: Relative size of a step that is none, and damping relative to the curvature.
SETTLED, DAMPING = 1e-10, 1e-9
#: Longest step, rad and m: a rough pose is not further away.
LONGEST = 0.1
#: Information in the worst direction, as a part of the best, below which it is undetermined.
UNDETERMINED = 1e-10
#: Edges that make one group of neighbours.
GROUP = 5
#: Least edges that a rough pose must meet; least spread that is not rounding.
LEAST, ROUNDING = 8, 1e-18
#: Standard deviations beyond which an edge is wrong, and the least that is not rounding, steps.
KEPT, ROUNDED = 4.0, 1e-6
#: Standard deviations that an edge counts which the outline of another pose does not cross.
MISSED = 10.0
#: Rounds in which pointing and weights settle, and how closely.
ROUNDS, SETTLED_NOISE = 12, 1e-3


class OutlineEdges(NamedTuple):
    """Edges of one view in angles over the angle of one step.

    Parameters
    ----------
    point, direction : ndarray, shape (N, 2), steps and unit vectors
        Out of the part.
    std : ndarray, shape (N,), steps
    """

    point: Array
    direction: Array
    std: Array

    @classmethod
    def from_dataset(cls, group: xr.Dataset, laser: TwoMirror) -> OutlineEdges:
        """Read the group ``edge/<view>``."""
        position, direction = group["dac"].values, group["direction"].values
        ahead = steps_of_dac(position + direction / 2, laser)
        ahead = ahead - steps_of_dac(position - direction / 2, laser)
        length = np.linalg.norm(ahead, axis=1, keepdims=True)
        std = group["dac_std"].values * length[:, 0]
        return cls(steps_of_dac(position, laser), ahead / length, std)


class OutlineFit(NamedTuple):
    """A pose that fits edges.

    Parameters
    ----------
    rotation : ndarray, shape (3, 3)
        World to laser.
    origin : ndarray, shape (3,), m
    residual : ndarray, shape (N,), steps
        Observed minus predicted along the scan lines; NaN where the outline does not cross them.
    used : ndarray of bool, shape (N,)
    covariance : ndarray, shape (6, 6)
    std : ndarray, shape (N,), steps
        Of the edges, with the pointing.
    pointing : float, steps
        Standard deviation of the mirrors' pointing.
    cost : float
        Sum of the squares of the used residuals over their standard deviations.
    """

    rotation: Array
    origin: Array
    residual: Array
    used: BoolArray
    covariance: Array
    std: Array
    pointing: float
    cost: float

    @property
    def dof(self) -> int:
        """Used edges less unknowns."""
        return int(self.used.sum()) - 6


def fit_outline(
    part: PartOutline, edges: OutlineEdges, laser: TwoMirror, rotation: Array, origin: Array
) -> OutlineFit:
    """Find the pose near a rough one in which the part's outline lies at the edges.

    Raises
    ------
    UserError
        If too few edges meet the outline, or these do not determine the pose.
    """
    reach = REACH * float(np.ptp(edges.point, axis=0).max())
    at, used = _robust(part, edges, laser, (rotation, origin), reach)
    pointing, std = 0.0, edges.std
    for _ in range(ROUNDS):
        at, used = _least_squares(part, edges._replace(std=std), laser, at, used, reach)
        residual, jacobian = _residuals(part, edges, laser, at, reach)
        before, pointing = pointing, _pointing(residual[used], edges.std[used])
        std = np.hypot(edges.std, pointing)
        used = np.isfinite(residual) & (np.abs(residual) < KEPT * np.maximum(std, ROUNDED))
        if abs(pointing - before) <= SETTLED_NOISE * pointing:
            break
    cost = float(np.sum((residual[used] / std[used]) ** 2))
    covariance = _covariance(jacobian[used] / std[used, None])
    return OutlineFit(*at, residual, used, covariance, std, pointing, cost)


def fit_likewise(
    part: PartOutline,
    edges: OutlineEdges,
    laser: TwoMirror,
    start: tuple[Array, Array],
    fit: OutlineFit,
) -> OutlineFit:
    """Find the least squares near another start for the same edges with the same weights.

    Of those that the outline does not cross there, each counts as `MISSED` squared.

    Raises
    ------
    UserError
        If too few edges meet the outline there, or these do not determine the pose.
    """
    reach = REACH * float(np.ptp(edges.point, axis=0).max())
    at, _ = _robust(part, edges, laser, start, reach)
    weighed = edges._replace(std=fit.std)
    at, used = _least_squares(part, weighed, laser, at, fit.used, reach)
    residual, jacobian = _residuals(part, edges, laser, at, reach)
    used = used & np.isfinite(residual)
    cost = float(np.sum((residual[used] / fit.std[used]) ** 2))
    cost += MISSED**2 * float(np.sum(fit.used & ~used))
    covariance = _covariance(jacobian[used] / fit.std[used, None])
    return OutlineFit(*at, residual, used, covariance, fit.std, fit.pointing, cost)


def shows(
    part: PartOutline, edges: OutlineEdges, laser: TwoMirror, at: tuple[Array, Array]
) -> bool:
    """Tell whether the outline lies near the edges from a place, by `NEAR` of its extent."""
    extent = float(np.ptp(edges.point, axis=0).max())
    residual, _ = _residuals(part, edges, laser, at, REACH * extent)
    far = np.where(np.isfinite(residual), np.abs(residual), extent)
    return bool(np.median(far) < NEAR * extent)


def _robust(
    part: PartOutline, edges: OutlineEdges, laser: TwoMirror, at: tuple[Array, Array], reach: float
) -> tuple[tuple[Array, Array], BoolArray]:
    """Find the pose that most edges agree with, and which do.

    Raises
    ------
    UserError
        If too few edges meet the outline.
    """
    used = np.ones(len(edges.std), bool)
    for k in range(ROBUST_STEPS):
        residual, jacobian = _residuals(part, edges, laser, at, reach)
        met = np.isfinite(residual)
        _require_met(met)
        size = np.abs(residual)
        scale = max(float(np.median(size[met])) / NORMAL_MEDIAN, float(np.median(edges.std)))
        cutoff = CUTOFF * scale * max(WIDER * SHRINKING**k, 1.0)
        used = met & (size < cutoff)
        weight = 1 - (size[used] / cutoff) ** 2
        at = _moved(at, _step(weight[:, None] * jacobian[used], weight * residual[used]))
    return at, used


def _least_squares(
    part: PartOutline,
    edges: OutlineEdges,
    laser: TwoMirror,
    at: tuple[Array, Array],
    used: BoolArray,
    reach: float,
) -> tuple[tuple[Array, Array], BoolArray]:
    """Find the least squares of the edges that are used and meet the outline."""
    for _ in range(STEPS):
        residual, jacobian = _residuals(part, edges, laser, at, reach)
        used = used & np.isfinite(residual)
        _require_met(used)
        step = _step(jacobian[used] / edges.std[used, None], residual[used] / edges.std[used])
        at = _moved(at, step)
        if np.abs(step).max() < SETTLED:
            break
    return at, used


def _require_met(met: BoolArray) -> None:
    """Refuse a pose whose outline misses most edges.

    Raises
    ------
    UserError
    """
    if met.sum() < max(LEAST, len(met) // 3):
        raise UserError(
            f"the outline of the part meets {met.sum()} of {len(met)} edges: the rough pose, the "
            "mesh or its unit is wrong, or these are edges of something else"
        )


def _moved(at: tuple[Array, Array], step: Array) -> tuple[Array, Array]:
    """Make a step of rotation and origin."""
    return turned(at[0][None], step[None, :3])[0], at[1] + step[3:]


def _pointing(residual: Array, std: Array) -> float:
    """Estimate the standard deviation that all residuals have besides their own."""
    dof = len(residual) - 6

    def excess(square: float) -> float:
        return float(np.sum(residual**2 / (std**2 + square))) - dof

    if dof <= 0 or excess(0.0) <= 0:
        return 0.0
    return math.sqrt(scipy.optimize.brentq(excess, 0.0, float(np.sum(residual**2)) / dof))


def _residuals(
    part: PartOutline,
    edges: OutlineEdges,
    laser: TwoMirror,
    at: tuple[Array, Array],
    reach: float,
) -> tuple[Array, Array]:
    """Give residuals, NaN without a crossing, and derivatives of the predicted places."""
    found = part.crossings(edges.point, edges.direction, *at, laser, reach)
    nearest = np.argsort(-np.abs(found.along), kind="stable")  # the nearest of each line last
    residual = np.full(len(edges.std), np.nan)
    jacobian = np.zeros((len(edges.std), 6))
    residual[found.line[nearest]] = -found.along[nearest]
    jacobian[found.line[nearest]] = found.jacobian[nearest]
    return residual, jacobian


def _step(rows: Array, right: Array) -> Array:
    """Solve for a Gauss-Newton step; rotations and lengths are alike at a metre or two."""
    matrix = rows.T @ rows
    matrix += DAMPING * np.trace(matrix) * np.eye(6)
    step = np.linalg.solve(matrix, rows.T @ right)
    return np.asarray(step * min(1.0, LONGEST / float(np.abs(step).max() + ROUNDING)))


def of_hysteresis(
    part: PartOutline, edges: OutlineEdges, laser: TwoMirror, fit: OutlineFit, hysteresis: float
) -> Array:
    """Compute what hysteresis, rad, adds to the covariance of a pose, shape (6, 6).

    Half of it, on each mirror that a line moves, is one standard deviation of a shift of all edges.
    """
    reach = REACH * float(np.ptp(edges.point, axis=0).max())
    _, jacobian = _residuals(part, edges, laser, (fit.rotation, fit.origin), reach)
    used, std = fit.used, fit.std[fit.used]
    shift = hysteresis / 2 * np.sum(np.abs(edges.direction[used]) / laser.step, axis=1)
    moved = fit.covariance @ (jacobian[used] / std[:, None]).T @ (shift / std)
    return np.outer(moved, moved)


def _covariance(rows: Array) -> Array:
    """Invert the information.

    Raises
    ------
    UserError
        If it determines no pose.
    """
    value, vector = np.linalg.eigh(rows.T @ rows)
    if value[0] <= UNDETERMINED * value[-1]:
        raise UserError(
            "the edges do not determine the pose: they lie on one line, or on a circle about the "
            "line of sight; lay scan lines across more of the outline"
        )
    return np.asarray((vector / value) @ vector.T)


def lack_of_fit(edges: OutlineEdges, fit: OutlineFit) -> tuple[float, float]:
    """Test whether neighbouring edges lie beside the outline together, as if it were another.

    Edges are sorted around their middle and make groups; the spread of the groups' means is
    compared with the spread within them, ``F = (B / (G - 6)) / (W / (N - G))``.

    Returns
    -------
    ratio, p_value : float
        F, and the probability of a larger one; 1 if there are too few edges.
    """
    own = np.flatnonzero(fit.used)
    away = edges.point[own] - edges.point[own].mean(axis=0)
    order = own[np.argsort(np.arctan2(away[:, 0], away[:, 1]))]
    groups = np.array_split(order, max(len(own) // GROUP, 1))
    between, within = len(groups) - 6, len(own) - len(groups)
    if between < 1 or within < 1:
        return 1.0, 1.0
    relative = fit.residual / fit.std
    means = [relative[g].mean() for g in groups]
    of_means = sum(len(g) * m**2 for g, m in zip(groups, means, strict=True))
    inside = sum(float(np.sum((relative[g] - m) ** 2)) for g, m in zip(groups, means, strict=True))
    ratio = of_means / between / max(inside / within, ROUNDING)
    return float(ratio), float(f_test(ratio, between, within, 0.99).p_value)


def half_turns(position: Array) -> list[Array]:
    """Give half turns about the principal axes of a part, shape (3, 3) each.

    Examples
    --------
    >>> flat = np.array([[2.0, 0, 0], [-2, 0, 0], [0, 1, 0], [0, -1, 0]])
    >>> [np.diag(turn).round().tolist() for turn in half_turns(flat)]
    [[1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]]
    """
    away = position - (position.max(axis=0) + position.min(axis=0)) / 2
    _, _, axes = np.linalg.svd(away, full_matrices=False)
    return [2 * np.outer(a, a) - np.eye(3) for a in axes]


def root_mean_square(values: Array) -> float:
    """Give the root of the mean square."""
    return math.sqrt(float(np.mean(values**2)))
