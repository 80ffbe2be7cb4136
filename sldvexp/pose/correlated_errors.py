"""Covariance of poses from points whose errors are not independent.

The image points of one fitted ellipse share its errors; what stands on the object elsewhere than
measured does so for every view. Least squares takes angles as independent, which gives a pose, but
not its bounds: with the normal equations' matrix N, Jacobian J and weights w the estimate errs by
``N^-1 J' w r`` for errors r of the angles and by ``N^-1 P p`` for errors p of what is assumed
beforehand with precision P, so that its covariance is ``G C G' + N^-1 P N^-1``, ``G = N^-1 J' w``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.geometry import skew
from sldvexp.laser import TwoMirror, project, project_jacobian
from sldvexp.lazy import scipy
from sldvexp.pose.base import EXTRINSICS, JointCovariance
from sldvexp.pose.least_squares import INTRINSICS
from sldvexp.pose.solution import PoseSolution
from sldvexp.typing import Array

#: Least noise of solved angles, DAC steps: noise-free data must not void what is known beforehand.
LEAST = 1e-4
#: Information, as a part of the largest, that is but rounding errors: such motions have no bounds.
ROUNDING = 1e-14


@dataclass(frozen=True, eq=False)
class Errors:
    """Sources of the errors of one view's image points.

    Parameters
    ----------
    points : ndarray, shape (N, 3), m
        On the object, in the world.
    of_image : ndarray, shape (2N, 2N), squared DAC steps
        Covariance of their images.
    of_object : ndarray, shape (N, 3, K), m
        Change of the points for one standard deviation of each of the object's errors, which are
        independent of each other and the same in every view.
    std : ndarray, shape (N,), DAC steps, optional
        Standard deviations that the pose was solved with.
    noise_dof : float
        Degrees of freedom behind `of_image`; infinite if it is known.
    """

    view: str
    points: Array
    of_image: Array
    of_object: Array
    std: Array | None = None
    noise_dof: float = np.inf


def with_errors(
    solutions: Sequence[PoseSolution],
    errors: Sequence[Errors],
    laser: TwoMirror,
    adjust: Mapping[str, float],
    shared: Mapping[str, float],
) -> tuple[list[PoseSolution], JointCovariance, list[float]]:
    """Give the same poses the covariance that follows from their errors' origins.

    Parameters
    ----------
    solutions : sequence of PoseSolution
        Of all views.
    adjust, shared : mapping of str to float
        Intrinsics adjusted for each view and for all views, with the standard deviations of their
        priors.

    Returns
    -------
    solutions : list of PoseSolution
        Their covariance is known, not estimated from the residuals.
    joint : JointCovariance
        Of all views.
    probability : list of float
        For each view, of residuals as large, if there are no other errors.
    """
    joint = JointCovariance([e.view for e in errors], [*adjust], [*shared], np.empty((0, 0)))
    jacobians = [_jacobians(s, e, laser, joint) for s, e in zip(solutions, errors, strict=True)]
    jacobian = _arrow([by_unknown for by_unknown, _ in jacobians], len(shared))
    by_object = np.concatenate([by_object for _, by_object in jacobians])
    weight = np.concatenate([_weight(s, e) for s, e in zip(solutions, errors, strict=True)])
    of_angles = scipy.linalg.block_diag(*(e.of_image for e in errors)) + by_object @ by_object.T

    each = [*np.zeros(len(EXTRINSICS)), *(std**-2.0 for std in adjust.values())]
    prior = np.diag([*each * len(errors), *(std**-2.0 for std in shared.values())])
    inverse = _inverse(jacobian.T @ (weight[:, None] * jacobian) + prior)
    gain = inverse @ jacobian.T * weight
    of_prior = inverse @ prior @ inverse
    covariance = gain @ of_angles @ gain.T + of_prior

    left = np.eye(len(weight)) - jacobian @ gain
    of_residual = left @ of_angles @ left.T + jacobian @ of_prior @ jacobian.T
    joint = replace(joint, matrix=covariance)
    known = [
        replace(solution, covariance=own, noise_known=True, noise_dof=e.noise_dof)
        for solution, own, e in zip(solutions, joint.of_views(), errors, strict=True)
    ]
    return known, joint, _probabilities(solutions, of_residual)


def _jacobians(
    solution: PoseSolution, errors: Errors, laser: TwoMirror, joint: JointCovariance
) -> tuple[Array, Array]:
    """Differentiate the recorded angles, DAC steps, by the unknowns and the object's errors."""
    offset = solution.intrinsics["mirror_offset"]
    in_laser = (errors.points - solution.origin) @ solution.rotation.T
    angle = project(in_laser, offset)
    by_point, by_offset = project_jacobian(in_laser, offset)
    # A small rotation moves a point P by w x P, a displaced origin by -R dO.
    by_rotation = np.einsum("nij,njk->nik", by_point, -skew(in_laser))
    by_origin = -by_point @ solution.rotation
    intrinsics = [_by_intrinsic(name, angle, by_offset)[..., None] for name in joint.adjusted]
    by_unknown = np.concatenate([by_rotation, by_origin, *intrinsics], axis=-1)
    by_object = np.einsum(
        "nij,jk,nkc->nic", by_point, solution.rotation, errors.of_object, optimize=True
    )
    rows, step = angle.size, laser.step[:, None]
    return (by_unknown / step).reshape(rows, -1), (by_object / step).reshape(rows, -1)


