"""Fit of the splines to the pixels of all views, together with what is not known exactly.

The equations are linear in the splines' coefficients as long as beams and surface are known; their
errors enter linearised (`sldvexp.shell.nuisances`), and the fit is repeated where they moved it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from sldvexp.field import View
from sldvexp.field.bounds.pose_uncertainty import POSE
from sldvexp.laser import TwoMirror
from sldvexp.shell.columns import SignalColumns
from sldvexp.shell.evidence import MATRICES, WeightedFit
from sldvexp.shell.functionals import Functionals, Rows
from sldvexp.shell.love import ThinShell
from sldvexp.shell.measured import Measured, blocks
from sldvexp.shell.nuisances import ErrorEquations, Nuisances, PriorErrors
from sldvexp.shell.outline import Outline
from sldvexp.shell.pixel_equations import PixelEquations
from sldvexp.shell.pixels import ViewPixels
from sldvexp.shell.refusals import too_few_pixels
from sldvexp.typing import Array, ComplexArray

#: Logarithms of weights that are tried, for coefficients over the velocities' size: of w, and of
#: the motion along the surface, whose large ones stand for "none".
WEIGHTS = (np.arange(-11.0, 17.0, 1.5), np.arange(-9.0, 21.0, 1.5))
#: Motion that nothing speaks against where no pixel is, over the velocities' size.
LARGEST = 100.0
#: Typical size of the middle's own motion along itself, over the velocities': thin structures bend.
TYPICAL = 0.05
#: Pixels without which no field is found: more than a cubic polynomial in two variables has terms.
FEWEST = 30
#: Change of the errors, in standard deviations, below which nothing is repeated, and repetitions.
SETTLED, REPEATED = 0.05, 4


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
    normal : ndarray, shape (coefficient, coefficient)
        ``A'A``.
    posterior : WeightedFit
    solved : list of ndarray, shape (coefficient, error)
        ``H^-1 A'J`` of every reduced column.
    nuisances : Nuisances
    at : ndarray, shape (error,)
        Errors that the equations are taken at.
    errors : PriorErrors
        What was known of them before the fit.
    laser : TwoMirror
    calibration : slice
        Errors that are the calibration's.
    pointed : list of ndarray, shape (coefficient, field)
        Of every reduced column: what pointing errors with random signs at all pixels make of the
        coefficients, over the root of the number of such fields; empty if none are known of.
    bounding : SurfaceFit, optional
        The same fit with the largest motion of the middle along itself that the data do not reject.
        Bounds are made by it; without it by this one.
    overlooked : ndarray, shape (2,), optional
        Signal in what no column holds, over noise, as `WeightedFit.overlooked` has it.
    """

    shell: ThinShell
    outline: Outline
    face: float
    pixels: list[ViewPixels]
    measured: Measured
    columns: SignalColumns
    normal: Array
    posterior: WeightedFit
    solved: list[Array]
    nuisances: Nuisances
    at: Array
    errors: PriorErrors
    laser: TwoMirror
    calibration: slice
    pointed: list[Array]
    bounding: SurfaceFit | None = None
    overlooked: Array | None = None

    @cached_property
    def size(self) -> Array:
        """Root mean square of the pixels' velocities, shape (frequency,), m/s."""
        power = np.mean((self.columns.data * self.measured.pixel_std[:, None]) ** 2, axis=0)
        return np.asarray(np.sqrt(self.columns.quadratic(np.diag(power)).sum(axis=0)))

    @cached_property
    def distances(self) -> Array:
        """Residuals over their noise, squares summed over frequencies, shape (pixel,)."""
        found = np.empty(len(self.measured.pixel_std))
        for _, some, left in self.residuals():
            found[some] = self.measured.over_noise(left, some)
        return found

    def residuals(self) -> Iterator[tuple[int, slice, ComplexArray]]:
        """Give the number of a view, some of all pixels, and what the splines leave of these."""
        theta = self.posterior.mean()
        for k, some, block in blocks(self.pixels):
            fitted = self.columns.combined(block.predicted(self.shell, theta, self.face))
            yield k, some, self.measured.velocity(k, block) - fitted

    def of_lines(self, lines: slice) -> SurfaceFit:
        """Keep some of the lines."""
        m = self.measured
        images = [image[:, lines] for image in m.images]
        measured = replace(m, images=images, scale=m.scale[lines])
        return replace(self, measured=measured, columns=self.columns.of_part(lines))

    def evaluate(
        self, rows: Array | Functionals, thicker: Array | Functionals | None = None
    ) -> tuple[ComplexArray, Array, Array]:
        """Compute values of linear functionals of the coefficients.

        Parameters
        ----------
        rows : ndarray, shape (functional, coefficient), or Functionals
        thicker : ndarray, shape (functional, coefficient), or Functionals, optional
            Derivatives of the rows by the sheet's thickness, 1/m.

        Returns
        -------
        values : ndarray of complex, shape (functional, frequency)
        own : ndarray, shape (part, functional, frequency)
            Variances from noise and smoothing.
        others : ndarray, shape (part, functional, frequency)
            Variances from poses, pointing, calibration, height and thickness.
        """
        values, by_source = self.by_source(rows, thicker)
        own = by_source.pop("noise")
        return values, own, np.asarray(sum(by_source.values()))

    def by_source(
        self, rows: Array | Functionals, thicker: Array | Functionals | None = None
    ) -> tuple[ComplexArray, dict[str, Array]]:
        """Do what `evaluate` does, with variances by their source as in the budget.

        Those from height and thickness count as those from poses, and motion of the middle that
        may have been overlooked as noise.
        """
        bounding = self.bounding or self
        goes_along, rest = bounding.nuisances.by_source(self.calibration)
        factors = {"pose": rest} | ({"calibration": goes_along} if goes_along.size else {})
        solved = np.stack(bounding.solved, axis=1)
        changes = {name: -solved @ factor for name, factor in factors.items()}
        if self.pointed:
            changes["pointing"] = np.stack(self.pointed, axis=1)
        found, variance = self._evaluated(
            _functionals(rows), [self.coefficients, bounding.coefficients, *changes.values()]
        )
        mean, other, spread = found[0], found[1], dict(zip(changes, found[2:], strict=True))
        if thicker is not None:
            both = np.hstack([self.posterior.mean(), bounding.posterior.mean()])
            of_both, _ = _functionals(thicker).evaluate(both, [])
            own, of_bounding = np.split(of_both, 2, axis=1)
            mean, other = mean + own * self.error[-1], other + of_bounding * bounding.error[-1]
            for name, factor in factors.items():
                spread[name] = spread[name] + of_bounding[:, :, None] * factor[-1]
        columns = mean.shape[1]
        values, noise = self.columns.lines(mean, variance[:, :columns])
        # one shift of all columns together
        noise += self._squares((other - mean)[:, :, None])
        if self.overlooked is not None:
            noise += self.columns.of_left_out(variance[:, columns])
        return values, {"noise": noise} | {name: self._squares(of) for name, of in spread.items()}

    def _evaluated(
        self, functionals: Functionals, parts: Sequence[Array]
    ) -> tuple[list[Array], Array]:
        """Compute functionals of columns of coefficients, and their variances.

        Parameters
        ----------
        parts : sequence of ndarray, shape (coefficient, ...) each

        Returns
        -------
        list of ndarray, shape (functional, ...) each
        ndarray, shape (functional, column + 1)
            Of every reduced column, and last of what no column holds if that is known.
        """
        columns = np.hstack([part.reshape(len(part), -1) for part in parts])
        ends = np.cumsum([part[0].size for part in parts])[:-1]
        count, products, squares = len(self.solved), [], []
        for begin in range(0, count, MATRICES):
            end = min(begin + MATRICES, count)
            product, square = functionals.evaluate(
                columns if begin == 0 else columns[:, :0], self._covariances(begin, end)
            )
            products.append(product)
            squares.append(square)
        split = np.split(products[0], ends, axis=1)
        found = [
            one.reshape(len(one), *part.shape[1:]) for one, part in zip(split, parts, strict=True)
        ]
        return found, np.maximum(np.hstack(squares), 0.0)

    def _covariances(self, begin: int, end: int) -> list[Array]:
        """Make covariances of the coefficients of some columns, and what is left out after all."""
        posterior = (self.bounding or self).posterior
        found = [posterior.covariance(column) for column in range(begin, end)]
        if self.overlooked is not None and end == len(self.solved):
            own, others = self.posterior.by_block()
            found.append(self.overlooked[0] * own + self.overlooked[1] * others)
        return found

    def _squares(self, spread: Array) -> Array:
        """Compute variances of both parts from changes of the reduced columns.

        Parameters
        ----------
        spread : ndarray, shape (functional, column, change)
        """
        return self.columns.quadratic(spread @ spread.swapaxes(1, 2))

    @property
    def error(self) -> Array:
        """Errors as they were found, less those that the equations are taken at."""
        return self.nuisances.mean - self.at

    @cached_property
    def coefficients(self) -> Array:
        """Means of every reduced column with the errors as they were found."""
        by_error = np.stack([of @ self.error for of in self.solved], axis=1)
        return self.posterior.mean() - by_error


