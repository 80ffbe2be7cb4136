"""Pose of one view from edges of a part's outline on scan lines.

An edge at e on a line along u, and the outline that the mesh has there at e + t u, leave the
residual -t. Gauss-Newton on the pose with Tukey's weights, whose cutoff shrinks from far beyond the
rough pose's error to a few scales, finds the pose that most edges agree with; edges beyond the last
cutoff are left out, and the rest is solved by least squares with the covariance ``s^2 (J'WJ)^-1``.
Errors of edges are taken as independent, normal and as the fits of their profiles state but for one
common factor s.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sldvexp.errors import UserError
from sldvexp.laser import PartOutline, TwoMirror, steps_of_dac
from sldvexp.lazy import xarray as xr
from sldvexp.pose.least_squares import turned
from sldvexp.statistics import f_test
from sldvexp.typing import Array, BoolArray

#: Part of the outline's extent in steps within which edges are matched to it.
REACH = 0.35
#: Tukey's cutoff in scales, how much wider it is at first, how it shrinks.
CUTOFF, WIDER, SHRINKING = 4.7, 30.0, 0.7
#: Steps with shrinking cutoff, then most steps to the least squares.
ROBUST_STEPS, STEPS = 25, 30
#: Median of the absolute value of a standard normal variable.
NORMAL_MEDIAN = 0.6745
#: Relative size of a step that is none, and damping relative to the curvature.
SETTLED, DAMPING = 1e-10, 1e-9
#: Information in the worst direction, as a part of the best, below which it is undetermined.
UNDETERMINED = 1e-10
#: Edges that make one group of neighbours.
GROUP = 5
#: Least scale, steps: rounding.
LEAST_SCALE = 1e-9


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
    cofactor : ndarray, shape (6, 6)
        Covariance for edges that err as stated.
    cost : float
        Sum of the squares of the used residuals over their standard deviations.
    """

    rotation: Array
    origin: Array
    residual: Array
    used: BoolArray
    cofactor: Array
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
    used = np.ones(len(edges.std), bool)
    for k in range(ROBUST_STEPS + STEPS):
        residual, jacobian = _residuals(part, edges, laser, rotation, origin, reach)
        relative = np.abs(residual) / edges.std
        met = np.isfinite(relative)
        if met.sum() < max(8, len(met) // 3):
            raise UserError(
                f"the outline of the part meets {met.sum()} of {len(met)} edges: the rough pose, "
                "the mesh or its unit is wrong, or these are edges of something else"
            )
        if k <= ROBUST_STEPS:
            scale = max(float(np.median(relative[met])) / NORMAL_MEDIAN, LEAST_SCALE)
            cutoff = CUTOFF * scale * max(WIDER * SHRINKING**k, 1.0)
            used = met & (relative < cutoff)
            weight = np.where(used, 1 - (relative / cutoff) ** 2, 0.0)
        else:
            used &= met
            weight = used.astype(float)
        rows = (weight / edges.std)[used, None] * jacobian[used]
        step = _step(rows, (weight / edges.std * residual)[used])
        rotation, origin = turned(rotation[None], step[None, :3])[0], origin + step[3:]
        if k > ROBUST_STEPS and np.abs(step).max() < SETTLED:
            break
    residual, jacobian = _residuals(part, edges, laser, rotation, origin, reach)
    used &= np.isfinite(residual)
    cost = float(np.sum((residual[used] / edges.std[used]) ** 2))
    cofactor = _cofactor(jacobian[used] / edges.std[used, None])
    return OutlineFit(rotation, origin, residual, used, cofactor, cost)


def _residuals(
    part: PartOutline,
    edges: OutlineEdges,
    laser: TwoMirror,
    rotation: Array,
    origin: Array,
    reach: float,
) -> tuple[Array, Array]:
    """Give residuals, NaN without a crossing, and derivatives of the predicted places."""
    found = part.crossings(edges.point, edges.direction, rotation, origin, laser, reach)
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
    return np.asarray(np.linalg.solve(matrix, rows.T @ right))


def _cofactor(rows: Array) -> Array:
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
    relative = fit.residual / edges.std
    means = [relative[g].mean() for g in groups]
    of_means = sum(len(g) * m**2 for g, m in zip(groups, means, strict=True))
    inside = sum(float(np.sum((relative[g] - m) ** 2)) for g, m in zip(groups, means, strict=True))
    ratio = of_means / between / max(inside / within, LEAST_SCALE**2)
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
