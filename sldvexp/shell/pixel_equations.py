"""Equations of all views' pixels: their products, and what they change by errors beside the field.

With whitened rows A, data y and the derivatives J of predictions by errors, all that a fit needs
are the sums A'A, A'y, A'J, J'y and J'J over the pixels. They are added up cell by cell of the
splines (`sldvexp.shell.local_rows`), of pixels of all views together: all of them see a cell.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sldvexp.field.bounds.pointing import pointing_std
from sldvexp.field.bounds.pose_uncertainty import POSE
from sldvexp.laser import TwoMirror
from sldvexp.shell.columns import SignalColumns
from sldvexp.shell.evidence import WeightedFit
from sldvexp.shell.linear_form import LinearForm, summed
from sldvexp.shell.local_rows import LocalRows
from sldvexp.shell.love import ThinShell
from sldvexp.shell.measured import Measured, blocks
from sldvexp.shell.nuisances import ErrorEquations, PriorErrors
from sldvexp.shell.outline import Outline
from sldvexp.shell.pixels import ViewPixels, beams_by_step
from sldvexp.typing import Array

#: Pixels of all views that are added up together; if there are no more their rows stay in memory.
JOINED = 12288
#: Fields of pointing errors with random signs; a standard error from them is right to 9 %.
FIELDS = 64


@dataclass(frozen=True, eq=False)
class JoinedPixels:
    """Pixels of several views, and their whitened rows.

    Attributes
    ----------
    parts : list of tuple of int, slice and ViewPixels
        Numbers of views, which of all pixels, and these.
    local : LocalRows
    motion : list of LinearForm
        Of u, v and w.
    height : ndarray, shape (pixel,), m
        Of the places above the splines' surface.
    rows : ndarray, shape (pixel, own)
    """

    parts: list[tuple[int, slice, ViewPixels]]
    local: LocalRows
    motion: list[LinearForm]
    height: Array
    rows: Array

    @classmethod
    def of(
        cls, parts: list[tuple[int, slice, ViewPixels]], shell: ThinShell, face: float, std: Array
    ) -> JoinedPixels:
        """Make the rows of pixels with such standard errors of all of them, m/s."""
        pixels = [block for _, _, block in parts]
        coordinates = np.concatenate([p.coordinates for p in pixels])
        cosine = np.concatenate([p.cosine for p in pixels])
        height = face * np.repeat([p.side for p in pixels], [len(p.pixel) for p in pixels])
        motion, local = shell.motion(coordinates, height), LocalRows(shell, coordinates)
        seen = summed([own * toward for own, toward in zip(motion, cosine.T, strict=True)])
        weight = 1 / std[parts[0][1].start : parts[-1][1].stop, None]
        return cls(parts, local, motion, height, local.row(seen) * weight)

    @property
    def some(self) -> slice:
        """Which of all pixels they are."""
        return slice(self.parts[0][1].start, self.parts[-1][1].stop)

    def within(self, some: slice) -> slice:
        """Tell which of these pixels some of all are."""
        return slice(some.start - self.some.start, some.stop - self.some.start)


@dataclass(frozen=True, eq=False)
class PixelEquations:
    """Equations of all pixels at errors of poses, height and thickness.

    Attributes
    ----------
    laser : TwoMirror
    outline : Outline
    shell : ThinShell
    face : float, m
        Height of the measured face above the splines' surface.
    at : ndarray, shape (error,)
        Errors that they are taken at.
    errors : PriorErrors
    pixels : list of ViewPixels
        As they are seen with these errors.
    measured : Measured
    columns : SignalColumns
    """

    laser: TwoMirror
    outline: Outline
    shell: ThinShell
    face: float
    at: Array
    errors: PriorErrors
    pixels: list[ViewPixels]
    measured: Measured
    columns: SignalColumns

    @cached_property
    def _kept(self) -> list[JoinedPixels]:
        return list(self._made())

    def _made(self) -> Iterator[JoinedPixels]:
        """Join pixels, some at a time."""
        parts: list[tuple[int, slice, ViewPixels]] = []
        for part in blocks(self.pixels):
            if parts and part[1].stop - parts[0][1].start > JOINED:
                yield JoinedPixels.of(parts, self.shell, self.face, self.measured.pixel_std)
                parts = []
            parts.append(part)
        yield JoinedPixels.of(parts, self.shell, self.face, self.measured.pixel_std)

    @property
    def joined(self) -> Iterable[JoinedPixels]:
        """Pixels of all views, some at a time."""
        return self._kept if len(self.measured.pixel_std) <= JOINED else self._made()

    def products(self) -> tuple[Array, Array]:
        """Compute ``A'A``, and ``A'y`` of all columns."""
        normal = np.zeros((self.shell.coefficients,) * 2)
        right = np.zeros((self.shell.coefficients, self.columns.data.shape[1]))
        for own in self.joined:
            normal += own.local.gram(own.rows)
            right += own.local.crossed(own.rows, self.columns.data[own.some])
        return normal, right

    def crossed(self, columns: Iterable[Array]) -> Array:
        """Compute A' of columns, which are given some pixels at a time as `blocks` gives them."""
        each, found = iter(columns), np.zeros((0, 0))
        for own in self.joined:
            of_parts = np.concatenate([next(each) for _ in own.parts])
            own_part = own.local.crossed(own.rows, of_parts)
            found = found + own_part if found.size else own_part
        return found

    def of_errors(self, theta: Array) -> ErrorEquations:
        """Make the equations of the errors, with derivatives J of the whitened predictions.

        Parameters
        ----------
        theta : ndarray, shape (coefficient, column)
            Of the field as it is known.
        """
        errors, columns = len(self.at), theta.shape[1]
        crossed = np.zeros((self.shell.coefficients, errors, columns))
        products = np.zeros((errors, columns))
        squares = np.zeros((columns, errors, errors))
        for joined in self.joined:
            changes = np.zeros((len(joined.rows), errors, columns))
            motion = self._motion(joined, theta)
            for k, some, block in joined.parts:
                own = [*range(POSE * k, POSE * (k + 1)), *range(self.errors.own.start, errors)]
                others = [error.of_beams(k, block.pixel) for error in self.errors.calibration]
                here = joined.within(some)
                j = self._changes(block, motion[here], others)
                j /= self.measured.pixel_std[some, None, None]
                changes[here, own] = j
                for c, data in enumerate(self.columns.data[some].T):
                    products[own, c] += data @ j[:, :, c]
                    squares[np.ix_([c], own, own)] += j[:, :, c].T @ j[:, :, c]
            flat = changes.reshape(len(changes), -1)
            crossed += joined.local.crossed(joined.rows, flat).reshape(crossed.shape)
        return ErrorEquations(self.errors.factor, self.at, crossed, products, squares)

    def pointed(self, posterior: WeightedFit, theta: Array) -> list[Array]:
        """Make coefficients of fields of pointing errors, as `SurfaceFit.pointed` has them.

        Parameters
        ----------
        posterior : WeightedFit
            By which bounds are made.
        theta : ndarray, shape (coefficient, column)
        """
        steps = [pointing_std(self.laser.pointing_std, p.view) for p in self.pixels]
        if not any(steps):
            return []
        rng, columns = np.random.default_rng(0), theta.shape[1]
        crossed = np.zeros((self.shell.coefficients, FIELDS * columns))
        for joined in self.joined:
            motion, errors = self._motion(joined, theta), []
            for k, some, block in joined.parts:
                own = beams_by_step(block.view, self.laser, block.pixel)
                slope = self._changes(block, motion[joined.within(some)], own)[:, POSE:-2]
                signs = rng.choice([-steps[k], steps[k]], (len(block.pixel), FIELDS, 2))
                of_block = signs @ slope / self.measured.pixel_std[some, None, None]
                errors.append(of_block.reshape(len(of_block), -1))
            crossed += joined.local.crossed(joined.rows, np.concatenate(errors))
        by_field = crossed.reshape(-1, FIELDS, columns)
        solved = [posterior.solve(by_field[:, :, c], c) for c in range(columns)]
        return [each / np.sqrt(FIELDS) for each in solved]

    def _motion(self, joined: JoinedPixels, theta: Array) -> Array:
        """Evaluate u, v and w, their derivatives by s and t, and by the height.

        Returns
        -------
        ndarray, shape (pixel, 4, axis, column)
        """
        places, height, shell = joined.local.coordinates, joined.height, self.shell
        forms = [
            *joined.motion,
            *shell.motion(places, height, 1),
            *shell.motion(places, height, 0, 1),
        ]
        values = joined.local.of_forms(theta, [*forms, *shell.motion_by_height(places)])
        return values.reshape(len(places), 4, -1, theta.shape[1])

    def _changes(
        self, pixels: ViewPixels, motion: Array, others: Sequence[tuple[Array, Array]]
    ) -> Array:
        """Differentiate predictions of a view by all that moves it, shape (pixel, error, column).

        That is its pose, others that move its beams, and height and thickness.
        """
        height = self.at[-2]
        place, cosine = pixels.changes(self.laser, self.outline, self.face, height, others)
        toward = pixels.cosine[:, None, None, :]
        along = np.matmul(toward, motion[:, 1:])[:, :, 0]  # (pixel, by s and t and height, column)
        change = cosine.swapaxes(1, 2) @ motion[:, 0] + place.swapaxes(1, 2) @ along[:, :2]
        by_height = change[:, -1] + along[:, 2]
        by_thickness = pixels.side * by_height / 2
        return np.concatenate([change, by_thickness[:, None]], axis=1)