def fit(
    views: Sequence[View],
    images: Sequence[Any],
    std: Sequence[Any],
    laser: TwoMirror,
    outline: Outline,
    shell: ThinShell,
    face: float,
    length: float | None,
    level: float,
    errors: PriorErrors,
) -> SurfaceFit:
    """Fit splines to the pixels of all views.

    Parameters
    ----------
    images : sequence of array, shape (pixel, frequency) each, m/s
        Velocities of the views.
    std : sequence of array, shape (pixel,) or (pixel, frequency) each, m/s
    face : float, m
        Height of the measured face above the splines' surface.
    length : float, m, optional
        Of the prior of the motion along the surface; see `ThinShell.penalties`.
    level : float
        At which data speak against a motion of the middle that bounds then need not hold; 1 has
        the average over all. Only errors that are adjusted can have taken such a motion up.

    Raises
    ------
    UserError
        If too few pixels see the structure.
    """
    pixels = [ViewPixels.of(view, laser, outline, face) for view in views]
    count = sum(len(p.pixel) for p in pixels)
    if count < FEWEST:
        raise too_few_pixels(count, FEWEST, views, outline, face)
    measured = Measured.of(images, std, pixels, shell, face)
    equations = _Equations(laser, outline, shell, face, length, level, errors, pixels, measured)
    found, of_pixels, of_errors = equations.at(np.zeros(len(errors.factor)))
    for _ in range(REPEATED if errors.adjusted else 0):
        moved = found.nuisances.mean.copy()
        moved[errors.own] = 0.0  # small beside a pixel: linear
        if np.linalg.norm(np.linalg.lstsq(errors.factor, moved - found.at)[0]) < SETTLED:
            break
        found, of_pixels, of_errors = equations.at(moved)
    overlooked = equations.overlooked(found, of_pixels)
    found = replace(equations.bounded(found, of_errors), overlooked=overlooked)
    posterior = (found.bounding or found).posterior
    return replace(found, pointed=of_pixels.pointed(posterior, found.posterior.mean()))


