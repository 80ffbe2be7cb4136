"""Principal strains of a cycle: the largest extension over all directions and all moments.

A surface's strain at the moment phi is ``Re(e exp(i phi))``, and along a direction turned by
theta from the first axis, n = (cos theta, sin theta), it is ``n' Re(e exp(i phi)) n``. Its
largest value over phi is the amplitude of one complex number, as a gage in that direction shows:

    max_phi n' Re(e exp(i phi)) n = |n' e n|
    n' e n = m + p cos psi + q sin psi,   m = (e_ss + e_tt)/2,  p = (e_ss - e_tt)/2,  q = e_st

with psi = 2 theta. The first principal strain is the largest of these amplitudes. With
u = exp(i psi) and a = (p - i q)/2, b = (p + i q)/2,

    |n' e n|^2 = |m|^2 + |a|^2 + |b|^2 + 2 Re(c1 u + c2 u^2),  c1 = a m* + m b*,  c2 = a b*,

whose at most two maxima are those of a polynomial of degree two in u; the better one is found on a
grid and made exact by Newton's steps. At the moment of the largest extension the real tensor
``Re(e exp(i phi))`` is diagonal along that direction and across it; the strain across it then is
the second principal strain.

Standard errors are those of the linearised extremes: with z = exp(i phi), F = Re(z n' e n) and the
Hessian H of F by (phi, psi), errors de change the first principal strain by Re(z n' de n) and the
place of the extreme by ``-H^-1 d(grad F)``. An extreme moves towards whatever errors make larger,
and gains by it what the linear part leaves out: ``-g' H^-1 g / 2`` of the gradient's error g where
H is large, and no more than |g| where it is not, as where all directions extend alike. With the
curvature k of either coordinate, the other one following, F is about ``k cos`` of it, so that an
error of `CLEARLY` standard errors s gains

    sqrt(k^2 + (CLEARLY s)^2) - k,

which is added to the standard error by its square. How errors of the real and of the imaginary
part go together is not known here, so that they are added as if they did in the least favourable
way.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sldvexp.typing import Array, ComplexArray

#: Principal strains in their order.
PRINCIPAL = ("first", "second")
#: Directions of the grid, of 2 theta over a turn, and Newton's steps from the best of them.
GRID, STEPS = 12, 6
#: Standard error, deg, of a direction of which nothing is known.
ANY_DIRECTION = 90 / np.sqrt(3)
#: Standard errors by which the largest extension must beat those of quite other directions.
CLEARLY = 2.0


class Principal(NamedTuple):
    """Principal strains of a cycle.

    Attributes
    ----------
    strain : ndarray, shape (place, 2, frequency)
        The largest extension, and the strain across it at the same moment.
    direction : ndarray, shape (place, frequency), deg
        Of the largest extension, from the first axis towards the second, 0 to 180.
    phase : ndarray, shape (place, frequency), rad
        Moment of the largest extension: ``omega t`` of ``exp(i omega t)``.
    """

    strain: Array
    direction: Array
    phase: Array


def principal(strain: ComplexArray) -> Principal:
    """Compute principal strains of a cycle.

    Parameters
    ----------
    strain : ndarray of complex, shape (place, 3, frequency)
        e_ss, e_tt, and the tensor's e_st.

    Examples
    --------
    Tension along 30 degrees with its contraction across:

    >>> import numpy as np
    >>> c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    >>> strain = 2e-6j * np.array([c * c - 0.3 * s * s, s * s - 0.3 * c * c, 1.3 * c * s])
    >>> found = principal(strain[None, :, None])
    >>> (1e6 * found.strain[0, :, 0]).round(6).tolist(), found.direction[0, 0].round(6).item()
    ([2.0, -0.6], 30.0)
    """
    psi = _best_direction(strain)
    along = _along(strain, psi)
    first, phase = np.abs(along), -np.angle(along)
    whole = np.real((strain[:, 0] + strain[:, 1]) * np.exp(1j * phase))
    direction = np.degrees(psi) / 2 % 180
    return Principal(np.stack([first, whole - first], axis=1), direction, phase)


def principal_std(strain: ComplexArray, covariance: Array) -> tuple[Array, Array]:
    """Bound standard errors of the principal strains and of their direction.

    Parameters
    ----------
    strain : ndarray of complex, shape (place, 3, frequency)
    covariance : ndarray, shape (part, place, 3, 3, frequency)
        Of the components, of the real and of the imaginary part.

    Returns
    -------
    strain : ndarray, shape (place, 2, frequency)
    direction : ndarray, shape (place, frequency), deg
        That of an unknown direction where one more than 45 degrees away may be as good.

    Examples
    --------
    >>> import numpy as np
    >>> covariance = np.zeros((2, 1, 3, 3, 1))
    >>> covariance[0, 0, range(3), range(3)] = 1e-16  # 0.01 microstrain, of the real part
    >>> strain = np.array([[[2e-6], [1e-6], [0]]], complex)
    >>> size, direction = principal_std(strain, covariance)
    >>> (1e6 * size[0, :, 0]).round(4).tolist(), direction[0, 0].round(4).item()
    ([0.01, 0.01], 0.573)
    """
    psi = _best_direction(strain)
    along, middle = _along(strain, psi), (strain[:, 0] + strain[:, 1]) / 2
    z, v = np.exp(-1j * np.angle(along)), _row(psi)
    # The Hessian of F by (phi, psi), and errors of F,phi = -Im(z n' e n) and of F,psi: Re(. de).
    phi_phi, psi_psi = -np.abs(along), -np.real(z * (along - middle))
    mixed = -np.imag(z * _along(strain, psi, slope=True))
    determinant = phi_phi * psi_psi - mixed**2
    of_phi, of_psi = 1j * z * v, z * _row(psi, slope=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        moment = (mixed * of_psi - psi_psi * of_phi) / determinant
        turned = (mixed * of_phi - phi_phi * of_psi) / determinant
    whole = np.array([1.0, 1.0, 0.0])[:, None, None]
    across = z * (whole - v) - 2 * np.imag(z * middle) * np.nan_to_num(moment)
    own, direction = _std(z * v, covariance), np.degrees(_std(turned, covariance)) / 2
    # F,psi and its curvature while the moment follows; without any strain there is none to follow.
    follows = np.divide(mixed, phi_phi, out=np.zeros_like(mixed), where=phi_phi < 0)
    by_moment = _gain(-phi_phi, _std(of_phi, covariance))
    by_turning = _gain(follows * mixed - psi_psi, _std(of_psi - follows * of_phi, covariance))
    unsure = np.abs(along) - _elsewhere(strain, psi) < CLEARLY * 2 * own
    known = (direction < ANY_DIRECTION) & ~unsure  # a NaN is not below anything
    linear = np.stack([own, _std(across, covariance)], axis=1)
    std = np.sqrt(linear**2 + (by_moment**2 + by_turning**2)[:, None])
    return std, np.where(known, direction, ANY_DIRECTION)


def _gain(curvature: Array, std: Array) -> Array:
    """Bound what an extreme gains by moving towards an error of its gradient."""
    curvature = np.maximum(curvature, 0.0)  # at a maximum, but for rounding
    return np.asarray(np.hypot(curvature, CLEARLY * std) - curvature)


def _along(strain: ComplexArray, psi: Array, slope: bool = False) -> ComplexArray:
    """Compute strains along directions, n' e n, or their derivatives by psi."""
    m, p = (strain[:, 0] + strain[:, 1]) / 2, (strain[:, 0] - strain[:, 1]) / 2
    c, s = np.cos(psi), np.sin(psi)
    return np.asarray(strain[:, 2] * c - p * s if slope else m + p * c + strain[:, 2] * s)


