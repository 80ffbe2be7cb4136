"""Contract of every interpolation: weights of the pixels, and why there may be none.

An interpolated value is a sum of weights times pixel values, ``v = W v_pixel``. From the sparse W
follow the value, its standard error and the correlation of samples that share pixels.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Protocol

from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, ComplexArray


class ImagePixels(Protocol):
    """Pixels and their accuracy, as far as interpolation needs a velocity image.

    Pixels that are not usable have no say; in place of those that `dropped` out one by one stand
    the pixels around, on a lattice.
    """

    @property
    def name(self) -> str: ...
    @property
    def dac(self) -> Array: ...
    @property
    def velocity(self) -> ComplexArray: ...
    @property
    def std(self) -> Array: ...
    @property
    def usable(self) -> BoolArray: ...
    @property
    def dropped(self) -> BoolArray: ...
    @property
    def shape(self) -> tuple[int, int] | None: ...


@dataclass(frozen=True, eq=False)
class PixelWeights:
    """Weights of the pixels at some places.

    Parameters
    ----------
    value : csr_array, shape (place, pixel)
        A row sums to one; it is empty where there is no value.
    gradient : pair of csr_array, shape (place, pixel), 1/step
        Derivatives of `value` by the up_down and by the left_right step; rows sum to zero.
    outside, flagged : ndarray of bool, shape (place,)
        Why there is no value.
    """

    value: scipy.sparse.csr_array
    gradient: tuple[scipy.sparse.csr_array, scipy.sparse.csr_array]
    outside: BoolArray
    flagged: BoolArray


class Interpolator(ABC):
    """Interpolates in one image."""

    @abstractmethod
    def at(self, dac: Array) -> PixelWeights:
        """Find weights at places of the image.

        Parameters
        ----------
        dac : ndarray, shape (place, 2), steps
        """
