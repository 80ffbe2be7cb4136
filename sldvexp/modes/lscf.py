"""Poles of all orders at once: least-squares complex frequency-domain fits with one denominator.

With ``z = exp(-i (w - w_0) T)``, the band being 0.95 of the circle, every response is
``B_o(z) / A(z)``. Multiplied by A that is linear: the numerators are eliminated by the projection
onto powers of z, and A, whose last coefficient is 1, follows from one matrix of products, of which
an order takes a corner. Noise biases such a fit towards small damping; its poles are starts.
"""

from __future__ import annotations

import numpy as np

from sldvexp.modes.compression import PrincipalResponses
from sldvexp.typing import ComplexArray

#: Part of the circle that the band takes.
CIRCLE = 0.95


def poles_by_order(responses: PrincipalResponses, highest: int) -> dict[int, ComplexArray]:
    """Fit denominators of the orders 2 to `highest`.

    Returns
    -------
    dict of int to ndarray of complex, shape (order,), rad/s
        Poles; those without a mode among them.
    """
    omega = responses.omega
    period = 2 * np.pi * CIRCLE / (omega[-1] - omega[0])
    phase = -(omega - omega[0]) * period
    powers = np.exp(1j * np.outer(phase, np.arange(highest + 1)))
    # The values are weighted already, the powers not.
    unitary = np.linalg.qr(responses.weight[:, None] * powers)[0]
    whole = (powers.conj().T * (np.abs(responses.values) ** 2).sum(axis=0)) @ powers
    explained = np.zeros((highest + 1,) * 3, complex)
    for value in responses.values:
        part = unitary.conj().T @ (value[:, None] * powers)
        explained += np.einsum("ka,kb->kab", part.conj(), part)
    explained = np.cumsum(explained, axis=0)
    found = {}
    for order in range(2, highest + 1):
        matrix = whole[: order + 1, : order + 1] - explained[order, : order + 1, : order + 1]
        lower = np.linalg.lstsq(matrix[:order, :order], -matrix[:order, order], rcond=None)[0]
        roots = np.roots(np.append(lower, 1.0)[::-1])
        s = -np.log(roots[roots != 0]) / period
        turn = 2 * np.pi / period
        found[order] = s.real + 1j * (np.mod(s.imag, turn) + omega[0])
    return found