def _row(psi: Array, slope: bool = False) -> Array:
    """Make the row v of n' e n = v . (e_ss, e_tt, e_st), or its derivative, (3, *psi.shape)."""
    c, s = np.cos(psi), np.sin(psi)
    return np.stack([-s / 2, s / 2, c] if slope else [(1 + c) / 2, (1 - c) / 2, s])


def _best_direction(strain: ComplexArray) -> Array:
    """Find psi of the largest amplitude, shape (place, frequency), by grid and Newton's steps."""
    m, p, q = (strain[:, 0] + strain[:, 1]) / 2, (strain[:, 0] - strain[:, 1]) / 2, strain[:, 2]
    a, b = (p - 1j * q) / 2, (p + 1j * q) / 2
    c1, c2 = a * m.conj() + m * b.conj(), a * b.conj()
    grid = 2 * np.pi * np.arange(GRID)[:, None, None] / GRID
    psi = grid[np.abs(_along(strain, grid)).argmax(axis=0), 0, 0]
    for _ in range(STEPS):
        u = np.exp(1j * psi)
        slope, bend = -np.imag(c1 * u + 2 * c2 * u**2), -np.real(c1 * u + 4 * c2 * u**2)
        psi = psi - np.divide(slope, bend, out=np.zeros_like(psi), where=bend < 0)
    return psi


def _elsewhere(strain: ComplexArray, psi: Array) -> Array:
    """Find the largest amplitude more than 45 degrees away from a direction."""
    away = psi + np.pi * np.linspace(0.5, 1.5, GRID + 1)[:, None, None]
    return np.asarray(np.abs(_along(strain, away)).max(axis=0))


def _std(row: ComplexArray, covariance: Array) -> Array:
    """Bound the standard error of Re(row . e), shape (place, frequency); row (3, *that)."""
    parts = zip((row.real, row.imag), covariance, strict=True)
    variance = [np.einsum("apf,pabf,bpf->pf", r, c, r) for r, c in parts]
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)).sum(axis=0))