def _by_intrinsic(name: str, angle: Array, by_offset: Array) -> Array:
    """Differentiate recorded angles, (angle - zero) / gain, by an intrinsic near its nominal."""
    if name == INTRINSICS[0]:
        return by_offset
    what, _, mirror = name.partition("_")
    column = ("up_down", "left_right").index(mirror)
    change = np.zeros_like(angle)
    change[:, column] = -angle[:, column] if what == "gain" else -1.0
    return change


def _arrow(jacobians: Sequence[Array], shared: int) -> Array:
    """Join the Jacobians of all views: own unknowns side by side, the shared ones last."""
    own = scipy.linalg.block_diag(*(j[:, : j.shape[1] - shared] for j in jacobians))
    return np.hstack([own, np.concatenate([j[:, j.shape[1] - shared :] for j in jacobians])])


def _weight(solution: PoseSolution, errors: Errors) -> Array:
    """Weigh by the standard deviations that the pose was solved with, squared, shape (2N,)."""
    if errors.std is None:
        s = max(float(solution.s), LEAST) if np.isfinite(solution.s) else 1.0
        return np.full(2 * len(errors.points), s**-2.0)
    return np.repeat(errors.std**-2.0, 2)


def _inverse(information: Array) -> Array:
    """Invert a positive matrix whose unknowns differ in unit."""
    scale = 1 / np.sqrt(np.diag(information))
    scaled = information * scale[:, None] * scale
    return np.asarray(np.linalg.pinv(scaled, ROUNDING, hermitian=True) * scale[:, None] * scale)


def _probabilities(solutions: Sequence[PoseSolution], covariance: Array) -> list[float]:
    """Give the probability of larger sums of squares of correlated normal residuals.

    After Satterthwaite: the sum is taken for a multiple of chi-squared with the same mean and
    variance, ``tr C`` and ``2 tr C^2``.
    """
    ends = np.cumsum([s.residual.size for s in solutions])
    found = []
    for solution, end in zip(solutions, ends, strict=True):
        own = slice(end - solution.residual.size, end)
        residual, block = solution.residual.ravel(), covariance[own, own]
        expected = np.trace(block)
        if solution.dof <= 0:
            found.append(1.0)
            continue
        dof = expected**2 / np.sum(block**2)
        found.append(float(scipy.special.chdtrc(dof, dof * residual @ residual / expected)))
    return found
