"""`scan=calibration`: lines across the circles of a calibration object, coarse and then fine."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from types import MappingProxyType
from typing import ClassVar, Self

import numpy as np

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.geometry import KnownPose
from sldvexp.io import read_centres
from sldvexp.laser import TwoMirror
from sldvexp.scan.base import (
    Sampling,
    ScanPart,
    aim_points,
    check_pairs,
    check_rough_pose,
    check_view_names,
)
from sldvexp.targets import Circles, Target
from sldvexp.targets.shadows import SPAN, turned_away
from sldvexp.typing import Array, IntArray

#: Steps of the smaller range of a mirror's board: no line has more pixels.
MOST_PIXELS = 8193
#: Stride of coarse lines over that of fine ones, at most: an ellipse of coarse lines is placed to a
#: few of their pixels, and the fine lines must still meet the edge.
COARSER = 4
#: Remedy where a circle is turned away: the pose of a view rests on all of them.
STAND_BEFORE_ALL = "the scan needs all circles: stand where all are seen, or correct the rough pose"
#: Steps of a board whose lines are contiguous; one of more steps takes so many times the stride.
CONTIGUOUS = 8192


def usual_stride(laser: TwoMirror) -> int:
    """Count the steps from one pixel of a fine line to the next: 1 of 12 bits, 8 of 16 bits.

    Examples
    --------
    >>> usual_stride(TwoMirror())
    1
    """
    low, high = laser.board.value
    return max(1, round((high - low) / CONTIGUOUS))


class EdgeMethod(Enum):
    """How an edge is placed: at a pixel, or between pixels in one of two ways."""

    pixel = "pixel"
    gradient = "gradient"
    profile = "profile"


@dataclass
class CircleLines:
    """Scan lines of one stage across each circle.

    Parameters
    ----------
    lines : int
    pixels : int
        Of each line.
    window : int
        Of the median filter along the line, pixels.
    stride : int, optional
        DAC steps from one pixel to the next. Without it as many as the circle needs that a rough
        pose predicts, or that of three rough centres or more with their circles' numbers; where
        only rough centres are given 1, and 8 on a 16-bit board.
    """

    lines: int
    pixels: int
    window: int
    stride: int | None = None

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what is wrong."""
        checks.require(self.lines >= 3, f"{name}.lines", f"must be at least 3, not {self.lines}")
        check_line(checks, name, self.pixels, self.window, self.stride)


def check_line(checks: Checks, name: str, pixels: int, window: int, stride: int | None) -> None:
    """Note under `name` what is wrong with scan lines that are to cross an edge."""
    checks.require(pixels >= 9, f"{name}.pixels", f"must be at least 9, not {pixels}")
    most = f"must be at most the {MOST_PIXELS} steps of a mirror, not {pixels}"
    checks.require(pixels <= MOST_PIXELS, f"{name}.pixels", most)
    forward = f"must be at least 1, not {stride}"
    checks.require(stride is None or stride >= 1, f"{name}.stride", forward)
    odd = f"must be odd and shorter than the line, not {window}"
    good = window % 2 == 1 and 0 < window < pixels
    checks.require(good, f"{name}.window", odd)


@dataclass
class Centres:
    """Rough centres of a view's circles, in any order, in DAC steps (up_down, left_right).

    Parameters
    ----------
    dac : list of pairs
    path : str
        A legacy file of them (`Scan6pt`), instead.
    circles : list of int
        Numbers of the target's circles at these, in their order, as far as is known: so they are
        called, and three or more tell how wide the circles are seen. Without them a rough centre
        is called by its steps.
    pose : KnownPose, optional
        Where the instrument roughly stands, instead: it predicts the circles of the group
        ``target``, which are searched from there.
    """

    dac: list[list[int]] = field(default_factory=list)
    path: str = ""
    pose: KnownPose | None = None
    # Kept lines stay those of the same configuration, also of a time before there were numbers.
    circles: list[int] = field(default_factory=list, repr=False)


