"""`scan=rectangle`: a grid of pixels over the box that four corners span (Section 3.2.1)."""

from __future__ import annotations

from dataclasses import dataclass, field

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.io import read_rectangle
from sldvexp.scan.base import ImageScan, Sampling, check_pairs, check_view_names
from sldvexp.scan.lines import rectangle, strided
from sldvexp.typing import IntArray


@dataclass
class ScanRegion:
    """Part of a view that is imaged.

    Parameters
    ----------
    corners : list of pairs
        Four, in any order, DAC steps (up_down, left_right). The box that holds them is scanned.
    path : str
        A legacy file of them, with rows and columns (`ScanRect`), instead.
    """

    corners: list[list[int]] = field(default_factory=list)
    path: str = ""


@register("scan", "rectangle")
@dataclass
class Rectangle(ImageScan):
    """A region of interest as rows (along up_down) and columns (along left_right) of pixels.

    Parameters
    ----------
    views : dict of str to ScanRegion
    pixels : list of 2 int
        Rows and columns, spread evenly over the box.
    stride : int, optional
        Steps between neighbouring pixels, instead; 1 scans contiguously. With neither of the two
        each view's file says its rows and columns.
    sampling : Sampling
    """

    views: dict[str, ScanRegion] = field(default_factory=dict)
    pixels: list[int] = field(default_factory=list)
    stride: int | None = None
    sampling: Sampling = field(default_factory=Sampling)

    def __post_init__(self) -> None:
        checks = Checks()
        check_view_names(checks, self.views)
        both = bool(self.pixels) and self.stride is not None
        checks.require(not both, "pixels", "give either pixels or stride, not both")
        good = len(self.pixels) in (0, 2) and all(n >= 1 for n in self.pixels)
        message = f"must be two positive numbers, rows and columns, not {self.pixels}"
        checks.require(good, "pixels", message)
        stride = 1 if self.stride is None else self.stride
        checks.require(stride >= 1, "stride", f"must be 1 or more, not {stride}")
        for name, region in self.views.items():
            key = f"views.{name}"
            check_pairs(checks, key, "corners", region.corners, region.path, count=4)
            sized = bool(self.pixels or self.stride is not None or region.path)
            told = "has corners only: give pixels: [rows, columns], or stride"
            checks.require(sized, key, told)
        self.sampling.check(checks, "sampling")
        checks.done()

    def grid(self, view: str) -> IntArray:
        """Lay the pixels of a view, shape (row, column, 2), DAC steps.

        Raises
        ------
        UserError
            If the box has fewer steps than there should be rows or columns.
        """
        region = self.views[view]
        corners, pixels = region.corners, self.pixels
        if region.path:
            rows, columns, found = read_rectangle(locate(region.path))
            corners, pixels = found.tolist(), self.pixels or [rows, columns]
        if self.stride is not None:
            return strided(corners, self.stride)
        grid = rectangle(corners, *pixels)
        for n, wanted, mirror in zip(grid.shape, pixels, ("up_down", "left_right"), strict=False):
            if n < wanted:
                raise UserError(
                    f"scan: the corners of the view {view} span {n} steps of {mirror}, fewer than "
                    f"the {wanted} pixels along it; take fewer, or corners further apart"
                )
        return grid

    def lines(self, view: str) -> list[IntArray]:
        """See `ImageScan`; every row is a line."""
        return list(self.grid(view))

    def shape(self, view: str) -> tuple[int, int] | None:
        """See `ImageScan`."""
        rows, columns, _ = self.grid(view).shape
        return rows, columns
