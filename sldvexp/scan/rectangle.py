"""`scan=rectangle`: a grid of pixels over the box that four corners span (Section 3.2.1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.geometry import KnownPose
from sldvexp.io import read_rectangle
from sldvexp.laser import TwoMirror
from sldvexp.scan.base import (
    ImageScan,
    Sampling,
    aim_points,
    check_pairs,
    check_points,
    check_rough_pose,
    check_view_names,
)
from sldvexp.scan.lines import box_corners, rectangle, strided
from sldvexp.targets import Target
from sldvexp.typing import IntArray
from sldvexp.units import LengthUnit

GIVEN = "give corners, path, or a rough pose and corners_at, one of them"
#: Points on each edge of a region, of which one is a corner.
EDGE = 16


@dataclass
class ScanRegion:
    """Part of a view that is imaged.

    Parameters
    ----------
    corners : list of pairs
        Four, in any order, DAC steps (up_down, left_right). The box that holds them is scanned.
    path : str
        A legacy file of them, with rows and columns (`ScanRect`), instead.
    pose : KnownPose, optional
        Where the instrument roughly stands, instead: it predicts the steps of `corners_at`.
    corners_at : list of list of 3 float
        Corners of the region in the world, in order around it; without them those of the scan. Of
        four the box has the numbers, on the page of the console too.
    """

    corners: list[list[int]] = field(default_factory=list)
    path: str = ""
    pose: KnownPose | None = None
    corners_at: list[Any] = field(default_factory=list)


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
    corners_at : list of list of 3 float
        Corners of the region in the world, three or more in order around it, for all views that
        have a rough pose; of a body those around its front, then those around its back. The box
        that holds the region as seen is scanned.
    margin : float
        How far the box goes beyond it, as a rough pose predicts it a little beside its place. In a
        session whose circles the pose predicts too they correct it before, so that none is needed.
    unit : LengthUnit
        Of corners_at and margin.
    """

    views: dict[str, ScanRegion] = field(default_factory=dict)
    pixels: list[int] = field(default_factory=list)
    stride: int | None = None
    sampling: Sampling = field(default_factory=Sampling)
    corners_at: list[Any] = field(default_factory=list)
    margin: float = 0.0
    unit: LengthUnit = LengthUnit.m

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
            if region.pose is None:
                check_pairs(checks, key, "corners", region.corners, region.path, 4, GIVEN)
                alone = not region.corners_at
                checks.require(alone, f"{key}.corners_at", "needs the view's rough pose beside it")
            else:
                self._check_pose(checks, key, region)
            sized = bool(self.pixels or self.stride is not None or region.path)
            told = "has corners only: give pixels: [rows, columns], or stride"
            checks.require(sized, key, told)
        self.sampling.check(checks, "sampling")
        checks.non_negative("margin", self.margin)
        checks.done()

    def _check_pose(self, checks: Checks, key: str, region: ScanRegion) -> None:
        assert region.pose is not None
        checks.require(not (region.corners or region.path), key, GIVEN)
        check_rough_pose(checks, f"{key}.pose", region.pose)
        own = f"{key}.corners_at" if region.corners_at else "corners_at"
        check_points(checks, own, self._corners_at(region), 3)

    def _corners_at(self, region: ScanRegion) -> list[Any]:
        return region.corners_at or self.corners_at

    def in_steps(
        self,
        laser: TwoMirror,
        target: Target | None,
        poses: Mapping[str, KnownPose] = MappingProxyType({}),
    ) -> Self:
        """See `Scan`; the box that holds the region as seen, its edges and not its corners alone.

        An edge that is straight in the world is bent in steps.
        """
        views = {
            name: ScanRegion(self._box(name, region, poses.get(name, region.pose), laser).tolist())
            if region.pose
            else region
            for name, region in self.views.items()
        }
        return replace(self, views=views)

    def box(self, view: str, pose: KnownPose, laser: TwoMirror) -> IntArray:
        """Predict the corners of a view's box by any pose, shape (4, 2), steps.

        Numbered as those of `corners_at` if these are four (`sldvexp.scan.lines.box_corners`); none
        if the scan has no such points.

        Raises
        ------
        UserError
            That names a corner behind the instrument, or beyond its mirrors.
        """
        region = self.views.get(view, ScanRegion())
        if not self._corners_at(region):
            return np.zeros((0, 2), np.int64)
        return self._box(view, region, pose, laser)

    def _box(self, view: str, region: ScanRegion, pose: KnownPose, laser: TwoMirror) -> IntArray:
        """Predict the corners of the box, numbered as the region's, shape (4, 2), steps."""
        corners = self.unit.value * np.array(self._corners_at(region), float)
        names = [
            f"corner {n} at {tuple(p)} {self.unit.name}"
            for n, p in enumerate(self._corners_at(region), 1)
        ]
        seen = aim_points(view, corners, names, pose, laser)
        along = np.linspace(0, 1, EDGE, endpoint=False)[:, None, None]
        edges = ((1 - along) * corners + along * np.roll(corners, -1, axis=0)).reshape(-1, 3)
        from_corner = EDGE * [f"the edge from {name}" for name in names]
        steps = aim_points(view, edges, from_corner, pose, laser)
        away = np.linalg.norm(edges - pose.place, axis=-1, keepdims=True)
        beyond = self.unit.value * self.margin / (away * laser.step)
        low, high = (steps - beyond).min(axis=0), (steps + beyond).max(axis=0)
        least, most = np.clip(np.rint([low, high]), *laser.board.value)
        return box_corners(least, most, laser.ways, seen)

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
