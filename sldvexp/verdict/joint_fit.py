"""Joint fit of a smooth field and of the poses to the pixels of all views, and tests upon it.

``y_k = A_k m + G_k(m) p + e``: whitened pixels of view k, the field's coefficients m, and errors p
of the poses (and of the surface's height) with the prior ``p ~ N(0, L L')`` that all frequencies
share; G is the derivative of the prediction, because beams meet the surface elsewhere and from
another direction. With the residuals ``r = y - A m0`` of the plain fit, ``H = A (A'A)^-1 A'``,
``I = G'(1 - H) G``, ``b = G'r``, ``p = L z``, ``J = L'I L`` and ``c = L'b``

    z = (1 + J)^-1 c,   m = m0 - (A'A)^-1 A'G p,   T = r'r - c'(1 + J)^-1 c,

and T is a chi-square. Columns X of any alteration are tested by their score, the poses integrated:

    I_x = X'(1 - H)X - (X'(1 - H)G) L (1 + J)^-1 L' (..)',   b_x = X'r - (..) L z,

``b_x' I_x^-1 b_x`` is a chi-square of as many degrees as X has independent columns, and
``I_x^-1 b_x`` estimates the alteration. Residuals must be those of the plain fit, which are
orthogonal to A. Designs are taken again at the estimated poses (`relinearised`): G(m) p times the
noise of m is bilinear, and tests at the stated poses would reject too much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IndexArray
from sldvexp.verdict.beams import PixelBeams
from sldvexp.verdict.explanation import POSE
from sldvexp.verdict.pixel_data import PixelData
from sldvexp.verdict.smooth_field import SmoothField

#: Ridge of the normal matrix over its mean diagonal, for functions that no pixel determines.
RIDGE = 1e-9
#: Information of a combination of columns, over the largest, below which it is not there.
NOTHING = 1e-9


@dataclass(frozen=True, eq=False)
class PixelDesign:
    """Design of one view at one pose.

    Attributes
    ----------
    present : ndarray of bool, shape (pixel,)
        Pixels of the data whose beams meet the surface from this pose.
    field : ndarray, shape (present, 3 function)
        A_k: component by component.
    """

    present: BoolArray
    field: Array
    beams: PixelBeams
    basis: Array
    slopes: list[tuple[Array, Array]]
    weight: Array

    @classmethod
    def of(cls, data: PixelData, beams: PixelBeams, smooth: SmoothField) -> PixelDesign:
        """Evaluate a smooth field where the beams of some of a view's pixels meet the surface."""
        present = np.isin(data.pixel, beams.pixel)
        (basis, slopes), weight = smooth.evaluate(beams.point), data.weight[present]
        field = np.hstack([(weight * d)[:, None] * basis for d in beams.direction.T])
        return cls(present, field, beams, basis, slopes, weight)

    @cached_property
    def normal(self) -> Array:
        """Normal matrix ``A_k' A_k``."""
        return self.field.T @ self.field

    def pose_columns(self, m: Array) -> Array:
        """Differentiate the prediction by pose and height, shape (present, 6 + 1, channel).

        Parameters
        ----------
        m : ndarray, shape (3 function, channel)
        """
        present, channels = len(self.weight), m.shape[-1]
        by_function = m.reshape(3, -1, channels).transpose(1, 0, 2).reshape(-1, 3 * channels)
        field = np.empty((present, 3 + len(self.slopes), channels))
        field[:, :3] = (self.basis @ by_function).reshape(present, 3, channels)
        for k, (_, slope) in enumerate(self.slopes, 3):
            change = (slope @ by_function).reshape(present, 3, channels)
            field[:, k] = np.einsum("ni,nic->nc", self.beams.direction, change)
        return np.asarray(self._by_field @ field)

    @cached_property
    def _by_field(self) -> Array:
        """Weights of the field's velocity and of its slopes in `pose_columns`.

        Shape (present, 6 + 1, 3 + slope): the velocity counts as the direction turns, the slope of
        what is seen along an axis as the point moves along that.
        """
        beams = self.beams
        found = np.zeros((len(self.weight), POSE + 1, 3 + len(self.slopes)))
        found[:, :POSE, :3] = beams.direction_by_pose.transpose(0, 2, 1)
        for k, (axis, _) in enumerate(self.slopes, 3):
            found[:, :POSE, k] = np.einsum("i,nip->np", axis, beams.point_by_pose)
            found[:, POSE, k] = beams.point_by_height @ axis
        return found * self.weight[:, None, None]


class Score(NamedTuple):
    """Test of columns that are added to the model.

    Attributes
    ----------
    statistic : float
        A chi-square of `dof` degrees of freedom if the columns are not needed.
    estimate : ndarray, shape (column,)
    information : ndarray, shape (column, column)
        Inverse covariance of the estimate.
    """

    statistic: float
    dof: int
    estimate: Array
    information: Array


