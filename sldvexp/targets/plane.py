"""Planes of a calibration object and the axes in which their circles are measured."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from sldvexp.errors import Checks
from sldvexp.typing import Array

#: Sine of the angle between a normal and the object's x axis below which x has no projection.
PARALLEL = 1e-6


@dataclass
class Plane:
    """A plane of features, by a point on it and its normal.

    The plane's own x axis is the projection of the object's x axis, its y axis completes the
    right-handed frame with the normal. A plane facing the viewer has its normal towards them.

    Parameters
    ----------
    origin : list of 3 float, the target's unit
        Where the plane's own coordinates are zero.
    normal : list of 3 float
        Of any length but zero.
    """

    origin: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    normal: list[float] = field(default_factory=lambda: [0.0, 0.0, 1.0])

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what makes this no plane."""
        known = len(checks.problems)
        for part in ("origin", "normal"):
            values = getattr(self, part)
            checks.finite(f"{name}.{part}", *values)
            checks.require(
                len(values) == 3, f"{name}.{part}", f"must be three numbers, not {len(values)}"
            )
        if len(checks.problems) > known:
            return
        x, y, z = self.normal
        length = math.hypot(x, y, z)
        checks.require(length > 0, f"{name}.normal", "must not be zero")
        checks.require(
            length == 0 or math.hypot(y, z) > PARALLEL * length,
            f"{name}.normal",
            "must not be along the object's x axis, whose projection is the plane's own x axis",
        )

    def axes(self) -> Array:
        """The plane's own x, y and normal as unit rows in the object's axes, shape (3, 3)."""
        normal = np.array(self.normal, float)
        normal /= np.linalg.norm(normal)
        x = np.array([1.0, 0.0, 0.0]) - normal[0] * normal
        x /= np.linalg.norm(x)
        return np.stack([x, np.cross(normal, x), normal])
