"""Correlation of the noise of neighbouring lines, where records have a window.

Lines k and l of a record of T seconds have, with a window w, noise of the correlation

    rho = sum w^2 exp(-2 pi i (k - l) n / N) / sum w^2:

of ``exp(-t / tau)``, from a hit at the time t_0 on, ``exp(2 pi i (k - l) t_0 / T) / (1 + i pi (k -
l) tau / T)``. Of noise with Hann's window, ``Sxy / Sxx`` has the product of the reference's and the
response's, (2/3)^2 and (1/6)^2 for the next two lines. Poles and shapes are found as if lines were
independent; their covariance is then, with weights B of the lines, ``B S B'`` of the correlation S.
"""

from __future__ import annotations

import numpy as np

from sldvexp.lazy import xarray as xr
from sldvexp.signal.excitation import BEFORE_PULSE
from sldvexp.typing import Array, ComplexArray

#: Correlation of response functions of noise with Hann's window, by how many lines are between.
HANN = (1.0, 4 / 9, 1 / 36)


def line_correlation(image: xr.Dataset, frequency: Array) -> ComplexArray | None:
    """Compute the correlation of lines of an image; None if it is none.

    Parameters
    ----------
    image : xarray.Dataset
        Its attributes tell the excitation, the record and the window.
    frequency : ndarray, shape (line,), Hz

    Examples
    --------
    >>> from sldvexp.lazy import xarray as xr
    >>> noise = xr.Dataset(attrs={"excitation": "random", "record_seconds": 0.5})
    >>> line_correlation(noise, np.array([10.0, 12.0, 16.0])).real.round(2).tolist()
    [[1.0, 0.44, 0.0], [0.44, 1.0, 0.03], [0.0, 0.03, 1.0]]
    """
    seconds, decay = image.attrs.get("record_seconds"), image.attrs.get("window_decay", 0.0)
    if seconds is None or not (decay or image.attrs.get("excitation") == "random"):
        return None
    apart = (frequency[:, None] - frequency) * seconds
    if decay:
        turned = np.exp(2j * np.pi * apart * BEFORE_PULSE)
        return np.asarray(turned / (1 + 1j * np.pi * apart * decay / seconds), complex)
    steps = np.rint(abs(apart)).astype(int)
    known = np.array([*HANN, 0.0])
    return known[np.minimum(steps, len(HANN))].astype(complex)


def of_parts(correlation: ComplexArray) -> Array:
    """Write a correlation of complex numbers as that of real parts, then of imaginary ones."""
    return np.block([[correlation.real, -correlation.imag], [correlation.imag, correlation.real]])
