"""Few responses that hold all signal: real singular vectors above the edge of the noise.

All pixels' responses, whitened and split into real and imaginary parts, are a matrix of n rows and
m = 2 lines columns, ``Y = Theta + E`` with E of unit variance. Singular values of E alone lie below
``sqrt(n) + sqrt(m)`` (Marchenko and Pastur); those above belong to the signal. A real mix of rows
keeps the model as it is, since that is linear in real coefficients.

A signal of strength theta is found with ``s^2 = (theta^2 + n)(theta^2 + m) / theta^2``, and its
response has noise of variance ``(1 + n / theta^2)^2``, for its direction was chosen from the same
noise (Benaych-Georges and Nadakuditi). Responses are divided by that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.modes.model import split
from sldvexp.modes.responses import Responses
from sldvexp.typing import Array, ComplexArray

#: Margin of the edge, for matrices that are not infinitely large.
MARGIN = 1.02


@dataclass(frozen=True, eq=False)
class PrincipalResponses:
    """Responses whose lines have noise of unit variance in each part.

    Parameters
    ----------
    frequency : ndarray, shape (line,), Hz
    values : ndarray of complex, shape (response, line)
        Weighted: the model of a line is multiplied by its weight.
    weight : ndarray, shape (line,)
    noise_ratio : float
        Root of the variance of what is left over, over the stated one.
    pixels : int
        How many response functions there were.
    correlation : ndarray, shape (2 line, 2 line), optional
        Of the noise of real, then imaginary parts of the lines, if these are not independent.
    """

    frequency: Array
    values: ComplexArray
    weight: Array
    noise_ratio: float
    pixels: int
    correlation: Array | None = None

    @property
    def omega(self) -> Array:
        """Lines, rad/s."""
        return 2 * np.pi * self.frequency

    def covariance(self, slope: Array) -> Array:
        """Compute the covariance of what least squares find with some derivatives of the lines.

        Parameters
        ----------
        slope : ndarray, shape (2 line response, unknown)
            Of the values of all responses, line by line.
        """
        inverse = np.asarray(np.linalg.pinv(slope.T @ slope), float)
        if self.correlation is None:
            return inverse
        by_line = slope.reshape(len(self.correlation), -1, slope.shape[1])
        spread = np.tensordot(self.correlation, by_line, axes=1).reshape(slope.shape)
        return np.asarray(inverse @ (slope.T @ spread) @ inverse, float)

    def weighted(self, rows: Array) -> Array:
        """Weight rows of real, then of imaginary parts, as of the model's `basis`."""
        return np.tile(self.weight, 2)[:, None] * rows


def compress(responses: Responses) -> PrincipalResponses:
    """Find the principal responses of all views' pixels.

    The triangle of a QR decomposition stands for the rows read so far: it keeps small signals,
    which the matrix of their products would lose.

    Examples
    --------
    A strip that bends at 100 Hz with 1 % of damping, seen by 50 pixels on 60 lines:

    >>> import numpy as np
    >>> from sldvexp import dataset, modes
    >>> rng, line = np.random.default_rng(1), np.linspace(80, 120, 60)
    >>> shape, noise = np.sin(np.linspace(0, 3, 50)), 1e-5
    >>> r = line / 100
    >>> seen = 1e-3 * np.outer(shape, 0.02j * r / (1 - r**2 + 0.02j * r))
    >>> seen = seen + noise * (rng.normal(size=seen.shape) + 1j * rng.normal(size=seen.shape))
    >>> coords = {"pixel": np.arange(50), "frequency": line}
    >>> front = dataset.group(
    ...     "image",
    ...     coords,
    ...     velocity=seen,
    ...     velocity_std=np.full(seen.shape, noise),
    ...     dac=np.zeros((50, 2)),
    ...     flags=np.zeros(50, int),
    ... )
    >>> modes.compress(modes.Responses.from_images({"front": front})).values.shape
    (1, 60)
    """
    pixel_std, line_std = responses.noise()
    columns = 2 * len(line_std)
    triangle, count = np.zeros((0, columns)), 0
    for view in responses.views():
        white = view.velocity / (pixel_std[view.name][:, None] * line_std)
        rows = np.concatenate([triangle, split(white.T).T])
        count += len(white)
        triangle = rows
        if len(rows) > columns:
            triangle = scipy.linalg.qr(rows, mode="r", overwrite_a=True, check_finite=False)[0]
            triangle = triangle[:columns]
    size, vectors = np.linalg.svd(triangle, full_matrices=False)[1:]
    signals, ratio = _signals(size, count, columns)
    scale = max(1.0, ratio)
    size = size[:signals] / scale
    found = (size / _excess(size, count, columns))[:, None] * vectors[:signals]
    lines = len(line_std)
    values = found[:, :lines] + 1j * found[:, lines:]
    return PrincipalResponses(
        responses.frequency, values, 1 / line_std, ratio, count, responses.correlation
    )


def _signals(size: Array, rows: int, columns: int) -> tuple[int, float]:
    """Count the singular values beyond the noise, and compare its level with the stated one.

    The noise is what these leave over; it is taken to be at least as large as stated.
    """
    left = np.cumsum((size**2)[::-1])[::-1]
    edge = MARGIN * (np.sqrt(rows) + np.sqrt(columns))
    for count in range(len(size)):
        ratio = float(np.sqrt(left[count] / ((rows - count) * (columns - count))))
        if size[count] <= max(1.0, ratio) * edge:
            return count, ratio
    return len(size), 0.0


def _excess(size: Array, rows: int, columns: int) -> Array:
    """Compute the noise of responses, ``1 + n / theta^2``, from their singular values."""
    rest = size**2 - rows - columns
    strength = (rest + np.sqrt(np.maximum(rest**2 - 4.0 * rows * columns, 0.0))) / 2
    return np.asarray(1 + rows / strength)
