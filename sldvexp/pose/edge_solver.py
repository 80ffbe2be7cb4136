"""Maximum-likelihood pose from all edge points of a calibration object's circles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.geometry.rotation import rotation_from_vector
from sldvexp.pose.edge_model import ERRORS, EdgePoints, residuals

Array = NDArray[np.float64]

#: Places of the mirror offset, the rim and the circles' errors among the parameters.
OFFSET, RIM, MOVED = 6, 7, 8
#: A step that moves all edges by less, in their standard errors, ends the iteration.
SETTLED = 1e-7
#: Least noise in standard errors: noise-free data must not void what is known beforehand.
LEAST = 1e-4


@dataclass(frozen=True, eq=False)
class EdgePose:
    """Pose of one view from its edge points.

    Parameters
    ----------
    rotation : ndarray, shape (3, 3)
    origin : ndarray, shape (3,), m
    mirror_offset : float, m
    rim : float, m
        By how much every edge is seen outside of its circle.
    covariance : ndarray, shape (8, 8)
        Of the rotation vector, the origin, the mirror offset and the rim; zero for what is fixed.
    residual : ndarray, shape (n,)
        Distance of each edge over its standard error.
    s : float
        Standard deviation of the residuals; `covariance` is for errors larger by it.
    dof : float
    """

    rotation: Array
    origin: Array
    mirror_offset: float
    rim: float
    covariance: Array
    residual: Array
    s: float
    dof: float


def solve_edges(
    points: EdgePoints,
    rotation: Array,
    origin: Array,
    mirror_offset: float,
    offset_std: float,
    circle_std: float,
    max_iterations: int,
    where: str,
) -> EdgePose:
    """Adjust the pose until every edge point lies on its circle as well as its error allows.

    The noise of the edges is estimated; that of the circles themselves (a coordinate measuring
    machine's) enters as errors of each circle's centre and radius with a prior. All edges may be
    seen outside or inside of the circles by one free amount, the rim.

    Parameters
    ----------
    points : EdgePoints
    rotation, origin : ndarray
        Where to start, from the bitangents.
    mirror_offset : float, m
        Nominal.
    offset_std : float, m
        What is known of it: 0 keeps it fixed, infinite leaves it free.
    circle_std : float, m
        Standard deviation of every circle's centre coordinates and diameter.
    max_iterations : int
    where : str
        Names the view in messages.

    Raises
    ------
    UserError
        If the iteration does not settle or the edges do not determine the pose.
    """
    circles = int(points.circle.max()) + 1
    size = MOVED + ERRORS * circles
    prior_std = np.full(size, np.inf)
    prior_std[OFFSET] = offset_std
    prior_std[MOVED:] = np.tile(circle_std * np.array([1.0, 1.0, 1.0, 0.5]), circles)
    free = prior_std > 0
    weight = 1 / prior_std[free] ** 2
    nominal, state, s = mirror_offset, np.zeros(size), 1.0
    dof = len(points.radius) - float(np.count_nonzero(np.isinf(prior_std)))
    if dof < 1:
        raise UserError(f"{where}: {len(points.radius)} edges are too few to determine the pose")
    for _ in range(max_iterations):
        moved = state[MOVED:].reshape(circles, ERRORS)
        residual, jacobian = residuals(
            points, rotation, origin, nominal + state[OFFSET], moved, state[RIM]
        )
        s = max(float(np.sqrt(residual @ residual / dof)), LEAST)
        j = jacobian[:, free] / s
        information = j.T @ j + np.diag(weight)
        gradient = j.T @ residual / s + weight * state[free]
        step = -_solve(information, gradient, where)
        # A prior gives back the share of its parameter that the edges do not overrule.
        share = weight * np.diag(np.linalg.inv(information))
        dof = len(points.radius) - len(weight) + float(share.sum())
        full = np.zeros(size)
        full[free] = step
        rotation, origin = rotation_from_vector(full[:3]) @ rotation, origin + full[3:6]
        state[OFFSET:] += full[OFFSET:]
        if np.linalg.norm(jacobian[:, free] @ step) < SETTLED:
            break
    else:
        raise UserError(f"{where}: the edges gave no pose in {max_iterations} iterations")
    covariance = np.zeros((size, size))
    covariance[np.ix_(free, free)] = np.linalg.inv(information)
    return EdgePose(
        rotation,
        origin,
        nominal + float(state[OFFSET]),
        float(state[RIM]),
        covariance[:MOVED, :MOVED],
        residual,
        s,
        float(dof),
    )


def _solve(information: Array, gradient: Array, where: str) -> Array:
    """Solution of the normal equations, scaled; UserError if they are singular."""
    scale = 1 / np.sqrt(np.diag(information))
    scaled = information * scale[:, None] * scale
    if not np.linalg.cond(scaled) < 1e14:
        raise UserError(
            f"{where}: the edges do not determine the pose; more circles, or some on a second "
            "plane, are needed, or a mirror offset that is known better"
        )
    return scale * np.linalg.solve(scaled, scale * gradient)