@register("scan", "calibration")
@dataclass
class CalibrationScan(ScanPart):
    """Dissertation's coarse and fine lines across each circle (Section 4.5.2).

    Parameters
    ----------
    views : dict of str to Centres
        Rough centres of the circles in each view, or a rough pose that predicts them.
    margin : float, m
        How far from where a rough pose predicts it a circle may be, at its own distance.
    coarse : CircleLines
        Across the whole circle, through its rough centre.
    fine : CircleLines
        Across the edge, around the coarse ellipse.
    edge : EdgeMethod
        For the fine lines: the profile of a finite spot, a parabola around the pixel of the largest
        gradient, or that pixel itself, as the dissertation does.
    sampling : Sampling
    """

    kind: ClassVar[str] = "circles"

    views: dict[str, Centres] = field(default_factory=dict)
    coarse: CircleLines = field(default_factory=lambda: CircleLines(3, 300, 25))
    fine: CircleLines = field(default_factory=lambda: CircleLines(44, 25, 5))
    edge: EdgeMethod = EdgeMethod.profile
    sampling: Sampling = field(default_factory=Sampling)
    margin: float = 0.08

    def __post_init__(self) -> None:
        checks = Checks()
        check_view_names(checks, self.views)
        for name, centres in self.views.items():
            key, pose = f"views.{name}", centres.pose
            if pose is None:
                told = "give dac, path, or a rough pose, one of them"
                check_pairs(checks, key, "dac", centres.dac, centres.path, told=told)
            else:
                alone = not (centres.dac or centres.path)
                checks.require(alone, key, "give dac, path, or a rough pose, one of them")
                check_rough_pose(checks, f"{key}.pose", pose)
            self._check_numbers(checks, key, centres)
        checks.positive("margin", self.margin)
        self.coarse.check(checks, "coarse")
        self.fine.check(checks, "fine")
        self.sampling.check(checks, "sampling")
        told = "must be sine: the edges of circles are found by the phase of one frequency"
        checks.require(not self.sampling.broadband, "sampling.excitation", told)
        checks.done()

    @staticmethod
    def _check_numbers(checks: Checks, key: str, centres: Centres) -> None:
        """Note under `key` numbers of circles that are not one for each rough centre."""
        numbers = centres.circles
        each = len(numbers) == len(centres.dac) and len(set(numbers)) == len(numbers)
        told = f"must be one number for each pair of {key}.dac, none twice, not {numbers}"
        checks.require(not numbers or each, f"{key}.circles", told)

    def in_steps(
        self,
        laser: TwoMirror,
        target: Target | None,
        poses: Mapping[str, KnownPose] = MappingProxyType({}),
    ) -> Self:
        """See `Scan`; the centres where the rough poses predict them."""
        views = {
            name: Centres(self.predicted(name, laser, target).tolist()) if centres.pose else centres
            for name, centres in self.views.items()
        }
        return replace(self, views=views)

    def predicted(self, view: str, laser: TwoMirror, target: Target | None) -> IntArray:
        """Predict the circles' centres by a view's rough pose, shape (circle, 2), steps.

        Raises
        ------
        UserError
            If there are no circles, or one of them cannot be reached or is turned away.
        """
        pose = self.views[view].pose
        assert pose is not None
        if not isinstance(target, Circles):
            raise UserError(
                f"scan: the rough pose of the view {view} predicts circles, but target has none; "
                "choose target=dissertation or another target of circles"
            )
        for number, plane in turned_away(pose.place, target).items():
            raise UserError(
                f"scan: in the view {view}, circle {number} is not seen, since its plane {plane} "
                f"is turned away; {STAND_BEFORE_ALL}"
            )
        names = [f"circle {number}" for number in target.circles]
        steps = aim_points(view, target.outlines().mean(axis=1), names, pose, laser)
        return np.rint(steps).astype(np.int64)

    def strides(self, laser: TwoMirror, half_chord: Array | None = None) -> tuple[IntArray, int]:
        """Choose the strides of coarse and fine lines across a circle, where they are not set.

        Parameters
        ----------
        half_chord : ndarray, shape (line,), steps, optional
            How far the circle's edge is from its middle along each coarse line, by the mirror that
            moves faster.

        Returns
        -------
        coarse : ndarray of int, shape (line,)
        fine : int

        Examples
        --------
        A circle of 40 mm at 1.3 m is 290 steps of 12 bits wide, and 300 pixels do not reach across:

        >>> CalibrationScan().strides(TwoMirror(), np.array([145.0, 90, 90]))
        (array([2, 1, 1]), 1)
        """
        usual = usual_stride(laser)
        coarse = np.full(self.coarse.lines, self.coarse.stride or usual)
        if half_chord is not None and self.coarse.stride is None:
            coarse = self.strides_across(half_chord)
        return coarse, self.fine.stride or max(usual, -(-int(coarse.max()) // COARSER))

    def strides_across(self, half_chord: Array) -> IntArray:
        """Choose strides with which coarse lines reach well beyond a circle, shape (line,)."""
        return np.maximum(np.ceil(SPAN * half_chord / (self.coarse.pixels // 2)), 1).astype(int)

    def centres(self, view: str) -> IntArray:
        """Return rough centres of a view's circles, shape (circle, 2), steps."""
        given = self.views[view]
        return read_centres(locate(given.path)) if given.path else np.array(given.dac, np.int64)

    def known_pixels(self, view: str) -> IntArray:
        """See `ScanPart`; the rough centres."""
        return self.centres(view)

    def pixel_count(self, view: str) -> int:
        """See `ScanPart`."""
        stages = (self.coarse, self.fine)
        return len(self.centres(view)) * sum(stage.lines * stage.pixels for stage in stages)
