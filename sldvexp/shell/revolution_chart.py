"""Coordinates on a closed shell of revolution: the way around its axis, and along its meridian.

A meridian ``(r, y)(t)`` turns about the axis y by the angle ``phi = s / R``, R its mean radius,
from the own axis z towards x. With ``e = (sin phi, 0, cos phi)`` the surface is

    P(s, t) = origin + (r e + y e_y)' axes,      s = s + 2 pi R.

Its lengths over the coordinates' (Lame's coefficients; Kraus 1967, Soedel 2004) are ``A1 = r / R``
around and ``A2 = |(r, y)'|`` along the meridian. t1 points around, t2 along the meridian, and n =
t1 x t2 = ``(y' e - r' e_y) / A2``. These are lines of curvature, so that

    J = diag(1 / A1, 1 / A2),     kappa_11 = y' / (A2 r),     kappa_22 = (r' y'' - y' r'') / A2^3,
    g_1 = -r' / (A2 r),           g_2 = 0

in `sldvexp.shell.chart`'s terms, where kappa is one over the radius of curvature. Love's strains of
the middle surface, which the kinematics make of it, are the textbook's

    e_11 = u,s / A1 + v A1,t / (A1 A2) + kappa_11 w,      e_22 = v,t / A2 + kappa_22 w,
    2 e_12 = v,s / A1 + u,t / A2 - u A1,t / (A1 A2).

The meridian must stay away from the axis, where the angle means nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sldvexp.geometry import Meridian
from sldvexp.shell.chart import Chart, LocalForms
from sldvexp.typing import Array

#: How far beyond its ends, over its length, a part of the meridian still counts as met.
RIM = 1e-9


@dataclass(frozen=True, eq=False)
class RevolutionChart(Chart):
    """Coordinates (s, t) of a surface of revolution that closes in itself along s.

    Parameters
    ----------
    origin : ndarray, shape (3,), m
        Where r = y = 0, in the world.
    axes : ndarray, shape (3, 3)
        Rows: the own x, the axis of revolution, and z, in the world.
    meridian : Meridian
    beyond : float, m
        How far the surface goes on beyond both ends of the meridian.
    """

    origin: Array
    axes: Array
    meridian: Meridian
    beyond: float = 0.0

    @cached_property
    def radius(self) -> float:
        """R, by which angles become the coordinate s, m."""
        return float(self.meridian(self.meridian.samples)[:, 0].mean())

    @property
    def period(self) -> float:
        """2 pi R, m."""
        return 2 * np.pi * self.radius

    @property
    def center(self) -> Array:  # type: ignore[override]
        """The middle of the axis."""
        ends = self.meridian(self.meridian.samples[[0, -1]])
        return self.origin + ends[:, 1].mean() * self.axes[1]

    def place(self, points: Array) -> tuple[Array, Array]:
        """Find coordinates and heights of points; see `Chart`."""
        x, y, z = ((points - self.origin) @ self.axes.T).T
        own = np.column_stack([np.hypot(x, z), y])
        t = self.meridian.nearest(own)
        height = ((own - self.meridian(t)) * self.meridian.normals(t)).sum(axis=1)
        return np.column_stack([self.radius * np.arctan2(x, z), t]), height

    def points(self, coordinates: Array, height: float) -> Array:
        """Find the points at coordinates and a height; see `Chart`."""
        s, t = coordinates.T
        r, y = (self.meridian(t) + height * self.meridian.normals(t)).T
        angle = s / self.radius
        return self.origin + np.stack([r * np.sin(angle), y, r * np.cos(angle)], -1) @ self.axes

    def frames(self, coordinates: Array) -> Array:
        """Compute the local axes; see `Chart`."""
        angle, (outward, along) = coordinates[:, 0] / self.radius, self._normals(coordinates)
        sine, cosine, none = np.sin(angle), np.cos(angle), np.zeros(len(angle))
        local = np.stack(
            [
                np.stack([cosine, none, -sine], axis=-1),
                np.stack([-along * sine, outward, -along * cosine], axis=-1),
                np.stack([outward * sine, along, outward * cosine], axis=-1),
            ],
            axis=1,
        )
        return local @ self.axes

    def forms(self, coordinates: Array) -> LocalForms:
        """Compute how the surface and its axes change along it; see `Chart`."""
        (r, _), (dr, dy), (ddr, ddy) = (self.meridian(coordinates[:, 1], i).T for i in range(3))
        length = np.hypot(dr, dy)
        rate, curvature = (np.zeros((len(r), 2, 2)) for _ in range(2))
        rate[:, 0, 0], rate[:, 1, 1] = self.radius / r, 1 / length
        curvature[:, 0, 0] = dy / (length * r)
        curvature[:, 1, 1] = (dr * ddy - dy * ddr) / length**3
        return LocalForms(rate, curvature, np.stack([-dr / (length * r), np.zeros_like(r)], -1))

    def start(self, begin: Array, way: Array, height: float, side: int) -> Array:
        """Find where beams first meet cones through places of the meridian; see `Chart`.

        NaN for beams that meet none, or the other side first.
        """
        own, along = (begin - self.origin) @ self.axes.T, way @ self.axes.T
        t = self.meridian.samples.copy()
        t[[0, -1]] += [-self.beyond, self.beyond]
        rings = self.meridian(t) + height * self.meridian.normals(t)
        far, found = np.full(len(own), np.inf), np.full((len(own), 2), np.nan)
        for k, step in enumerate(np.diff(rings, axis=0)):
            for crossing in _crossings(own, along, rings[k], rings[k + 1]):
                x, y, z = (own + crossing[:, None] * along).T
                r = np.hypot(x, z)
                share = (np.column_stack([r, y]) - rings[k]) @ step / (step @ step)
                on_it = (crossing > 0) & (crossing < far) & (np.abs(share - 0.5) <= 0.5 + RIM)
                out = step[1] * (x * along[:, 0] + z * along[:, 2]) / r - step[0] * along[:, 1]
                angle, place = np.arctan2(x, z), t[k] + share * (t[k + 1] - t[k])
                here = np.column_stack([self.radius * angle, place])
                here[side * out >= 0] = np.nan
                far, found = np.where(on_it, crossing, far), np.where(on_it[:, None], here, found)
        return found

    def _normals(self, coordinates: Array) -> Array:
        """Compute the components of the normal away from the axis and along it, (2, point)."""
        return self.meridian.normals(coordinates[:, 1]).T


def _crossings(begin: Array, way: Array, low: Array, high: Array) -> list[Array]:
    """Compute how far along beams they cross a cone through two rings (r, y), both times, m.

    On it ``n_r r = n_r r_0 - n_y (y - y_0)``, squared, with its normal n.
    """
    (dr, dy), (x, y, z), (dx, along, dz) = high - low, begin.T, way.T
    rest, slope = dy * low[0] + dr * (y - low[1]), dr * along
    a = dy**2 * (dx**2 + dz**2) - slope**2
    b = dy**2 * (x * dx + z * dz) - rest * slope
    c = dy**2 * (x**2 + z**2) - rest**2
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(b * b - a * c)
        both = [(-b - root) / a, (-b + root) / a]
        # Squared, the equation holds for the cone's other half too.
        return [np.where((rest + far * slope) * dy >= 0, far, np.nan) for far in both]
