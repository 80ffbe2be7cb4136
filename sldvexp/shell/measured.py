"""Velocities of the pixels that see a structure, and their noise.

Noise that differs by pixel and by frequency is taken as a product of both; where views state none,
it is what splines without priors leave over.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sldvexp.errors import UserError
from sldvexp.shell.love import ThinShell
from sldvexp.shell.pixels import ViewPixels
from sldvexp.typing import Array, ComplexArray

#: Standard error of a pixel, over the largest velocity, below which it is taken as unknown.
EXACT = 1e-9
#: Pixels whose equations are in memory together.
TOGETHER = 4096


@dataclass(frozen=True, eq=False)
class Measured:
    """Velocities of all views' pixels, and their noise as a product of pixel and frequency.

    Attributes
    ----------
    images : sequence of array, shape (pixel, frequency) each, m/s
        Velocities of all pixels of each view, which are read some pixels at a time.
    pixel_std : ndarray, shape (pixel,), m/s
        Of those that see the structure, of all views one after the other.
    scale : ndarray, shape (frequency,)
    stated : bool
        False where the views state no noise and it is taken from the residuals.
    """

    images: Sequence[Any]
    pixel_std: Array
    scale: Array
    stated: bool

    @classmethod
    def of(
        cls,
        images: Sequence[Any],
        std: Sequence[Any],
        pixels: Sequence[ViewPixels],
        shell: ThinShell,
        face: float,
    ) -> Measured:
        """Find the noise of the pixels of all views.

        Parameters
        ----------
        images : sequence of array, shape (pixel, frequency) each, m/s
        std : sequence of array, shape (pixel,) or (pixel, frequency) each, m/s

        Raises
        ------
        UserError
            If nothing moves.
        """
        sizes = [_size(images[k], block) for k, _, block in blocks(pixels)]
        largest = max(sizes, default=0.0)
        if largest == 0:
            raise UserError(
                "all pixels that meet the surface are at rest: there is no motion to fit"
            )
        lines, count = images[0].shape[1], sum(len(p.pixel) for p in pixels)
        own = [_std_of(std[k], block, lines) for k, _, block in blocks(pixels)]
        if min(float(part.min()) for part in own) <= EXACT * largest:
            left = _left_over(pixels, shell, face, images, largest)
            return cls(images, np.full(count, left), np.ones(lines), False)
        by_frequency = np.sqrt(sum((part**2).sum(axis=0) for part in own) / count)
        scale = by_frequency / np.sqrt(np.mean(by_frequency**2))
        by_pixel = [np.sqrt(np.mean((part / scale) ** 2, axis=1)) for part in own]
        return cls(images, np.concatenate(by_pixel), scale, True)

    def velocity(self, k: int, block: ViewPixels) -> ComplexArray:
        """Read the velocities of some pixels of a view, shape (pixel, frequency), m/s."""
        return np.asarray(self.images[k][block.pixel], complex)

    def over_noise(self, values: ComplexArray, some: slice) -> Array:
        """Divide by the noise and sum squares over the frequencies, shape (pixel,).

        Parameters
        ----------
        values : ndarray, shape (pixel, frequency), m/s
        some : slice
            Which of all pixels they are of.
        """
        each = (values.real**2 + values.imag**2) @ (1.0 / self.scale**2)
        return np.asarray(each / self.pixel_std[some] ** 2)


def blocks(pixels: Sequence[ViewPixels]) -> Iterator[tuple[int, slice, ViewPixels]]:
    """Give the number of a view, some of all views' pixels, and these pixels, few at a time."""
    before = 0
    for k, of_view in enumerate(pixels):
        for start in range(0, len(of_view.pixel), TOGETHER):
            block = of_view.part(slice(start, start + TOGETHER))
            yield k, slice(before + start, before + start + len(block.pixel)), block
        before += len(of_view.pixel)


def _size(image: Any, block: ViewPixels) -> float:
    """Find the largest velocity of some pixels, m/s."""
    return float(np.abs(np.asarray(image[block.pixel])).max(initial=0.0))


def _std_of(std: Any, block: ViewPixels, lines: int) -> Array:
    """Collect standard errors of some pixels at every frequency, m/s."""
    own = np.asarray(std[block.pixel], float)
    return np.broadcast_to(own.reshape(len(own), -1), (len(own), lines))


def _left_over(
    pixels: Sequence[ViewPixels],
    shell: ThinShell,
    face: float,
    images: Sequence[Any],
    largest: float,
) -> float:
    """Estimate the noise, m/s, from what splines without any prior leave over."""
    lines = images[0].shape[1]
    normal = np.zeros((shell.coefficients,) * 2)
    right = np.zeros((shell.coefficients, lines), complex)
    for k, _, block in blocks(pixels):
        design = block.design(shell, face)
        normal += design.T @ design
        right += design.T @ np.asarray(images[k][block.pixel], complex)
    values, vectors = np.linalg.eigh(normal)
    known = values > 1e-14 * values.max()
    theta = vectors[:, known] @ ((vectors[:, known].T @ right) / values[known, None])
    left, count = 0.0, 0
    for k, _, block in blocks(pixels):
        velocity = np.asarray(images[k][block.pixel], complex)
        rest = velocity - block.design(shell, face) @ theta
        left, count = left + float((np.abs(rest) ** 2).sum()), count + len(rest)
    free = max(count - int(known.sum()), 1)
    least = EXACT * largest  # exact data have no noise, but round-off
    return float(max(np.sqrt(left / (2 * free * lines)), least))
