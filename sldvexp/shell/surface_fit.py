"""Fit of the splines to the pixels of all views, together with what is not known exactly.

The equations are linear in the splines' coefficients as long as beams and surface are known; their
errors enter linearised (`sldvexp.shell.nuisances`), and the fit is repeated where they moved it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sldvexp.errors import UserError
from sldvexp.field import View
from sldvexp.field.bounds.pose_uncertainty import POSE
from sldvexp.laser import TwoMirror
from sldvexp.lazy import scipy
from sldvexp.shell.columns import SignalColumns
from sldvexp.shell.evidence import WeightedFit
from sldvexp.shell.love import ThinShell
from sldvexp.shell.nuisances import Nuisances
from sldvexp.shell.outline import Outline
from sldvexp.shell.pixels import ViewPixels
from sldvexp.typing import Array, ComplexArray

#: Logarithms of weights that are tried, for coefficients over the velocities' size: of w, and of
#: the motion along the surface, whose large ones stand for "none".
WEIGHTS = (np.arange(-11.0, 17.0, 1.5), np.arange(-9.0, 21.0, 1.5))
#: Pixels without which no field is found: more than a cubic polynomial in two variables has terms.
FEWEST = 30
#: Change of the errors, in standard deviations, below which nothing is repeated, and repetitions.
SETTLED, REPEATED = 0.05, 4
#: Standard error of a pixel, over the largest velocity, below which it is taken as unknown.
EXACT = 1e-9


@dataclass(frozen=True, eq=False)
class PriorErrors:
    """What was known beforehand of poses, height and thickness.

    Attributes
    ----------
    factor : ndarray, shape (6 view + 2, any)
        Of their covariance: poses, the given surface's height, the sheet's thickness.
    adjusted : bool
        Whether they are found anew together with the field.
    """

    factor: Array
    adjusted: bool

    @classmethod
    def of(cls, poses: Array, height: float, thickness: float, adjusted: bool) -> PriorErrors:
        """Combine covariances of poses, (6 view, 6 view), and standard errors, m."""
        values, vectors = np.linalg.eigh(poses)
        known = values > 1e-14 * max(values.max(initial=0.0), 1e-300)
        factor = scipy.linalg.block_diag(
            vectors[:, known] * np.sqrt(values[known]), [[height]], [[thickness]]
        )
        return cls(factor[:, np.any(factor != 0, axis=0)], adjusted)


@dataclass(frozen=True, eq=False)
class Measured:
    """Velocities of all views' pixels, and their noise as a product of pixel and frequency.

    Attributes
    ----------
    velocity : ndarray of complex, shape (pixel, frequency), m/s
    pixel_std : ndarray, shape (pixel,), m/s
    scale : ndarray, shape (frequency,)
    stated : bool
        False where the views state no noise and it is taken from the residuals.
    """

    velocity: ComplexArray
    pixel_std: Array
    scale: Array
    stated: bool

    @classmethod
    def of(cls, pixels: Sequence[ViewPixels], shell: ThinShell, face: float) -> Measured:
        """Collect the pixels of all views.

        Raises
        ------
        UserError
            If nothing moves.
        """
        velocity = np.concatenate([p.view.velocity[p.pixel] for p in pixels])
        largest = float(np.abs(velocity).max())
        if largest == 0:
            raise UserError(
                "all pixels that meet the surface are at rest: there is no motion to fit"
            )
        std = np.concatenate([_std_of(p) for p in pixels])
        if std.min() <= EXACT * largest:
            even = np.full(len(velocity), _left_over(pixels, shell, face, velocity))
            return cls(velocity, even, np.ones(velocity.shape[1]), False)
        by_frequency = np.sqrt(np.mean(std**2, axis=0))
        scale = by_frequency / np.sqrt(np.mean(by_frequency**2))
        return cls(velocity, np.sqrt(np.mean((std / scale) ** 2, axis=1)), scale, True)


@dataclass(frozen=True, eq=False)
class SurfaceFit:
    """The splines' posterior, and what was found of errors beside the field.

    Attributes
    ----------
    shell : ThinShell
    outline : Outline
    face : float, m
        Height of the measured face above the splines' surface.
    pixels : list of ViewPixels
        At the poses as adjusted.
    measured : Measured
    columns : SignalColumns
    posterior : WeightedFit
    solved : list of ndarray, shape (coefficient, error)
        ``H^-1 A'J`` of every reduced column.
    nuisances : Nuisances
    at : ndarray, shape (error,)
        Errors that the equations are taken at.
    errors : PriorErrors
        What was known of them before the fit.
    laser : TwoMirror
    """

    shell: ThinShell
    outline: Outline
    face: float
    pixels: list[ViewPixels]
    measured: Measured
    columns: SignalColumns
    posterior: WeightedFit
    solved: list[Array]
    nuisances: Nuisances
    at: Array
    errors: PriorErrors
    laser: TwoMirror

    @cached_property
    def residual(self) -> ComplexArray:
        """Velocities less those of the splines, shape (pixel, frequency), m/s."""
        theta = self.posterior.mean()
        fitted = np.concatenate([p.design(self.shell, self.face) @ theta for p in self.pixels])
        return np.asarray(self.measured.velocity - self.columns.combined(fitted))

    def evaluate(
        self, rows: Array, thicker: Array | None = None
    ) -> tuple[ComplexArray, Array, Array]:
        """Compute values of linear functionals of the coefficients.

        Parameters
        ----------
        rows : ndarray, shape (functional, coefficient)
        thicker : ndarray, shape (functional, coefficient), optional
            Derivatives of the rows by the sheet's thickness, 1/m.

        Returns
        -------
        values : ndarray of complex, shape (functional, frequency)
        own : ndarray, shape (part, functional, frequency)
            Variances from noise and smoothing.
        others : ndarray, shape (part, functional, frequency)
            Variances from poses, height and thickness.
        """
        mean, variance = self.posterior.evaluate(rows)
        gain = -np.stack([rows @ s for s in self.solved], axis=-1)  # (functional, error, column)
        if thicker is not None:
            gain[:, -1] += thicker @ self.posterior.mean()
        mean = mean + np.einsum("fec,e->fc", gain, self.nuisances.mean - self.at)
        values, own = self.columns.lines(mean, variance)
        by_error = self.columns.combined(gain)
        spread = np.einsum("fel,em->fml", by_error, self.nuisances.factor)
        others = np.stack([(spread.real**2).sum(axis=1), (spread.imag**2).sum(axis=1)])
        return values, own, others


def fit(
    views: Sequence[View],
    laser: TwoMirror,
    outline: Outline,
    shell: ThinShell,
    face: float,
    length: float | None,
    errors: PriorErrors,
) -> SurfaceFit:
    """Fit splines to the pixels of all views.

    Parameters
    ----------
    face : float, m
        Height of the measured face above the splines' surface.
    length : float, m, optional
        Of the prior of the motion along the surface; see `ThinShell.penalties`.

    Raises
    ------
    UserError
        If too few pixels see the structure.
    """
    pixels = [ViewPixels.of(view, laser, outline, face) for view in views]
    count = sum(len(p.pixel) for p in pixels)
    if count < FEWEST:
        raise UserError(
            f"{count} pixels of all views together meet the surface from the side of its normals, "
            f"where {FEWEST} are needed: does the volume lie where the structure is?"
        )
    measured = Measured.of(pixels, shell, face)
    equations = _Equations(laser, outline, shell, face, length, errors, pixels, measured)
    found = equations.at(np.zeros(len(errors.factor)))
    for _ in range(REPEATED if errors.adjusted else 0):
        moved = found.nuisances.mean
        if np.linalg.norm(np.linalg.lstsq(errors.factor, moved - found.at)[0]) < SETTLED:
            break
        found = equations.at(moved)
    return found


@dataclass(frozen=True, eq=False)
class _Equations:
    """Everything but the errors that the equations are taken at."""

    laser: TwoMirror
    outline: Outline
    shell: ThinShell
    face: float
    length: float | None
    errors: PriorErrors
    pixels: list[ViewPixels]
    measured: Measured

    @cached_property
    def columns(self) -> SignalColumns:
        """Columns that carry the signal."""
        m = self.measured
        return SignalColumns.of(m.velocity, m.pixel_std, m.scale)

    def at(self, at: Array) -> SurfaceFit:
        """Fit with poses, height and thickness that are off by so much."""
        *poses, height, thickness = at
        face = self.face + thickness / 2
        moved = [
            p.seen_from(pose, self.laser, self.outline, face + height)
            for p, pose in zip(self.pixels, np.reshape(poses, (-1, POSE)), strict=True)
        ]
        weight = self._by_view(1 / self.measured.pixel_std)
        designs = [
            p.design(self.shell, face) * w[:, None] for p, w in zip(moved, weight, strict=True)
        ]
        data = self._by_view(self.columns.data)
        right = np.sum([a.T @ y for a, y in zip(designs, data, strict=True)], axis=0)
        size = np.sqrt(np.mean((self.columns.data[:, 0] * self.measured.pixel_std) ** 2))
        posterior = WeightedFit.of(
            np.sum([a.T @ a for a in designs], axis=0),
            right,
            (self.columns.data**2).sum(axis=0),
            self.shell.penalties(self.length),
            [grid - 2 * np.log(size) for grid in WEIGHTS],
        )
        theta = posterior.mean()
        changes = [
            self._changes(p, theta, face, height) * w[:, None, None]
            for p, w in zip(moved, weight, strict=True)
        ]
        solved, nuisances = self._nuisances(at, posterior, designs, changes, right)
        return SurfaceFit(
            self.shell,
            self.outline,
            face,
            moved,
            self.measured,
            self.columns,
            posterior,
            solved,
            nuisances,
            at,
            self.errors,
            self.laser,
        )

    def _by_view(self, values: Array) -> list[Array]:
        """Split what is of all pixels into views."""
        return np.split(values, np.cumsum([len(p.pixel) for p in self.pixels])[:-1])

    def _nuisances(
        self,
        at: Array,
        posterior: WeightedFit,
        designs: list[Array],
        changes: list[Array],
        right: Array,
    ) -> tuple[list[Array], Nuisances]:
        """Solve for what the errors do to the coefficients, and find the errors if they may move.

        Parameters
        ----------
        changes : list of ndarray, shape (pixel, 6 + height and thickness, column)
            Derivatives J of each view's whitened predictions.
        """
        errors, columns = len(at), right.shape[1]
        crossed = np.zeros((self.shell.coefficients, errors, columns))
        products = np.zeros((errors, columns))
        squares = np.zeros((columns, errors, errors))
        data = self._by_view(self.columns.data)
        for k, (a, j, y) in enumerate(zip(designs, changes, data, strict=True)):
            own = [*range(POSE * k, POSE * (k + 1)), errors - 2, errors - 1]
            crossed[:, own] += np.einsum("pi,pec->iec", a, j, optimize=True)
            products[own] += np.einsum("pec,pc->ec", j, y)
            of_view = np.einsum("pec,pfc->cef", j, j, optimize=True)
            squares[np.ix_(range(columns), own, own)] += of_view
        solved = [posterior.solve(crossed[:, :, c], c) for c in range(columns)]
        if not self.errors.adjusted or not self.errors.factor.size:
            return solved, Nuisances(np.zeros(errors), self.errors.factor)
        told = [squares[c] - crossed[:, :, c].T @ solved[c] for c in range(columns)]
        return solved, Nuisances.posterior(self.errors.factor, at, products, told, solved, right)

    def _changes(self, pixels: ViewPixels, theta: Array, face: float, height: float) -> Array:
        """Differentiate a view's predictions, shape (pixel, 6 + height and thickness, column)."""
        place, cosine = pixels.changes(self.laser, self.outline, face + height)
        where = pixels.coordinates

        def motion(rows: tuple[Array, Array, Array]) -> Array:
            return np.stack([of @ theta for of in rows], axis=1)  # (pixel, axis, column)

        here = motion(self.shell.velocity(where, face))
        by_s = motion(self.shell.velocity(where, face, 1, 0))
        by_t = motion(self.shell.velocity(where, face, 0, 1))
        toward = pixels.cosine
        change = np.einsum("pae,pac->pec", cosine, here)
        for slope, by in ((by_s, place[:, 0]), (by_t, place[:, 1])):
            change += by[:, :, None] * np.einsum("pa,pac->pc", toward, slope)[:, None]
        thicker = motion(self.shell.velocity_by_height(where))
        by_thickness = (change[:, POSE] + np.einsum("pa,pac->pc", toward, thicker)) / 2
        return np.concatenate([change, by_thickness[:, None]], axis=1)


def _std_of(pixels: ViewPixels) -> Array:
    """Collect standard errors of a view's pixels at every frequency, m/s."""
    own = pixels.view.std.reshape(len(pixels.view.std), -1)[pixels.pixel]
    return np.broadcast_to(own, pixels.view.velocity[pixels.pixel].shape)


def _left_over(
    pixels: Sequence[ViewPixels], shell: ThinShell, face: float, velocity: ComplexArray
) -> float:
    """Estimate the noise, m/s, from what splines without any prior leave over."""
    design = np.concatenate([p.design(shell, face) for p in pixels])
    theta, _, rank, _ = np.linalg.lstsq(design, velocity, rcond=1e-10)
    left = np.abs(velocity - design @ theta) ** 2
    free = max(len(velocity) - int(rank), 1)
    least = EXACT * np.abs(velocity).max()  # exact data have no noise, but round-off
    return float(max(np.sqrt(left.sum() / (2 * free * velocity.shape[1])), least))