def _functionals(rows: Array | Functionals) -> Functionals:
    return rows if isinstance(rows, Functionals) else Rows(rows)


@dataclass(frozen=True, eq=False)
class _Equations:
    """Everything but the errors that the equations are taken at."""

    laser: TwoMirror
    outline: Outline
    shell: ThinShell
    face: float
    length: float | None
    level: float
    errors: PriorErrors
    pixels: list[ViewPixels]
    measured: Measured

    @cached_property
    def columns(self) -> SignalColumns:
        """Columns that carry the signal."""
        return SignalColumns.of(self._white, self.measured.scale)

    @cached_property
    def known(self) -> Array:
        """Priors' precision that needs no weight, over that of the velocities' size."""
        return self.shell.known_precision() + self.shell.squares() / LARGEST**2

    @cached_property
    def penalties(self) -> list[Array]:
        """Priors' precisions but for their weights, as `ThinShell.penalties` has them."""
        return self.shell.penalties(self.length)

    def _white(self) -> Iterator[Array]:
        """Give velocities of some pixels at a time over their noise, real parts before others."""
        m = self.measured
        for k, some, block in blocks(self.pixels):
            own = m.velocity(k, block) / m.pixel_std[some, None] / m.scale
            yield np.concatenate([own.real, own.imag], axis=1)

    def at(self, at: Array) -> tuple[SurfaceFit, PixelEquations, ErrorEquations]:
        """Fit with poses, height and thickness that are off by so much."""
        height, thickness = at[-2:]
        poses = at[: self.errors.own.start]
        face = self.face + thickness / 2
        moved = [
            p.seen_from(pose, self.laser, self.outline, face, height)
            for p, pose in zip(self.pixels, np.reshape(poses, (-1, POSE)), strict=True)
        ]
        data = self.columns.data
        equations = PixelEquations(
            self.laser,
            self.outline,
            self.shell,
            face,
            at,
            self.errors,
            moved,
            self.measured,
            self.columns,
        )
        normal, right = equations.products()
        size = np.sqrt(np.mean((data[:, 0] * self.measured.pixel_std) ** 2))
        posterior = WeightedFit.of(
            normal + self.known / size**2,
            right,
            (data**2).sum(axis=0),
            self.penalties,
            [grid - 2 * np.log(size) for grid in WEIGHTS],
            np.inf if self.length is None else TYPICAL * size,
        )
        of_errors = equations.of_errors(posterior.mean())
        solved = of_errors.solved(posterior)
        nuisances = self._nuisances(of_errors, posterior, solved)
        found = SurfaceFit(
            self.shell,
            self.outline,
            face,
            moved,
            self.measured,
            self.columns,
            normal,
            posterior,
            solved,
            nuisances,
            at,
            self.errors,
            self.laser,
            self.errors.own,
            [],
        )
        return found, equations, of_errors

    def bounded(self, found: SurfaceFit, equations: ErrorEquations) -> SurfaceFit:
        """Add what bounds are made by, as `SurfaceFit.bounding` has it."""
        if not self.errors.adjusted or self.level == 1:
            return found
        most = found.posterior.with_most(equations.gained(found.posterior), self.level)
        solved = equations.solved(most)
        nuisances = self._nuisances(equations, most, solved)
        bounding = replace(found, posterior=most, solved=solved, nuisances=nuisances)
        return replace(found, bounding=bounding)

    def overlooked(self, found: SurfaceFit, equations: PixelEquations) -> Array | None:
        """Bound signal in what no column holds, as `SurfaceFit.overlooked` has it."""
        count = 2 * len(self.columns.scale) - len(self.columns.size)
        if not count:
            return None
        crossed = equations.crossed(
            white - self.columns.data[some] @ self.columns.combination
            for (_, some, _), white in zip(blocks(self.pixels), self._white(), strict=True)
        )
        # Columns took with them the noise of all lines that is alike to them over the pixels.
        alike = found.posterior.reduced / self.columns.size
        noise = found.normal - alike @ alike.T
        return found.posterior.overlooked(noise, crossed @ crossed.T, count)

    def _nuisances(
        self, equations: ErrorEquations, posterior: WeightedFit, solved: list[Array]
    ) -> Nuisances:
        """Find the errors, if they may move."""
        prior = self.errors.factor
        if self.errors.adjusted and prior.size:
            return equations.known(posterior, solved)
        return Nuisances(np.zeros(len(prior)), prior)