class JointFit:
    """Fit of all views, or of some; see the module.

    Parameters
    ----------
    data, designs : sequence
        Of all views.
    prior : ndarray, shape (6 view + 1, any)
        L, a factor of the covariance of the poses' errors and of the height's.
    offset : ndarray, shape (6 view + 1,), optional
        Poses' errors that the designs are taken at.
    standard : ndarray, optional
        `offset` in standard deviations of the prior, ``offset = L standard``.
    views : sequence of int, optional
        Those that have a say; all without it.
    factor : dict of int to float
        What a view's prediction is multiplied by.
    velocity : dict of int to ndarray
        Velocities that take the place of a view's own.
    """

    def __init__(
        self,
        data: Sequence[PixelData],
        designs: Sequence[PixelDesign],
        prior: Array,
        standard: Array | None = None,
        views: Sequence[int] | None = None,
        factor: dict[int, float] | None = None,
        velocity: dict[int, Array] | None = None,
    ) -> None:
        self.data, self.designs, self.prior = data, designs, prior
        self.views = list(range(len(data)) if views is None else views)
        self.standard = np.zeros(prior.shape[1]) if standard is None else standard
        self.factor = factor or {}
        self._velocity = velocity or {}
        self._solve()

    def velocity(self, k: int) -> Array:
        """Give a view's whitened velocities, shape (present, channel): real, then imaginary."""
        values = self._velocity.get(k, self.data[k].velocity)[self.designs[k].present]
        return np.concatenate([values.real, values.imag], axis=1)

    def field(self, k: int) -> Array:
        """Give the design A_k of a view, with its factor."""
        of = self.designs[k].field
        return of * self.factor[k] if k in self.factor else of

    def _solve(self) -> None:
        """Solve for field and poses."""
        a = {k: self.field(k) for k in self.views}
        y = {k: self.velocity(k) for k in self.views}
        each = [self.factor.get(k, 1.0) ** 2 * self.designs[k].normal for k in self.views]
        self._normal = np.sum(each, axis=0)
        ridge = RIDGE * np.trace(self._normal) / len(self._normal)
        self._factor = scipy.linalg.cho_factor(
            self._normal + ridge * np.eye(len(self._normal)), overwrite_a=True, check_finite=False
        )
        plain = self._inverse(np.sum([a[k].T @ y[k] for k in self.views], axis=0))
        self.residual = {k: y[k] - a[k] @ plain for k in self.views}
        self.m = plain
        for _ in range(2):  # once to have a field, once with the poses taken out of it
            self.columns = {k: self._pose_columns(k) for k in self.views}
            self._solve_poses(a)
            self.m = plain - self._inverse(self._across @ self.shift)

    def _pose_columns(self, k: int) -> Array:
        """Differentiate a view's prediction by its pose and the height, (present, 7, channel)."""
        return self.factor.get(k, 1.0) * self.designs[k].pose_columns(self.m)

    def places(self, k: int) -> IndexArray:
        """Find a view's pose and the height among all errors."""
        return np.append(np.arange(POSE * k, POSE * (k + 1)), len(self.prior) - 1)

    def _solve_poses(self, a: dict[int, Array]) -> None:
        """Solve for the poses' errors."""
        count = len(self.prior)
        self._across = np.zeros((len(self.m), self.channels, count))
        information, b = np.zeros((count, count)), np.zeros(count)
        for k in self.views:
            of, own = self.places(k), self.columns[k]
            self._across[..., of] += _across(a[k], own)
            information[np.ix_(of, of)] += _inner(own, own)
            b[of] += _against(own, self.residual[k])
        # (A'A)^-1 = U^-1 U^-T: half of the inverse on both sides.
        half = self._half_inverse(self._across)
        self.information = information - half.T @ half
        c = self.prior.T @ b - self.standard
        j = self.prior.T @ self.information @ self.prior
        self.posterior = np.linalg.inv(np.eye(len(j)) + j)
        self.step = self.posterior @ c
        self.shift = self.prior @ self.step
        self._explained = float(c @ self.step)

    def _inverse(self, right: Array) -> Array:
        """Apply ``(A'A)^-1`` along the first axis."""
        flat = scipy.linalg.cho_solve(
            self._factor, right.reshape(len(right), -1), check_finite=False
        )
        return np.asarray(flat).reshape(right.shape)

    def _half_inverse(self, right: Array) -> Array:
        """Apply ``U^-T`` of ``A'A = U'U`` along the first axis, all rows before the last one."""
        upper, _ = self._factor
        flat = scipy.linalg.solve_triangular(
            upper, right.reshape(len(right), -1), trans="T", check_finite=False
        )
        return np.asarray(flat).reshape(-1, right.shape[-1])

    @property
    def poses(self) -> Array:
        """Estimated errors of the poses and of the height, shape (6 view + 1,)."""
        return np.asarray(self.prior @ (self.standard + self.step))

    @property
    def covariance(self) -> Array:
        """Of these estimates."""
        return np.asarray(self.prior @ self.posterior @ self.prior.T)

    @property
    def squares(self) -> float:
        """T, a chi-square of `dof` degrees of freedom: misfit of the pixels and of the poses."""
        plain = sum(float(np.vdot(r, r)) for r in self.residual.values())
        return float(self.standard @ self.standard) + plain - self._explained

    @property
    def channels(self) -> int:
        """Real numbers of a pixel."""
        return next(iter(self.residual.values())).shape[1]

    @property
    def count(self) -> int:
        """Pixels of all views that have a say."""
        return sum(len(r) for r in self.residual.values())

    @cached_property
    def dof(self) -> int:
        """Degrees of freedom of `squares`."""
        unknowns = round(np.trace(self._inverse(self._normal)))
        return int(self.channels * (self.count - unknowns))

    def determined_by(self, k: int) -> float:
        """Count the field's numbers that a view determines, out of all that the views do."""
        normal = self.factor.get(k, 1.0) ** 2 * self.designs[k].normal
        return float(self.channels * np.trace(self._inverse(normal)))

    def left(self, k: int) -> Array:
        """Give what field and pose leave of a view, shape (present, channel)."""
        found = self.velocity(k) - self.predicted(k)
        return found - np.einsum("nqc,q->nc", self.columns[k], self.shift[self.places(k)])

    def predicted(self, k: int) -> Array:
        """Predict a view, also one that has no say, shape (present, channel)."""
        return np.asarray(self.field(k) @ self.m)

    def prediction_variance(self, k: int) -> Array:
        """Tell how far a view that has no say may lie from its prediction, (present, channel).

        ``1 + A_k (A'A)^-1 A_k' + (G_k - A_k (A'A)^-1 A'G) C (..)'`` of white noise, C the
        covariance of the poses.
        """
        a = self.field(k)
        moves = -np.tensordot(a, self._inverse(self._across), axes=1)
        moves[..., self.places(k)] += self._pose_columns(k).transpose(0, 2, 1)
        of_field = np.einsum("nm,mn->n", a, self._inverse(a.T))
        of_poses = np.sum((moves @ self.covariance) * moves, axis=-1)
        return np.asarray(1 + of_field[:, None] + of_poses)

    def factor_columns(self, k: int) -> Array:
        """Give columns of a view's gain and phase, shape (present, 2, channel)."""
        predicted = self.predicted(k)
        return np.stack([predicted, times_i(predicted)], axis=1)

    def own_pose_columns(self, k: int) -> Array:
        """Give columns of an error of a view's pose that its prior does not know of."""
        return self.columns[k][:, :POSE]

    def score(self, k: int, columns: Array, least: float = NOTHING) -> Score:
        """Test columns that are added to the model of one view.

        Parameters
        ----------
        columns : ndarray, shape (present, column, channel)
        least : float
            Combinations of columns with less information than this part of the largest, or less
            than `least` in all, are not tested.
        """
        across = _across(self.field(k), columns)
        solved = self._inverse(across)
        information = _inner(columns, columns) - _inner_across(across, solved)
        b = _against(columns, self.residual[k])
        with_poses = -_inner_across(self._across, solved)
        with_poses[self.places(k)] += _inner(self.columns[k], columns)
        with_poses = self.prior.T @ with_poses
        information = information - with_poses.T @ self.posterior @ with_poses
        b = b - with_poses.T @ self.step
        return _score(information, b, least)


