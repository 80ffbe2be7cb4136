"""Motion and strain of a thin shell by Love's kinematics, as rows of spline coefficients.

With u1 = u0 and u2 = v0 along the local axes of the middle surface, w along its normal and the
curvature tensor k, normals stay straight and normal. At the height z above the middle

    V_i = u_i + z (k_ij u_j - w,i)      V_n = w

where f,i is the derivative along t_i, per unit of length. With the turn g of the local axes about
the normal (see `sldvexp.shell.chart`) the displacement changes along the middle surface by

    G_i1 = V_1,i - g_i V_2 + k_i1 w     G_i2 = V_2,i + g_i V_1 + k_i2 w

and along the surface at z, whose lengths are ``1 + z k`` times as long, by ``F = (1 + z k)^-1 G``.
The strain there is its symmetric part. On a surface that bends along s alone

    u(z) = (1 + k z) u0 - z w,s         v(z) = v0 - z w,t
    e_ss = u0,s + (k w - z w,ss) / (1 + k z)
    e_tt = v0,t - z w,tt
    2 e_st = (v0,s - z w,st) / (1 + k z) + (1 + k z) u0,t - z w,st.

Without the kinematics u, v and w of the face are three fields that have nothing to do with one
another, and their strains are those of the face alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.shell.around_holes import NONE, HoleFunctions
from sldvexp.shell.chart import Chart
from sldvexp.shell.linear_form import LinearForm, differentiated, summed
from sldvexp.shell.local_rows import LocalRows
from sldvexp.shell.splines import TensorSplines
from sldvexp.typing import Array

#: Strains in the order of their rows: along s, along t, and the tensor's shear.
STRAINS = ("ss", "tt", "st")
#: Step of differences of the surface's own geometry, in the splines' unit.
STEP = 1e-4


@dataclass(frozen=True, eq=False)
class WallStretch:
    """Stretch of the middle surface of a closed shell; see `sldvexp.shell.least_stretch`.

    Attributes
    ----------
    following : ndarray, shape (2, function, function)
        Coefficients of u0 and v0, in splines of w's own kind, over those of w.
    energy : ndarray, shape (2 function, 2 function)
        Of what u0 and v0 are beside that, in the membrane's splines.
    """

    following: Array
    energy: Array


@dataclass(frozen=True, eq=False)
class ThinShell:
    """Splines of the middle surface's motion.

    Attributes
    ----------
    bending : TensorSplines
        Of w.
    membrane : TensorSplines
        Of u0 and of v0.
    chart : Chart
        Of the middle surface.
    around_holes : HoleFunctions
        What w has beside its splines.
    stretch : WallStretch, optional
        Of a closed shell, whose walls move along themselves as they bend: u0 and v0 follow w, and
        their membrane splines are what they are beside that.
    """

    bending: TensorSplines
    membrane: TensorSplines
    chart: Chart
    around_holes: HoleFunctions = NONE
    stretch: WallStretch | None = None

    @property
    def coefficients(self) -> int:
        """Number of coefficients: those of u0, of v0, then of w and around the holes."""
        return self._splines + self.around_holes.count

    @property
    def of_w(self) -> slice:
        """Coefficients of w."""
        return slice(2 * self.membrane.count, None)

    def w(self, coordinates: Array, i: int = 0, j: int = 0) -> Array:
        """Make rows of a derivative of w by s and t, of the coefficients of w alone."""
        (rows,) = self.rows(coordinates, [LinearForm.of(2, len(coordinates), i, j)])
        return rows[:, self.of_w]

    @property
    def _splines(self) -> int:
        """Number of the splines' coefficients."""
        return 2 * self.membrane.count + self.bending.count

    def velocity(
        self, coordinates: Array, height: Array | float, i: int = 0, j: int = 0
    ) -> tuple[Array, Array, Array]:
        """Make the rows of u, v and w at heights above the middle, or of a first derivative.

        Parameters
        ----------
        coordinates : ndarray, shape (point, 2), m
        height : float or ndarray, shape (point,), m
        i, j : int
            How often they are differentiated by s and by t: once in all, or not.

        Returns
        -------
        tuple of ndarray, shape (point, coefficient) each, 1/m^(i+j)
        """
        one, two, three = self.rows(coordinates, self.motion(coordinates, height, i, j))
        return one, two, three

    def velocity_by_height(self, coordinates: Array) -> tuple[Array, Array, Array]:
        """Differentiate the rows of u, v and w by the height, 1/m."""
        one, two, three = self.rows(coordinates, self.motion_by_height(coordinates))
        return one, two, three

    def strain(self, coordinates: Array, height: float) -> tuple[Array, Array, Array]:
        """Make the rows of e_ss, e_tt and e_st at a height, per unit of displacement.

        Returns
        -------
        tuple of ndarray, shape (point, coefficient) each, 1/m
        """
        ss, tt, st = self.rows(coordinates, self.strains(coordinates, height))
        return ss, tt, st

    def motion(
        self, coordinates: Array, height: Array | float, i: int = 0, j: int = 0
    ) -> list[LinearForm]:
        """Make the forms of u, v and w; see `velocity`."""
        if i + j == 0:
            z = np.broadcast_to(height, len(coordinates))
            own = [LinearForm.of(field, len(coordinates)) for field in range(3)]
            by = self.motion_by_height(coordinates)
            return [here + change * z for here, change in zip(own, by, strict=True)]
        make = partial(self.motion, height=height)
        return differentiated(make, coordinates, j, STEP * self.bending.unit)

    def motion_by_height(self, coordinates: Array) -> list[LinearForm]:
        """Make the forms of the derivatives of u, v and w by the height: how normals turn."""
        count, forms = len(coordinates), self.chart.forms(coordinates)
        own = [LinearForm.of(field, count) for field in range(2)]
        slopes = [LinearForm.of(2, count, 1, 0), LinearForm.of(2, count, 0, 1)]
        turned = [
            summed(
                [own[k] * forms.curvature[:, axis, k] for k in range(2)]
                + [slopes[a] * -forms.rate[:, axis, a] for a in range(2)]
            )
            for axis in range(2)
        ]
        return [*turned, LinearForm({})]

    def strains(self, coordinates: Array, height: float) -> list[LinearForm]:
        """Make the forms of e_ss, e_tt and e_st; see `strain`."""
        forms = self.chart.forms(coordinates)
        v = self.motion(coordinates, height)
        by = [self.motion(coordinates, height, 1, 0), self.motion(coordinates, height, 0, 1)]
        gradient = []
        for i in range(2):
            along = [
                summed([by[a][k] * forms.rate[:, i, a] for a in range(2)])
                + v[2] * forms.curvature[:, i, k]
                for k in range(2)
            ]
            turn = forms.turn[:, i]
            gradient.append([along[0] + v[1] * -turn, along[1] + v[0] * turn])
        shrink = forms.shrink(height)
        f = [
            [summed([gradient[k][j] * shrink[:, i, k] for k in range(2)]) for j in range(2)]
            for i in range(2)
        ]
        return [f[0][0], f[1][1], (f[0][1] + f[1][0]) * 0.5]

    def rows(self, coordinates: Array, forms: Sequence[LinearForm]) -> list[Array]:
        """Make the rows of forms, shape (point, coefficient) each."""
        n, bases = self.membrane.count, self._bases(coordinates, forms)
        places = (slice(0, n), slice(n, 2 * n), slice(2 * n, self._splines))
        singular = self._singular(coordinates, forms)
        found = []
        for form in forms:
            row = np.zeros((len(coordinates), self.coefficients))
            followed = np.zeros((2, len(coordinates), self.bending.count))
            for (field, i, j), factor in form.terms.items():
                row[:, places[field]] += _product(factor, *bases[field, i, j])
                if field == 2:
                    row[:, self._splines :] += factor[:, None] * singular[i, j]
                elif self.stretch is not None:
                    followed[field] += _product(factor, *bases[2, i, j])
            if self.stretch is not None:
                row[:, places[2]] += (followed @ self.stretch.following).sum(axis=0)
            found.append(row)
        return found

    def values(self, theta: Array, coordinates: Array, forms: Sequence[LinearForm]) -> Array:
        """Compute forms of fields with known coefficients.

        Parameters
        ----------
        theta : ndarray, shape (coefficient, column)

        Returns
        -------
        ndarray, shape (point, form, column)
        """
        return LocalRows(self, coordinates).of_forms(theta, forms)

    def _singular(
        self, coordinates: Array, forms: Sequence[LinearForm]
    ) -> dict[tuple[int, int], Array]:
        """Evaluate the functions around holes that the forms have."""
        orders = {(i, j) for form in forms for field, i, j in form.terms if field == 2}
        return {(i, j): self.around_holes(coordinates, i, j) for i, j in orders}

    def _bases(
        self, coordinates: Array, forms: Sequence[LinearForm]
    ) -> dict[tuple[int, int, int], tuple[Array, Array]]:
        """Evaluate the splines along s and t that the forms have."""
        splines = (self.membrane, self.membrane, self.bending)
        known: dict[tuple[bool, int, int], Array] = {}

        def along(field: int, axis: int, order: int) -> Array:
            key = (field == 2, axis, order)
            if key not in known:
                known[key] = splines[field].along(coordinates, axis, order)
            return known[key]

        terms = {term for form in forms for term in form.terms}
        if self.stretch is not None:
            terms |= {(2, i, j) for _, i, j in terms}
        return {(f, i, j): (along(f, 0, i), along(f, 1, j)) for f, i, j in terms}

    def known_precision(self) -> Array:
        """Make the priors' precision that needs no weight, over that of w's own size."""
        return np.diag(np.r_[np.zeros(self._splines), self.around_holes.precision])

    def squares(self) -> Array:
        """Integrate the squares of u0, v0 and w, as a form of the coefficients."""
        own, bending = self.membrane.penalty(0), self.bending.penalty(0)
        around = np.zeros((self.around_holes.count,) * 2)
        return np.asarray(scipy.linalg.block_diag(own, own, bending, around))

    def penalties(self, length: float | None) -> list[Array]:
        """Make the priors' precisions of w, and of u0 and v0 together, but for their weights.

        Of w the squares of fourth derivatives are integrated. Of fewer derivatives the splines'
        curvature, which strains are made of, is too stiff.

        Parameters
        ----------
        length : float, m, optional
            Over which u0 and v0 vary: ``1 + 2 l^2 |grad|^2 + l^4 |grad grad|^2``, a proper prior
            that shrinks to no motion. Of a closed shell it is one of what they are beside following
            w: its square, and ``l^2`` times its energy of stretch. Without a length squares of
            their third derivatives are integrated.
        """
        of_w = np.zeros((self.coefficients, self.coefficients))
        of_uv = np.zeros_like(of_w)
        n, own = self.membrane.count, self.membrane
        of_w[2 * n : self._splines, 2 * n : self._splines] = self.bending.penalty(4)
        if length is None:
            each = own.penalty(3)
        elif self.stretch is not None:
            each = own.penalty(0)
            of_uv[: 2 * n, : 2 * n] = (length / own.unit) ** 2 * self.stretch.energy
        else:
            reach = length / own.unit
            each = own.penalty(0) + 2 * reach**2 * own.penalty(1) + reach**4 * own.penalty(2)
        of_uv[:n, :n] += each
        of_uv[n : 2 * n, n : 2 * n] += each
        return [of_w, of_uv]


def _product(factor: Array, of_s: Array, of_t: Array) -> Array:
    """Multiply splines along s and along t, and a factor of each place, (place, function)."""
    both = (factor[:, None] * of_s)[:, :, None] * of_t[:, None, :]
    return np.asarray(both.reshape(len(factor), -1))
