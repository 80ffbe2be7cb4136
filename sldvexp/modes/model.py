"""Model of a velocity response: residues at poles, and what modes beyond the band add.

With ``l_r = -zeta_r w_r + i w_r sqrt(1 - zeta_r^2)`` and time dependence ``exp(+i w t)``

    Y_d(w) = i w sum_r [R_dr / (i w - l_r) + conj(R_dr) / (i w - conj(l_r))] + L_d / (i w) + i w U_d

where R = -i v zeta w_r / w_d: v is the pixel's peak velocity that the mode alone has at resonance.
L (modes below the band) and U (above it) are complex, since the reference may be of another phase
than the force. The model is real-linear in its 2 n + 4 coefficients.
"""

from __future__ import annotations

import numpy as np

from sldvexp.typing import Array, ComplexArray

#: Real coefficients of what lies beyond the band.
BEYOND = 4


def poles_of(natural: Array, damping: Array) -> ComplexArray:
    """Make poles, rad/s, of natural frequencies, rad/s, and damping ratios.

    Examples
    --------
    >>> poles_of(np.array([100.0]), np.array([0.6])).tolist()
    [(-60+80j)]
    """
    return np.asarray(natural * (-damping + 1j * np.sqrt(1 - damping**2)))


def split(complex_rows: ComplexArray) -> Array:
    """Stack real above imaginary parts along the first axis."""
    return np.concatenate([complex_rows.real, complex_rows.imag])


def basis(poles: ComplexArray, omega: Array) -> Array:
    """Make the model's matrix of real columns: Re R, Im R of all modes, then L and U.

    Parameters
    ----------
    poles : ndarray of complex, shape (mode,), rad/s
    omega : ndarray, shape (line,), rad/s

    Returns
    -------
    ndarray, shape (2 line, 2 mode + 4)
        Rows of the real parts, then of the imaginary ones.
    """
    iw = 1j * omega[:, None]
    first, second = iw / (iw - poles), iw / (iw - poles.conj())
    below, above = omega.min() / iw, iw / omega.max()
    columns = [first + second, 1j * (first - second), below, 1j * below, above, 1j * above]
    return split(np.concatenate(columns, axis=1))


def basis_derivatives(poles: ComplexArray, omega: Array) -> Array:
    """Differentiate the columns of each mode by ln w_r and by ln zeta_r.

    Returns
    -------
    ndarray, shape (2, mode, 2 line, 2)
        By which of the two; the mode; rows as of `basis`; its columns Re R and Im R.
    """
    iw = 1j * omega[:, None]
    natural = np.abs(poles)
    damping = -poles.real / natural
    by_damping = natural * damping * (-1 - 1j * damping / np.sqrt(1 - damping**2))
    found = []
    for change in (poles, by_damping):  # of the pole, by ln w_r and ln zeta_r
        first = iw / (iw - poles) ** 2 * change
        second = iw / (iw - poles.conj()) ** 2 * change.conj()
        columns = [split(first + second), split(1j * (first - second))]
        found.append(np.moveaxis(np.stack(columns, axis=-1), 1, 0))
    return np.stack(found)


def velocity_per_residue(poles: ComplexArray) -> ComplexArray:
    """Compute v / R = i w_d / (zeta w_r), s, of each mode."""
    return np.asarray(1j * poles.imag / -poles.real)
