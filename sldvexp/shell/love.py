"""Motion and strain of a thin shell by Love's kinematics, as rows of spline coefficients.

With u0, v0 along the middle surface, w along its normal, curvature k along s and the height z above
the middle, normals stay straight and normal:

    u(z) = (1 + k z) u0 - z w,s      v(z) = v0 - z w,t      w(z) = w.

The displacement's strains at that height are

    e_ss = u0,s + (k w - z w,ss) / (1 + k z)
    e_tt = v0,t - z w,tt
    2 e_st = (v0,s - z w,st) / (1 + k z) + (1 + k z) u0,t - z w,st.

Without the kinematics u, v and w of the face are three fields that have nothing to do with one
another, and their strains are those of the face alone.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.shell.splines import TensorSplines
from sldvexp.typing import Array

#: Strains in the order of their rows: along s, along t, and the tensor's shear.
STRAINS = ("ss", "tt", "st")


@dataclass(frozen=True, eq=False)
class ThinShell:
    """Splines of the middle surface's motion.

    Attributes
    ----------
    bending : TensorSplines
        Of w.
    membrane : TensorSplines
        Of u0 and of v0.
    curvature : float, 1/m
        Of the middle surface, along s.
    """

    bending: TensorSplines
    membrane: TensorSplines
    curvature: float

    @property
    def coefficients(self) -> int:
        """Number of coefficients: those of u0, of v0, then of w."""
        return 2 * self.membrane.count + self.bending.count

    def velocity(
        self, coordinates: Array, height: Array | float, i: int = 0, j: int = 0
    ) -> tuple[Array, Array, Array]:
        """Make the rows of u, v and w at heights above the middle, or of their derivatives.

        Parameters
        ----------
        coordinates : ndarray, shape (point, 2), m
        height : float or ndarray, shape (point,), m
        i, j : int
            How often they are differentiated by s and by t.

        Returns
        -------
        tuple of ndarray, shape (point, coefficient) each, 1/m^(i+j)
        """
        z = np.broadcast_to(height, len(coordinates))[:, None]
        own = self.membrane(coordinates, i, j)
        none = np.zeros_like(own)
        slope_s, slope_t = self.bending(coordinates, i + 1, j), self.bending(coordinates, i, j + 1)
        return (
            np.hstack([(1 + self.curvature * z) * own, none, -z * slope_s]),
            np.hstack([none, own, -z * slope_t]),
            np.hstack([none, none, self.bending(coordinates, i, j)]),
        )

    def velocity_by_height(self, coordinates: Array) -> tuple[Array, Array, Array]:
        """Differentiate the rows of u, v and w by the height, 1/m."""
        own = self.membrane(coordinates)
        none = np.zeros_like(own)
        bending = [-self.bending(coordinates, 1, 0), -self.bending(coordinates, 0, 1)]
        still = np.zeros_like(bending[0])
        return (
            np.hstack([self.curvature * own, none, bending[0]]),
            np.hstack([none, none, bending[1]]),
            np.hstack([none, none, still]),
        )

    def strain(self, coordinates: Array, height: float) -> tuple[Array, Array, Array]:
        """Make the rows of e_ss, e_tt and e_st at a height, per unit of displacement.

        Returns
        -------
        tuple of ndarray, shape (point, coefficient) each, 1/m
        """
        k, z = self.curvature, height
        stretch = 1 + k * z

        def w(i: int, j: int) -> Array:
            return self.bending(coordinates, i, j)

        by_s, by_t = self.membrane(coordinates, 1, 0), self.membrane(coordinates, 0, 1)
        none = np.zeros_like(by_s)
        twist = -z * w(1, 1) * (1 / stretch + 1) / 2
        return (
            np.hstack([by_s, none, (k * w(0, 0) - z * w(2, 0)) / stretch]),
            np.hstack([none, by_t, -z * w(0, 2)]),
            np.hstack([stretch * by_t / 2, by_s / stretch / 2, twist]),
        )

    def penalties(self, length: float | None) -> list[Array]:
        """Make the priors' precisions of w, and of u0 and v0 together, but for their weights.

        Of w the squares of fourth derivatives are integrated. Of fewer derivatives the splines'
        curvature, which strains are made of, is too stiff.

        Parameters
        ----------
        length : float, m, optional
            Over which u0 and v0 vary: ``1 + 2 l^2 |grad|^2 + l^4 |grad grad|^2``, a proper prior
            that shrinks to no motion. Without it squares of their third derivatives are integrated.
        """
        of_w = np.zeros((self.coefficients, self.coefficients))
        of_uv = np.zeros_like(of_w)
        n, own = self.membrane.count, self.membrane
        of_w[2 * n :, 2 * n :] = self.bending.penalty(4)
        if length is None:
            each = own.penalty(3)
        else:
            reach = length / own.unit
            each = own.penalty(0) + 2 * reach**2 * own.penalty(1) + reach**4 * own.penalty(2)
        of_uv[:n, :n] = of_uv[n : 2 * n, n : 2 * n] = each
        return [of_w, of_uv]
