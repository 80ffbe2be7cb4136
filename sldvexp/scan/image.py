"""What scans have in common that give a velocity image of each view."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from sldvexp.scan.base import ScanPart
from sldvexp.typing import IntArray


class ImageScan(ScanPart):
    """Base of the scans whose pixels are known beforehand; `lines` is what they add."""

    kind: ClassVar[str] = "image"

    @abstractmethod
    def lines(self, view: str) -> list[IntArray]:
        """Pixels of a view line by line; a session that was cut off repeats at most one line.

        Returns
        -------
        list of ndarray of int, shape (pixel, 2)
            DAC steps (up_down, left_right).

        Raises
        ------
        UserError
            If a file is not in order, or there are no such pixels.
        """

    def shape(self, view: str) -> tuple[int, int] | None:
        """Rows and columns, if the pixels are a grid."""
        return None

    def known_pixels(self, view: str) -> IntArray:
        """See `ScanPart`; all of them."""
        return np.concatenate(self.lines(view))

    def pixel_count(self, view: str) -> int:
        """See `ScanPart`."""
        return sum(map(len, self.lines(view)))
