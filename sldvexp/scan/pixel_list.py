"""`scan=list`: any pixels, one by one (the legacy `ScanList`, Appendix A)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Self

import numpy as np

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.geometry import KnownPose
from sldvexp.io import read_list
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
from sldvexp.targets import Target
from sldvexp.typing import IntArray
from sldvexp.units import LengthUnit

GIVEN = "give dac, path, or a rough pose and pixels_at, one of them"

#: Pixels that are scanned and kept at a time.
LINE = 64


@dataclass
class PixelSequence:
    """Pixels of a view, in the order of the scan, DAC steps (up_down, left_right).

    Parameters
    ----------
    dac : list of pairs
    path : str
        A legacy file of them (`ScanList`), instead.
    pose : KnownPose, optional
        Where the instrument roughly stands, instead: it predicts the steps of `pixels_at`.
    pixels_at : list of list of 3 float
        Points of the world, one for each pixel.
    """

    dac: list[list[int]] = field(default_factory=list)
    path: str = ""
    pose: KnownPose | None = None
    pixels_at: list[Any] = field(default_factory=list)


@register("scan", "list")
@dataclass
class PixelList(ImageScan):
    """A list of pixels for each view.

    Parameters
    ----------
    views : dict of str to PixelSequence
    sampling : Sampling
    unit : LengthUnit
        Of pixels_at.
    """

    views: dict[str, PixelSequence] = field(default_factory=dict)
    sampling: Sampling = field(default_factory=Sampling)
    unit: LengthUnit = LengthUnit.m

    def __post_init__(self) -> None:
        checks = Checks()
        check_view_names(checks, self.views)
        for name, pixels in self.views.items():
            key = f"views.{name}"
            if pixels.pose is None and not pixels.pixels_at:
                check_pairs(checks, key, "dac", pixels.dac, pixels.path, told=GIVEN)
                continue
            whole = pixels.pose is not None and bool(pixels.pixels_at)
            checks.require(whole and not (pixels.dac or pixels.path), key, GIVEN)
            if pixels.pose:
                check_rough_pose(checks, f"{key}.pose", pixels.pose)
                check_points(checks, f"{key}.pixels_at", pixels.pixels_at, 1)
        self.sampling.check(checks, "sampling")
        checks.done()

    def in_steps(
        self,
        laser: TwoMirror,
        target: Target | None,
        poses: Mapping[str, KnownPose] = MappingProxyType({}),
    ) -> Self:
        """See `Scan`; every pixel where its point is seen."""
        views = dict(self.views)
        for name, pixels in self.views.items():
            if pixels.pose:
                points = self.unit.value * np.array(pixels.pixels_at, float)
                names = [
                    f"pixel {n} at {tuple(p)} {self.unit.name}"
                    for n, p in enumerate(pixels.pixels_at, 1)
                ]
                steps = aim_points(name, points, names, poses.get(name, pixels.pose), laser)
                views[name] = PixelSequence(np.rint(steps).astype(np.int64).tolist())
        return replace(self, views=views)

    def lines(self, view: str) -> list[IntArray]:
        """See `ImageScan`; every `LINE` pixels are a line."""
        given = self.views[view]
        dac = read_list(locate(given.path)) if given.path else np.array(given.dac, np.int64)
        return [dac[first : first + LINE] for first in range(0, len(dac), LINE)]
