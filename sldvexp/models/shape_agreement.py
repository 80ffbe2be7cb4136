"""Test of a model's mode shape at pixels of known noise, poses with their covariance.

The measured modal velocities a of one mode have the standard error s per part at each pixel, the
model predicts P up to one complex factor alpha. If the shape is right,

    T = min over alpha, delta of  sum |a - (P + G delta) alpha|^2 / s^2 + delta' C^-1 delta

is chi-square of 2 (n - 1) degrees of freedom. Poses that are off by delta, of covariance C, move
the places that beams meet: G is what that does to P (`sldvexp.models.mapping`). Turned by the phase
of alpha it acts on the real part alone; so does the mirrors' pointing noise, which adds to s^2.

The measured modes have an error of their own that is common to all pixels: poles that are not exact
mix a share of each other mode into a shape, of known standard error. It is one more unknown.

Directed: what the other shapes of the model explain of the residuals is chi-square of 2 (k - 1),
few enough to see a small fault, and tells which modes are mixed. Poses are common to all modes:
the joint test of all has one delta.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.models.mapping import PredictedPixels
from sldvexp.statistics import chi_square_p_value
from sldvexp.typing import Array, ComplexArray


@dataclass(frozen=True, eq=False)
class StackedPixels:
    """Pixels of all views one after the other.

    Parameters
    ----------
    measured : ndarray of complex, shape (pixel, mode), m/s
    std : ndarray, shape (pixel, mode), m/s
        Per real and imaginary part.
    shape : ndarray, shape (pixel, model_mode)
    by_pose : ndarray, shape (pixel, model_mode, unknown)
        Derivatives of `shape` by unknowns of variance 1 that make all poses' errors.
    pointing : ndarray, shape (pixel, model_mode)
        Variance of `shape` from the mirrors' pointing noise.
    mixing : ndarray, shape (2, mode, mode)
        Standard errors of real and imaginary part of the share of the second measured mode in the
        first.
    """

    measured: ComplexArray
    std: Array
    shape: Array
    by_pose: Array
    pointing: Array
    mixing: Array

    @classmethod
    def of_views(
        cls,
        views: Sequence[PredictedPixels],
        covariance: Array | None = None,
        mixing: Array | None = None,
    ) -> StackedPixels:
        """Stack views.

        Parameters
        ----------
        covariance : ndarray, shape (6 view, 6 view), optional
            Of all poses together, NaN where nothing is known, which counts as exact. Without it
            the views' own are independent.
        """
        modes, count = views[0].pixels.velocity.shape[1], len(views)
        if covariance is None:
            each = [np.zeros((6, 6)) if (c := v.pixels.covariance) is None else c for v in views]
            covariance = np.asarray(scipy.linalg.block_diag(*each))
        errors = root(np.nan_to_num(covariance)).reshape(count, 6, 6 * count)
        return cls(
            np.concatenate([v.pixels.velocity for v in views]),
            np.concatenate([v.pixels.std for v in views]),
            np.concatenate([v.shape for v in views]),
            np.concatenate([v.by_pose @ own for v, own in zip(views, errors, strict=True)]),
            np.concatenate([(v.by_dac**2).sum(axis=-1) * v.pixels.pointing**2 for v in views]),
            np.zeros((2, modes, modes)) if mixing is None else mixing,
        )

    def mixed_in(self, mode: int) -> ComplexArray:
        """List what other measured modes may add to one, each part of its share, (pixel, part)."""
        other = np.arange(self.measured.shape[1]) != mode
        real, imaginary = (self.measured[:, other] * std[mode, other] for std in self.mixing)
        found = np.concatenate([real, 1j * imaginary], axis=1)
        return np.asarray(found[:, found.any(axis=0)])


def root(covariance: Array) -> Array:
    """Find L of a covariance L L', which may be singular.

    Examples
    --------
    >>> half = root(np.array([[4.0, 2.0], [2.0, 1.0]]))
    >>> (half @ half.T).round(9).tolist()
    [[4.0, 2.0], [2.0, 1.0]]
    """
    # Unknowns differ in unit: scaled to 1 before the small are told from zero.
    scale = np.sqrt(np.diag(covariance))
    unit = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(unit, unit))
    return np.asarray(unit[:, None] * vectors * np.sqrt(np.maximum(values, 0.0)))


class Squares(NamedTuple):
    """Sum of squares as a function of the poses' errors: ``sse - 2 side.x + x'gram x``.

    Attributes
    ----------
    sse : float
    side : ndarray, shape (unknown,)
    gram : ndarray, shape (unknown, unknown)
    """

    sse: float
    side: Array
    gram: Array

    def plus(self, other: Squares) -> Squares:
        """Add another with the same unknowns."""
        return Squares(self.sse + other.sse, self.side + other.side, self.gram + other.gram)

    def spread(self, dof: int) -> tuple[float, float]:
        """Compute mean and standard deviation of `sse` for a right shape.

        Errors of variance 1 add ``x'gram x`` to the chi-square of the noise.
        """
        mean = dof + np.trace(self.gram)
        variance = 2 * dof + 4 * np.trace(self.gram) + 2 * np.sum(self.gram**2)
        return float(mean), float(np.sqrt(variance))

    @property
    def errors(self) -> Array:
        """Most probable errors, those of variance 1 beforehand."""
        return np.asarray(np.linalg.solve(np.eye(len(self.side)) + self.gram, self.side))

    @property
    def least(self) -> float:
        """Smallest sum of squares, with that of the errors."""
        return float(self.sse - self.side @ self.errors)


@dataclass(frozen=True, eq=False)
class ShapeFit:
    """Fit of some of a model's shapes to one measured mode.

    Attributes
    ----------
    coefficient : ndarray of complex, shape (model_mode,), m/s per unit of the shape
    covariance : ndarray, shape (model_mode, model_mode)
        Of the parts in phase, which the poses' errors act on.
    squares : Squares
    """

    coefficient: ComplexArray
    covariance: Array
    squares: Squares


@dataclass(frozen=True, eq=False)
class ShapeTest:
    """Outcome for one measured mode and the model's mode paired with it.

    Attributes
    ----------
    mode, model_mode : int
        From 0.
    own : ShapeFit
        Of the paired shape alone.
    all : ShapeFit
        Of all shapes of the model.
    pixels : int
    relative : ndarray, shape (model_mode,)
        R.m.s. of each shape over that of the paired one.
    """

    mode: int
    model_mode: int
    own: ShapeFit
    all: ShapeFit
    pixels: int
    relative: Array

    @property
    def scale(self) -> complex:
        """Factor alpha of the model's shape, m/s per unit of it."""
        return complex(self.own.coefficient[0])

    @property
    def scale_std(self) -> float:
        """Standard error of its real or imaginary part."""
        return float(np.sqrt(self.own.covariance[0, 0]))

    @property
    def chi2(self) -> float:
        """Sum of squares that the paired shape leaves."""
        return self.own.squares.least

    @property
    def dof(self) -> int:
        """Degrees of freedom of `chi2`."""
        return 2 * (self.pixels - 1)

    @property
    def p_value(self) -> float:
        """Probability of such a `chi2` if the shape is right."""
        return float(chi_square_p_value(self.chi2, self.dof))

    @property
    def directed(self) -> float:
        """Sum of squares that the model's other shapes explain."""
        return self.own.squares.least - self.all.squares.least

    @property
    def directed_dof(self) -> int:
        """Degrees of freedom of `directed`."""
        return 2 * (len(self.relative) - 1)

    @property
    def directed_p_value(self) -> float:
        """Probability of such a `directed` if the shape is right."""
        return float(chi_square_p_value(self.directed, self.directed_dof))

    @property
    def mixed(self) -> ComplexArray:
        """Share of each other shape, r.m.s. over that of the paired one; 0 for that itself."""
        found = self.all.coefficient / self.all.coefficient[self.model_mode] * self.relative
        found[self.model_mode] = 0.0
        return np.asarray(found)

    @property
    def mixed_std(self) -> Array:
        """Standard errors of `mixed`, per part."""
        own = abs(self.all.coefficient[self.model_mode])
        found = np.sqrt(np.diag(self.all.covariance)) / own * self.relative
        found[self.model_mode] = 0.0
        return np.asarray(found)


