"""`check=cross_ratio`: the cross-ratio of four points, and of the mirrors' planes through them.

A projective map keeps the cross-ratio of four points on a line, ``(AC / BC) / (AD / BD)``. Mirrors
whose planes meet in one axis keep it too; an offset between the axes does not, so that the ratios
of points, slopes and angles tell how projective the instrument is (Section 4.4.3.6).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.geometry import cross_ratio
from sldvexp.lazy import xarray as xr

KINDS = ("laser points", "world points", "slopes", "angles")
IDENTITY = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]


@register("check", "cross_ratio")
@dataclass
class CrossRatio(Check):
    """Cross-ratios of four points on a line, and of the mirror planes through them (4.4.3.6).

    Parameters
    ----------
    up_down_points : 4 x 3 numbers
        A, B, C, D in the laser frame, for the up-down mirror (Section 4.4.3.8).
    left_right_points : 4 x 3 numbers
        The same with equal up-down angles, for the left-right mirror (Section 4.4.3.9).
    laser_to_world : 4 x 4 numbers
        Homogeneous matrix for row vectors, ``P_world = P_laser T``, as the dissertation prints it.
    mirror_offset : float
        In the points' unit.
    """

    up_down_points: Any = None
    left_right_points: Any = None
    laser_to_world: Any = field(default_factory=lambda: [list(r) for r in IDENTITY])
    mirror_offset: float = 0.0

    def __post_init__(self) -> None:
        checks = Checks()
        for name, rows, columns in (
            ("up_down_points", 4, 3),
            ("left_right_points", 4, 3),
            ("laser_to_world", 4, 4),
        ):
            table = getattr(self, name)
            checks.require(
                _is_table(table, rows, columns), name, f"must be {rows} x {columns} numbers"
            )
        checks.non_negative("mirror_offset", self.mirror_offset)
        checks.done()

    def examine(self, run: Examination) -> xr.Dataset:
        """Find ``up_down (kind)``, ``left_right (kind)``, all equal if mirrors are projective."""
        up_down, left_right = (
            np.array(points, float) for points in (self.up_down_points, self.left_right_points)
        )
        if not (up_down[:, 2] > 0).all():
            raise UserError("check.cross_ratio: the up-down points must be in front, z above zero")
        slope_up_down = up_down[:, 1] / up_down[:, 2]  # Eq 4.13
        reach = np.hypot(left_right[:, 1], left_right[:, 2]) + self.mirror_offset
        slope_left_right = left_right[:, 0] / reach  # Eq 4.15, the offset outside the root
        return dataset.group(
            "examined/cross_ratio",
            {"kind": list(KINDS)},
            up_down=self._ratios(up_down, slope_up_down),
            left_right=self._ratios(left_right, slope_left_right),
        )

    def _ratios(self, points: np.ndarray, slopes: np.ndarray) -> list[float]:
        """Compute one cross-ratio of each of `KINDS`."""
        homogeneous = np.hstack([points, np.ones((4, 1))])
        world = (homogeneous @ np.array(self.laser_to_world, float))[:, :3]
        return [
            float(cross_ratio.from_points(points)),
            float(cross_ratio.from_points(world)),
            float(cross_ratio.from_slopes(slopes)),
            float(cross_ratio.from_angles(np.arctan(slopes))),
        ]


def _is_table(table: Any, rows: int, columns: int) -> bool:
    """Tell whether nested lists hold so many finite numbers."""
    return (
        isinstance(table, list)
        and len(table) == rows
        and all(isinstance(row, list) and len(row) == columns for row in table)
        and all(isinstance(x, int | float) and math.isfinite(x) for row in table for x in row)
    )
