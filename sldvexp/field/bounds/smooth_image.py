"""Smooth velocity images, whose slopes are not those of the noise.

An image is fitted by products of Chebyshev polynomials over its mirrors' steps, of the degree with
the smallest generalised cross-validation ``n SSE / (n - p)^2``: the mean square error with which a
pixel is predicted by the others. Assumed: noise of equal size in all pixels of a view.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev

from sldvexp.field.visibility.view import View
from sldvexp.typing import Array

#: Largest degree along each mirror, five or six waves across the image.
LARGEST_DEGREE = 14
#: Fewest pixels for each coefficient.
PIXELS_EACH = 3


def smooth_image(view: View, data: Array) -> Array:
    """Fit the columns of a view's image, shape (pixel, column); 0 where flagged.

    Parameters
    ----------
    data : ndarray, shape (pixel, column), m/s
    """
    usable = view.usable
    dac, values = view.dac[usable], data[usable]
    low, size = dac.min(axis=0), np.ptp(dac, axis=0)
    x = 2 * (dac - low) / np.where(size > 0, size, 1.0) - 1
    count, best, found = len(x), np.inf, values
    for degree in range(0, LARGEST_DEGREE + 1, 2):
        coefficients = (degree + 1) ** 2
        if coefficients * PIXELS_EACH > count and degree:
            break
        q = np.linalg.qr(chebyshev.chebvander2d(x[:, 0], x[:, 1], [degree, degree]))[0]
        fitted = q @ (q.T @ values)
        score = np.sum((values - fitted) ** 2) / (count - coefficients) ** 2
        if score < best:
            best, found = score, fitted
    smoothed = np.zeros_like(data)
    smoothed[usable] = found
    return smoothed
