"""Uncertainty of solved poses: covariance, standard errors and confidence intervals.

With the information ``N = J'J`` of residuals over their standard deviations the covariance is
``s^2 N^-1``, ``s^2 = SSE / dof``; a prior of precision P gives back ``P N^-1`` of a degree of
freedom. Poses are solved about the points' centroid and turned into those about the origin here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sldvexp.geometry import euler_jacobian
from sldvexp.pose.least_squares import Pose, PoseProblem, cross_matrix, linearise, normal_equations
from sldvexp.statistics import student_factor
from sldvexp.typing import Array

#: Information in the worst direction, as a part of the average: nothing but rounding errors below.
UNDETERMINED = 1e-13


class Worth(NamedTuple):
    """Residuals of solved problems, and the uncertainty that they tell.

    Parameters
    ----------
    residual : ndarray, shape (M, 2, N)
        Over their standard deviations.
    dof : ndarray, shape (M,)
        Observations less parameters, and the share of each prior that the angles overrule.
    variance : ndarray, shape (M,)
        Of the unit of noise, estimated; infinite without degrees of freedom.
    cofactor : ndarray, shape (M, parameters, parameters)
        Covariance for a unit of noise.
    undetermined : ndarray, shape (M, parameters)
        Zero but where the information is singular: the parameters' shares in its worst direction,
        which `cofactor` then leaves out.
    """

    residual: Array
    dof: Array
    variance: Array
    cofactor: Array
    undetermined: Array


def worth(problem: PoseProblem, pose: Pose) -> Worth:
    """Evaluate cofactor matrix and variance of solved problems, ``s^2 = SSE / dof``."""
    at = linearise(problem, pose)
    information, _ = normal_equations(problem, pose, at)
    inverse, undetermined = cofactor(information)
    returned = problem.prior_weight**2 * np.einsum("mkk->mk", inverse)[:, 6:]
    dof = at.residual.shape[1] - information.shape[1] + returned.sum(axis=1)
    sse = np.einsum("mk,mk->m", at.residual, at.residual)
    variance = np.where(dof > 0, sse / np.where(dof > 0, dof, 1.0), np.inf)
    residual = at.residual.reshape(problem.recorded.shape)
    return Worth(residual, dof, variance, inverse, undetermined)


def cofactor(information: Array) -> tuple[Array, Array]:
    """Invert information matrices (M, p, p); give shares (M, p) of what is undetermined.

    Scaled to a unit diagonal, since rotations, lengths and gains differ in unit.
    """
    scale = np.sqrt(np.einsum("mkk->mk", information))
    scale = np.where(scale > 0, scale, 1.0)
    value, vector = np.linalg.eigh(information / (scale[:, :, None] * scale[:, None, :]))
    singular = value[:, :1] <= UNDETERMINED
    inverse_value = np.where(value > UNDETERMINED, 1 / np.maximum(value, UNDETERMINED), 0.0)
    part = vector / scale[:, :, None]
    inverse = (part * inverse_value[:, None, :]) @ part.swapaxes(-1, -2)
    return inverse, np.where(singular, np.abs(vector[:, :, 0]), 0.0)


def origin_jacobian(rotation: Array, centre: Array) -> Array:
    """Differentiate (rotation vector, origin) by (rotation vector, centre), shape (..., 6, 6).

    With ``centre = R (centroid - origin)`` a small rotation vector w and displacement d move the
    origin by ``R' (w x centre - d)``.

    Parameters
    ----------
    rotation : ndarray, shape (..., 3, 3)
    centre : ndarray, shape (..., 3), m
    """
    jacobian = np.zeros((*centre.shape[:-1], 6, 6))
    jacobian[..., :3, :3] = np.eye(3)
    inverse = rotation.swapaxes(-1, -2)
    jacobian[..., 3:, :3] = -inverse @ cross_matrix(centre)
    jacobian[..., 3:, 3:] = -inverse
    return jacobian


def about_origin(cofactor: Array, rotation: Array, centre: Array) -> Array:
    """Make the cofactor matrix of (rotation vector, origin) from that of (rotation vector, centre).

    Parameters
    ----------
    cofactor : ndarray, shape (..., parameters, parameters)
        The first six parameters are those above; the others stay as they are.
    rotation, centre : ndarray
        As in `origin_jacobian`.
    """
    transform = np.zeros_like(cofactor)
    np.einsum("...kk->...k", transform)[...] = 1.0
    transform[..., :6, :6] = origin_jacobian(rotation, centre)
    return transform @ cofactor @ transform.swapaxes(-1, -2)


def standard_error(covariance: Array) -> Array:
    """Take the standard errors of the parameters of a covariance, shape (..., parameters).

    Examples
    --------
    >>> standard_error(np.diag([4.0, 9.0]))
    array([2., 3.])
    """
    return np.sqrt(np.einsum("...kk->...k", covariance))


def euler_standard_error(rotation: Array, covariance: Array) -> Array:
    """Give the standard errors of the Euler angles (x-convention), shape (..., 3), rad.

    Parameters
    ----------
    rotation : ndarray, shape (..., 3, 3)
    covariance : ndarray, shape (..., parameters, parameters)
        Its first three parameters are the rotation vector, rad.

    Returns
    -------
    ndarray
        NaN where the covariance is; infinite where it is, and where phi2 is 0 or pi: there the
        angles are not determined.
    """
    by_vector, covariance = euler_jacobian(rotation), covariance[..., :3, :3]
    known = np.isfinite(by_vector) & np.isfinite(covariance)
    known = np.asarray(known.all(axis=(-1, -2)))[..., None]
    nothing = np.where(np.isnan(covariance).any(axis=(-1, -2)), np.nan, np.inf)[..., None]
    by_vector = np.where(known[..., None], by_vector, 0.0)
    covariance = np.where(known[..., None], covariance, 0.0)
    square = np.einsum("...ij,...jk,...ik->...i", by_vector, covariance, by_vector)
    return np.where(known, np.sqrt(square), nothing)


def half_width(error: Array, dof: Array, confidence: float) -> Array:
    """Give half-widths of confidence intervals, Student's t times the standard errors (Eq 5.18).

    Parameters
    ----------
    error : ndarray, shape (..., k)
    dof : ndarray, shape (...)
        Degrees of freedom behind the errors; infinite if they are known.
    confidence : float
        Two-sided level.

    Returns
    -------
    ndarray, shape (..., k), unit of `error`
        Infinite without degrees of freedom: the noise is unknown and cannot be estimated.

    Examples
    --------
    >>> half_width(np.array([[0.1, 0.2]]), np.array([26.0]), 0.95).round(4)
    array([[0.2056, 0.4111]])
    """
    factor = student_factor(confidence, dof)
    return np.where(np.isnan(factor), np.inf, factor)[..., None] * error
