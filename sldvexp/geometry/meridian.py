"""Meridian of a surface of revolution: the curve that turns about an axis.

Its points are (r, y), the distance from the axis and the place along it. A quintic spline through
them runs over the parameter t, the length of the chords, from minus half to half of it; beyond its
ends the curve goes on as a parabola, since kinks of its curvature would strain whatever moves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.typing import Array

#: Degree of its splines, so that its curvature changes smoothly.
DEGREE = 5
#: Order of the highest derivative that goes on beyond the ends.
BENT = 2
#: Parts of a bent curve between which places near it are looked for.
PARTS = 64
#: Steps to the nearest place, and the change of the parameter that ends them, over the length.
STEPS, SETTLED = 30, 1e-13


@dataclass(frozen=True, eq=False)
class Meridian:
    """Curve through points of a half-plane that ends at the axis.

    Parameters
    ----------
    corners : ndarray, shape (point, 2), m
        (r, y) of the points in their order; the surface's normals point to the right of the way
        along them, if r is drawn to the right and y upwards.
    """

    corners: Array

    @cached_property
    def knots(self) -> Array:
        """Parameters of the points, shape (point,), m."""
        chord = np.linalg.norm(np.diff(self.corners, axis=0), axis=1)
        along = np.r_[0.0, np.cumsum(chord)]
        return np.asarray(along - along[-1] / 2)

    @property
    def half(self) -> float:
        """Parameter of the last point, m; that of the first is its negative."""
        return float(self.knots[-1])

    @cached_property
    def samples(self) -> Array:
        """Parameters along the whole curve, with its ends, between which it bends little."""
        parts = PARTS if len(self.corners) > 2 else 1
        return np.linspace(-self.half, self.half, parts + 1)

    @cached_property
    def _spline(self) -> Any:
        degree = min(DEGREE, len(self.corners) - 1)
        return scipy.interpolate.make_interp_spline(self.knots, self.corners, degree)

    def __call__(self, t: Array, order: int = 0) -> Array:
        """Evaluate (r, y) or a derivative by t, shape (place, 2), m^(1 - order).

        Examples
        --------
        >>> import numpy as np
        >>> from sldvexp.geometry import Meridian
        >>> Meridian(np.array([[0.1, 0.0], [0.1, 0.4]]))(np.array([0.1])).round(9).tolist()
        [[0.1, 0.3]]
        """
        inside = np.clip(t, -self.half, self.half)
        beyond = np.asarray(t - inside)[:, None]
        terms = [
            beyond**k / math.factorial(k) * np.asarray(self._spline(inside, nu=order + k))
            for k in range(max(BENT - order, 0) + 1)
        ]
        return np.asarray(sum(terms))

    def normals(self, t: Array) -> Array:
        """Compute unit normals (r, y), shape (place, 2)."""
        along = self(t, 1)
        along = along / np.linalg.norm(along, axis=1)[:, None]
        return np.asarray(np.stack([along[:, 1], -along[:, 0]], axis=1))

    def nearest(self, points: Array) -> Array:
        """Find the parameters of the places nearest to points (r, y), by Newton's steps."""
        known = self(self.samples)
        t = self.samples[np.argmin(((points[:, None] - known) ** 2).sum(axis=2), axis=1)]
        for _ in range(STEPS):
            off, along, bent = points - self(t), self(t, 1), self(t, 2)
            slope = (along**2).sum(axis=1) - (off * bent).sum(axis=1)
            step = (off * along).sum(axis=1) / slope
            t = t + np.clip(step, -self.half, self.half)
            if np.abs(step).max(initial=0.0) < SETTLED * self.half:
                break
        return np.asarray(t)
