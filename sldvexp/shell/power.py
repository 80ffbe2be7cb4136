"""Flow of power in a plate: structural intensity, its bound, and what leaves a window.

The power that a bending wave carries through a line of unit length, averaged over a period, is with
the displacement xi and the velocity V = i omega xi (Noiseux 1970, Pavic 1976)

    I_s = D/2 Re( (1 + i eta) ((lap xi),s V* - (xi,ss + nu xi,tt) V,s* - (1 - nu) xi,st V,t*) )

and with s and t exchanged along t, with the material's loss factor eta. Of a window with the weight
phi, 1 in its middle and 0 on its rim, as in `sldvexp.shell.forces`, there leaves

    P = - integral of I . grad phi,

a mean of what flows out through rims of all sizes. That is what forces inside put in, times phi,
less what damping takes there,

    eta omega D/2 (|xi,ss|^2 + |xi,tt|^2 + 2 nu Re(xi,ss xi,tt*) + 2 (1 - nu) |xi,st|^2)

a unit of area. A standing wave without damping carries none: I is made of differences in phase.

Of V = a + i b all are sums of products of a functional of a or b and another; errors of a and of b
go into the bounds to first order, each part by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial

from sldvexp.shell.estimate import SurfaceField
from sldvexp.typing import Array

#: Gauss points along each side of a window.
POINTS = 24
#: Part of a window's half side within which its weight is 1, and how it falls beyond.
FLAT, FALL = 0.4, 140 * Polynomial([0, 1]) ** 3 * Polynomial([1, -1]) ** 3


@dataclass(frozen=True, eq=False)
class PowerFlow:
    """Power through lines or out of areas at one frequency.

    Attributes
    ----------
    power : ndarray, shape (any,), W or W/m
    std : ndarray, shape (any,)
    """

    power: Array
    std: Array


def intensity(found: SurfaceField, places: Array, line: int, loss_factor: float) -> PowerFlow:
    """Compute the intensity along s and t, shape (place, 2), W/m.

    Parameters
    ----------
    places : ndarray, shape (place, 2), m
    line : int
        Which of the field's frequencies.
    loss_factor : float
    """
    normals = np.eye(2)
    each = [
        _through(found, places, np.tile(n, (len(places), 1)), line, loss_factor) for n in normals
    ]
    both = [_bounded(found, rows, line) for rows in each]
    return PowerFlow(
        np.stack([f.power for f in both], axis=-1), np.stack([f.std for f in both], axis=-1)
    )


def leaving(
    found: SurfaceField, places: Array, sides: Array, line: int, loss_factor: float
) -> PowerFlow:
    """Compute the power that leaves windows, shape (place,), W.

    Parameters
    ----------
    places : ndarray, shape (place, 2), m
        Their middles.
    sides : ndarray, shape (2,), m
    """
    at, share = _inside(sides)
    s, t = (2 * at / sides).T
    (in_s, by_s), (in_t, by_t) = _window(s), _window(t)
    falls = -np.stack([by_s * in_t, in_s * by_t], axis=1) * 2 / sides
    rows = [_through(found, place + at, falls, line, loss_factor) for place in places]
    power, by_real, by_imaginary = (np.stack([share @ r[i] for r in rows]) for i in range(3))
    return _bounded(found, (power, by_real, by_imaginary), line)


def dissipated(
    found: SurfaceField, places: Array, sides: Array, line: int, loss_factor: float
) -> Array:
    """Compute the power that damping takes in windows, shape (place,), W."""
    sheet = found.material
    assert sheet is not None
    omega = _omega(found, line)
    around, share = _inside(sides)
    share = share * _window(2 * around / sides)[0].prod(axis=1)
    w, theta = found.fit.shell.bending, _of_w(found, line)
    taken = []
    for place in places:
        at = place + around
        ss, tt, st = (w(at, *d) @ theta for d in ((2, 0), (0, 2), (1, 1)))
        energy = np.abs(ss) ** 2 + np.abs(tt) ** 2 + 2 * sheet.nu * (ss * tt.conj()).real
        taken.append(share @ (energy + 2 * (1 - sheet.nu) * np.abs(st) ** 2))
    return loss_factor * sheet.bending_stiffness / (2 * omega) * np.array(taken)


def _window(x: Array) -> tuple[Array, Array]:
    """Evaluate a weight from -1 to 1 and its derivative: 1 up to `FLAT`, 0 with 3 slopes at 1."""
    fall = np.clip((np.abs(x) - FLAT) / (1 - FLAT), 0.0, 1.0)
    value, slope = 1 - FALL.integ()(fall), -FALL(fall)
    return value, slope * np.sign(x) / (1 - FLAT)


def _inside(sides: Array) -> tuple[Array, Array]:
    """Lay Gauss points over a rectangle around 0; their areas."""
    node, weight = np.polynomial.legendre.leggauss(POINTS)
    at = np.stack(np.meshgrid(node, node, indexing="ij"), axis=-1).reshape(-1, 2) * sides / 2
    return at, np.outer(weight, weight).ravel() * sides.prod() / 4


def fed(found: SurfaceField, places: Array, force: Array, line: int) -> PowerFlow:
    """Compute the power ``1/2 Re(F V*)`` that forces along the normal put in, shape (place,), W.

    Parameters
    ----------
    places : ndarray, shape (place, 2), m
    force : ndarray of complex, shape (place,), N
    """
    values, own, others = found.fit.evaluate(
        np.stack(found.fit.shell.velocity(places, found.fit.face))[2]
    )
    variance = (own + others)[..., line]
    power = 0.5 * (force * values[:, line].conj()).real
    std = 0.5 * np.sqrt(force.real**2 * variance[0] + force.imag**2 * variance[1])
    return PowerFlow(power, std)


def _omega(found: SurfaceField, line: int) -> float:
    assert found.frequency is not None
    return 2 * np.pi * float(found.frequency[line])


def _of_w(found: SurfaceField, line: int) -> Array:
    """Coefficients of w at one frequency, complex, m/s."""
    theta = found.fit.columns.combined(found.fit.posterior.mean())[:, line]
    return np.asarray(theta[2 * found.fit.shell.membrane.count :])


def _through(
    found: SurfaceField, places: Array, normals: Array, line: int, loss_factor: float
) -> tuple[Array, Array, Array]:
    """Compute the power through lines across normals, W/m, and its gradients by a and by b.

    Returns
    -------
    power : ndarray, shape (place,)
    by_real, by_imaginary : ndarray, shape (place, coefficient of w)
    """
    sheet, w = found.material, found.fit.shell.bending
    assert sheet is not None
    theta = _of_w(found, line)
    (n_s, n_t), nu = normals.T[..., None], sheet.nu
    ss, st, tt = w(places, 2, 0), w(places, 1, 1), w(places, 0, 2)
    shear = n_s * (w(places, 3, 0) + w(places, 1, 2)) + n_t * (w(places, 2, 1) + w(places, 0, 3))
    # (lap xi),n against V, and the two moments against the slopes that they turn
    pairs = (
        (shear, w(places)),
        (-n_s * (ss + nu * tt) - n_t * (1 - nu) * st, w(places, 1, 0)),
        (-n_t * (tt + nu * ss) - n_s * (1 - nu) * st, w(places, 0, 1)),
    )
    factor = sheet.bending_stiffness / (2 * _omega(found, line))
    power = np.zeros(len(places))
    by_real, by_imaginary = np.zeros((2, len(places), w.count))
    for x, v in pairs:
        xa, xb = (x @ theta).real[:, None], (x @ theta).imag[:, None]
        va, vb = (v @ theta).real[:, None], (v @ theta).imag[:, None]
        power += (xb * va - xa * vb + loss_factor * (xa * va + xb * vb))[:, 0]
        by_real += xb * v - vb * x + loss_factor * (va * x + xa * v)
        by_imaginary += va * x - xa * v + loss_factor * (vb * x + xb * v)
    return factor * power, factor * by_real, factor * by_imaginary


def _bounded(found: SurfaceField, rows: tuple[Array, Array, Array], line: int) -> PowerFlow:
    """Bound power by its gradients."""
    power, *gradients = rows
    none = np.zeros((len(power), 2 * found.fit.shell.membrane.count))
    variance = np.zeros(len(power))
    for part, gradient in enumerate(gradients):
        size = max(float(np.abs(gradient).max(initial=0.0)), 1e-300)
        _, own, others = found.fit.evaluate(np.hstack([none, gradient / size]))
        variance = variance + size**2 * (own + others)[part, :, line]
    return PowerFlow(power, np.sqrt(variance))