def examine_shape(pixels: StackedPixels, mode: int, model_mode: int) -> ShapeTest:
    """Test the shape of one measured mode against that of the model's mode paired with it.

    Parameters
    ----------
    mode, model_mode : int
        From 0.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> shape = rng.normal(size=(400, 3))
    >>> noise = 0.1 * (rng.normal(size=(400, 1)) + 1j * rng.normal(size=(400, 1)))
    >>> exact = (np.zeros((400, 3, 1)), np.zeros((400, 3)), np.zeros((2, 1, 1)))
    >>> both = shape[:, :1] + 0.05 * shape[:, 1:2]
    >>> std = np.full((400, 1), 0.1)
    >>> right = StackedPixels(2 * shape[:, :1] + noise, std, shape, *exact)
    >>> wrong = StackedPixels(2 * both + noise, std, shape, *exact)
    >>> found = [examine_shape(one, 0, 0) for one in (right, wrong)]
    >>> [one.directed_p_value > 0.01 for one in found], abs(found[1].mixed).round(2).tolist()
    ([True, False], [0.0, 0.05, 0.0])
    """
    a, s = pixels.measured[:, mode], pixels.std[:, mode]
    own = pixels.shape[:, [model_mode]]
    scale = complex(np.sum(own[:, 0] * a / s**2) / np.sum(own[:, 0] ** 2 / s**2))
    phase = scale / abs(scale)
    # In phase with alpha the pointing noise and the poses act too, across it only the noise.
    in_phase = np.sqrt(s**2 + abs(scale) ** 2 * pixels.pointing[:, model_mode])
    std = np.concatenate([in_phase, s])[:, None]
    y = _parts(np.asarray(a[:, None] / phase)) / std
    by_pose = _parts(np.asarray(abs(scale) * pixels.by_pose[:, model_mode], complex)) / std
    by_mixing = _parts(np.asarray(pixels.mixed_in(mode) / phase)) / std
    one, every = (
        _fit(_both(columns) / std, y[:, 0], by_pose, by_mixing, phase)
        for columns in (own, pixels.shape)
    )
    rms = np.sqrt(np.mean(pixels.shape**2, axis=0))
    return ShapeTest(mode, model_mode, one, every, len(a), rms / rms[model_mode])


