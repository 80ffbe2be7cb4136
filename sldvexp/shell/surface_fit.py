"""Fit of the splines to the pixels of all views, together with what is not known exactly.

The equations are linear in the splines' coefficients as long as beams and surface are known; their
errors enter linearised (`sldvexp.shell.nuisances`), and the fit is repeated where they moved it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.field import View
from sldvexp.laser import TwoMirror
from sldvexp.lazy import scipy
from sldvexp.shell.columns import SignalColumns
from sldvexp.shell.evidence import WeightedFit
from sldvexp.shell.love import ThinShell
from sldvexp.shell.nuisances import Nuisances
from sldvexp.shell.outline import Outline
from sldvexp.shell.pixels import POSE, ViewPixels
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
class SurfaceFit:
    """The splines' posterior, and what was found of errors beside the field.

    Attributes
    ----------
    shell : ThinShell
    pixels : list of ViewPixels
        At the poses as adjusted.
    columns : SignalColumns
    posterior : WeightedFit
    solved : list of ndarray, shape (coefficient, error)
        ``H^-1 A'J`` of every reduced column.
    nuisances : Nuisances
    at : ndarray, shape (error,)
        PriorErrors that the equations are taken at.
    residual : ndarray of complex, shape (pixel, frequency), m/s
    pixel_std : ndarray, shape (pixel,), m/s
    estimated_noise : bool
        Whether the pixels' noise was not stated and is taken from the residuals.
    """

    shell: ThinShell
    outline: Outline
    face: float
    pixels: list[ViewPixels]
    columns: SignalColumns
    posterior: WeightedFit
    solved: list[Array]
    nuisances: Nuisances
    at: Array
    residual: ComplexArray
    pixel_std: Array
    estimated_noise: bool

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
    velocity, pixel_std, scale, stated = _noise(pixels)
    if not stated:
        pixel_std = np.full(count, _left_over(pixels, shell, face, velocity))
    columns = SignalColumns.of(velocity, pixel_std, scale)
    fitted = _Equations(laser, outline, shell, face, length, errors, columns, pixel_std)
    at = np.zeros(len(errors.factor))
    found = fitted.at(pixels, at)
    for _ in range(REPEATED if errors.adjusted else 0):
        moved = found.nuisances.mean
        if np.linalg.norm(np.linalg.lstsq(errors.factor, moved - at)[0]) < SETTLED:
            break
        at = moved
        found = fitted.at(pixels, at)
    residual = velocity - _predicted(found)
    return replace(found, residual=residual, estimated_noise=not stated)


@dataclass(frozen=True, eq=False)
class _Equations:
    """Everything but the errors that the equations are taken at."""

    laser: TwoMirror
    outline: Outline
    shell: ThinShell
    face: float
    length: float | None
    errors: PriorErrors
    columns: SignalColumns
    pixel_std: Array

    def at(self, pixels: list[ViewPixels], at: Array) -> SurfaceFit:
        """Fit with poses, height and thickness that are off by so much."""
        views = len(pixels)
        height, thickness = at[POSE * views :]
        face = self.face + thickness / 2
        poses = at[: POSE * views].reshape(views, POSE)
        moved = [
            p.seen_from(pose, self.laser, self.outline, face + height)
            for p, pose in zip(pixels, poses, strict=True)
        ]
        data = np.split(self.columns.data, np.cumsum([len(p.pixel) for p in pixels])[:-1])
        weight = np.split(1 / self.pixel_std, np.cumsum([len(p.pixel) for p in pixels])[:-1])
        designs = [
            p.design(self.shell, face) * w[:, None] for p, w in zip(moved, weight, strict=True)
        ]
        normal = np.sum([a.T @ a for a in designs], axis=0)
        right = np.sum([a.T @ y for a, y in zip(designs, data, strict=True)], axis=0)
        size = np.sqrt(np.mean((self.columns.data[:, 0] * self.pixel_std) ** 2))
        posterior = WeightedFit.of(
            normal,
            right,
            (self.columns.data**2).sum(axis=0),
            self.shell.penalties(self.length),
            [grid - 2 * np.log(size) for grid in WEIGHTS],
        )
        theta = posterior.mean()
        crossed = np.zeros((self.shell.coefficients, len(at), theta.shape[1]))
        products = np.zeros((len(at), theta.shape[1]))
        squares = np.zeros((theta.shape[1], len(at), len(at)))
        for k, (p, a, y, w) in enumerate(zip(moved, designs, data, weight, strict=True)):
            change = self._changes(p, theta, face, height) * w[:, None, None]
            own = [*range(POSE * k, POSE * (k + 1)), len(at) - 2, len(at) - 1]
            crossed[:, own] += np.einsum("pi,pec->iec", a, change, optimize=True)
            products[own] += np.einsum("pec,pc->ec", change, y)
            squares[np.ix_(range(theta.shape[1]), own, own)] += np.einsum(
                "pec,pfc->cef", change, change, optimize=True
            )
        solved = [posterior.solve(crossed[:, :, c], c) for c in range(theta.shape[1])]
        told = [squares[c] - crossed[:, :, c].T @ solved[c] for c in range(theta.shape[1])]
        nuisances = Nuisances(np.zeros(len(at)), self.errors.factor)
        if self.errors.adjusted and self.errors.factor.size:
            nuisances = Nuisances.posterior(self.errors.factor, at, products, told, solved, right)
        return SurfaceFit(
            self.shell,
            self.outline,
            face,
            moved,
            self.columns,
            posterior,
            solved,
            nuisances,
            at,
            np.zeros((0, 0), complex),
            self.pixel_std,
            False,
        )

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


def _noise(pixels: Sequence[ViewPixels]) -> tuple[ComplexArray, Array, Array, bool]:
    """Collect velocities and their noise as a product of pixel and frequency.

    Returns
    -------
    velocity : ndarray of complex, shape (pixel, frequency), m/s
    pixel_std : ndarray, shape (pixel,), m/s
    scale : ndarray, shape (frequency,)
    stated : bool
    """
    velocity = np.concatenate([p.view.velocity[p.pixel] for p in pixels])
    std = np.concatenate(
        [
            np.broadcast_to(
                p.view.std.reshape(len(p.view.std), -1)[p.pixel], p.view.velocity[p.pixel].shape
            )
            for p in pixels
        ]
    )
    largest = float(np.abs(velocity).max())
    if std.min() <= EXACT * largest:
        even = np.full(len(velocity), largest or 1.0)
        return velocity, even, np.ones(velocity.shape[1]), False
    by_frequency = np.sqrt(np.mean(std**2, axis=0))
    scale = by_frequency / np.sqrt(np.mean(by_frequency**2))
    return velocity, np.sqrt(np.mean((std / scale) ** 2, axis=1)), scale, True


def _left_over(
    pixels: Sequence[ViewPixels], shell: ThinShell, face: float, velocity: ComplexArray
) -> float:
    """Estimate the noise, m/s, from what splines without any prior leave over."""
    design = np.concatenate([p.design(shell, face) for p in pixels])
    theta, _, rank, _ = np.linalg.lstsq(design, velocity, rcond=1e-10)
    left = np.abs(velocity - design @ theta) ** 2
    free = max(len(velocity) - int(rank), 1)
    least = EXACT * np.abs(velocity).max()  # exact data have no noise, but round-off
    return float(max(np.sqrt(left.sum() / (2 * free * velocity.shape[1])), least or 1.0))


def _predicted(found: SurfaceFit) -> ComplexArray:
    """Predict all pixels at the errors that the equations are taken at."""
    theta = found.posterior.mean()
    designs = (p.design(found.shell, found.face) for p in found.pixels)
    return found.columns.combined(np.concatenate([a @ theta for a in designs]))