def _score(information: Array, b: Array, least: float) -> Score:
    """Solve for the alteration where there is information."""
    scale = np.sqrt(np.maximum(np.diag(information), np.finfo(float).tiny))
    values, vectors = np.linalg.eigh(information / np.outer(scale, scale))
    there = values > least * max(values.max(), np.finfo(float).tiny)
    along = vectors[:, there].T @ (b / scale)
    estimate = vectors[:, there] @ (along / values[there]) / scale
    return Score(float((along**2 / values[there]).sum()), int(there.sum()), estimate, information)


def times_i(values: Array) -> Array:
    """Multiply channels, real then imaginary, by the imaginary unit."""
    real, imaginary = np.split(values, 2, axis=-1)
    return np.concatenate([-imaginary, real], axis=-1)


def _across(a: Array, columns: Array) -> Array:
    """Compute ``A' X``, shape (function, channel, column)."""
    pixels, count, channels = columns.shape
    found = a.T @ columns.reshape(pixels, count * channels)
    return np.asarray(found).reshape(a.shape[1], count, channels).transpose(0, 2, 1)


def _inner(x: Array, z: Array) -> Array:
    """Compute ``X' Z`` of columns, shape (pixel, column, channel)."""
    rows = _rows(x)
    return np.asarray(rows @ (rows if z is x else _rows(z)).T)


def _rows(columns: Array) -> Array:
    """Lay out columns, shape (pixel, column, channel), as rows of all numbers."""
    return columns.transpose(1, 0, 2).reshape(columns.shape[1], -1)


def _inner_across(x: Array, z: Array) -> Array:
    """Compute ``X' Z`` of arrays of shape (function, channel, column)."""
    return x.reshape(-1, x.shape[-1]).T @ z.reshape(-1, z.shape[-1])


def _against(columns: Array, values: Array) -> Array:
    """Multiply columns, shape (pixel, column, channel), by values, shape (pixel, channel)."""
    return np.asarray(_rows(columns) @ values.ravel())