def _parts(values: ComplexArray) -> Array:
    """Put imaginary parts below the real ones."""
    return np.concatenate([values.real, values.imag])


def _both(columns: Array) -> Array:
    """Give real and imaginary part a coefficient of their own, those of the real part first."""
    zero = np.zeros_like(columns)
    return np.block([[columns, zero], [zero, columns]])


def _fit(columns: Array, y: Array, by_pose: Array, by_mixing: Array, phase: complex) -> ShapeFit:
    """Fit shapes to a mode that is turned to the phase of its scale, all rows of variance 1."""
    basis, triangle = np.linalg.qr(columns)

    def beside(rows: Array) -> Array:
        return np.asarray(rows - basis @ (basis.T @ rows))

    left, poses, mixing = beside(y), beside(by_pose), beside(by_mixing)
    # Mixing is this mode's alone, the poses are those of all: only these stay open.
    known = np.linalg.inv(np.eye(mixing.shape[1]) + mixing.T @ mixing)
    of_y, of_poses = mixing.T @ left, mixing.T @ poses
    squares = Squares(
        float(left @ left - of_y @ known @ of_y),
        poses.T @ left - of_poses.T @ known @ of_y,
        poses.T @ poses - of_poses.T @ known @ of_poses,
    )
    nuisance, own = np.hstack([by_pose, by_mixing]), np.hstack([poses, mixing])
    errors = np.linalg.inv(np.eye(own.shape[1]) + own.T @ own)
    found = np.linalg.solve(triangle, basis.T @ (y - nuisance @ (errors @ (own.T @ left))))
    inverse = np.linalg.inv(triangle)
    shift = inverse @ (basis.T @ nuisance)
    covariance = inverse @ inverse.T + shift @ errors @ shift.T
    half = len(found) // 2
    return ShapeFit(phase * (found[:half] + 1j * found[half:]), covariance[:half, :half], squares)


class JointTest(NamedTuple):
    """Test of the shapes of all paired modes, whose poses' errors are common.

    Attributes
    ----------
    chi2, p_value : float
    dof : int
    directed, directed_p_value : float
    directed_dof : int
    """

    chi2: float
    dof: int
    p_value: float
    directed: float
    directed_dof: int
    directed_p_value: float


def join_shapes(tests: Sequence[ShapeTest]) -> JointTest:
    """Join the tests of all paired modes.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> shape = rng.normal(size=(300, 2))
    >>> exact = (np.zeros((300, 2, 1)), np.zeros((300, 2)), np.zeros((2, 2, 2)))
    >>> noise = 0.1 * (rng.normal(size=(300, 2)) + 1j * rng.normal(size=(300, 2)))
    >>> stacked = StackedPixels(
    ...     shape + noise, np.full((300, 2), 0.1), shape, *exact
    ... )
    >>> joint = join_shapes([examine_shape(stacked, k, k) for k in (0, 1)])
    >>> joint.dof, joint.directed_dof, joint.p_value > 0.01
    (1196, 4, True)
    """
    own, every = (
        functools.reduce(Squares.plus, squares).least
        for squares in ([t.own.squares for t in tests], [t.all.squares for t in tests])
    )
    dof, directed_dof = sum(t.dof for t in tests), sum(t.directed_dof for t in tests)
    return JointTest(
        own,
        dof,
        float(chi_square_p_value(own, dof)),
        own - every,
        directed_dof,
        float(chi_square_p_value(own - every, directed_dof)),
    )
