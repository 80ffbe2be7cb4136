"""Coordinates on a surface that bends both ways: those of its projection onto a plane.

A smooth height h over the plane is fitted to the surface's nodes, so that it consists of the points

    P(s, t) = center + (s, t, h(s, t))' axes .

With ``W^2 = 1 + h,s^2 + h,t^2`` the tangents are ``a_s = (1, 0, h,s)``, ``a_t = (0, 1, h,t)``, the
normal is ``n = (-h,s, -h,t, 1) / W``, t1 points along a_s and ``t2 = n x t1``. Of these

    J = E^-1, E_ai = a_a . t_i,       kappa = -J H J' / W, H_ab = h,ab,    g = J h,sa t2_h / |a_s|

(do Carmo 1976). All of it is exact for the fitted surface. Beyond the nodes' rectangle h goes on
linearly. The height is a tensor product of quintic splines whose squared fourth derivatives are
penalised as generalised cross-validation says: nodes may be measured ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.lazy import scipy
from sldvexp.shell.chart import SETTLED, STEPS, Chart, LocalForms
from sldvexp.shell.splines import TensorSplines
from sldvexp.typing import Array
from sldvexp.volume import Prisms

#: Cosine of the steepest place's angle to the plane.
STEEPEST = np.cos(np.radians(75))
#: Distance of a node from the smooth surface, over the extent, from which it has edges.
ROUGH = 2e-3
#: Most cells along the longer side, and nodes for each of the splines' coefficients.
CELLS, NODES = 16, 2
#: Logarithms of the penalty's weight that are tried, over the ratio of the matrices' traces.
WEIGHTS = np.arange(-34.0, 15.0, 1.0)
#: Orders of the derivatives by s and t that a tangent plane has.
FIRST = ((0, 0), (1, 0), (0, 1))
#: The plane's rectangle reaches so far beyond the nodes, over its longer side.
BEYOND = 1e-6


@dataclass(frozen=True, eq=False)
class HeightChart(Chart):
    """Coordinates (s, t) of a surface that is seen as a whole along one direction.

    Parameters
    ----------
    center : ndarray, shape (3,), m
        Where s = t = h = 0, in the world.
    axes : ndarray, shape (3, 3)
        Rows: s, t and h, in the world.
    splines : TensorSplines
    height : ndarray, shape (function,), m
        Their coefficients.
    low, high : ndarray, shape (2,), m
        Corners of the rectangle beyond which the height goes on linearly.
    """

    center: Array
    axes: Array
    splines: TensorSplines
    height: Array
    low: Array
    high: Array

    @classmethod
    def fitted(cls, prisms: Prisms, margin: float = 0.0) -> HeightChart:
        """Fit a smooth surface to the nodes of the given surface.

        Parameters
        ----------
        margin : float, m
            How far it goes on beyond them, as smoothly.

        Raises
        ------
        UserError
            If parts of it hide one another from the side of its mean normal, or it has edges.
        """
        nodes = prisms.surface
        a, b, c = np.moveaxis(nodes[prisms.triangles], 1, 0)
        area = np.cross(b - a, c - a)
        normal = area.sum(axis=0) / np.linalg.norm(area.sum(axis=0))
        facing = area @ normal / np.linalg.norm(area, axis=1)
        if facing.min() < STEEPEST:
            raise UserError(
                "reconstruction=shell and spline need a surface that is seen as a whole from one "
                f"side; {np.count_nonzero(facing < STEEPEST)} of {len(area)} triangles of the "
                "volume's face away from its mean normal or are steeper than 75 degrees: leave a "
                "part of it out, or use reconstruction=samplewise there"
            )
        first = prisms.frame[:, 0].mean(axis=0)
        first = first - normal * (first @ normal)
        first /= np.linalg.norm(first)
        axes = np.stack([first, np.cross(normal, first), normal])
        center = nodes.mean(axis=0)
        local = (nodes - center) @ axes.T
        low, high = local[:, :2].min(axis=0) - margin, local[:, :2].max(axis=0) + margin
        splines, height = smooth_height(local[:, :2], local[:, 2], low, high)
        extent = float(np.linalg.norm(high - low))
        miss = np.abs(splines(local[:, :2]) @ height - local[:, 2]).max()
        if miss > ROUGH * extent:
            raise UserError(
                "reconstruction=shell and spline need a smooth surface; the volume's has edges or "
                f"steps, of which a smooth one is {1e3 * miss:.3g} mm off: leave a part of it out, "
                "or use reconstruction=samplewise there"
            )
        return cls(center, axes, splines, height, low, high)

    def place(self, points: Array) -> tuple[Array, Array]:
        """Find coordinates and heights of points, by Newton's steps; see `Chart`."""
        coordinates = ((points - self.center) @ self.axes.T)[:, :2]
        for _ in range(STEPS):
            off = points - self.points(coordinates, 0.0)
            local = np.einsum("pij,pj->pi", self.frames(coordinates), off)
            forms = self.forms(coordinates)
            stretch = np.eye(2) + local[:, 2, None, None] * forms.curvature
            step = np.linalg.solve(stretch, local[:, :2, None])[..., 0]
            change = np.einsum("pi,pia->pa", step, forms.rate)
            coordinates = coordinates + change
            if np.nan_to_num(np.abs(change)).max(initial=0.0) < SETTLED:
                break
        off = points - self.points(coordinates, 0.0)
        return coordinates, np.einsum("pj,pj->p", self.frames(coordinates)[:, 2], off)

    def points(self, coordinates: Array, height: float) -> Array:
        """Find the points at coordinates and a height; see `Chart`."""
        inside = np.clip(coordinates, self.low, self.high)
        above, by_s, by_t = self._height(inside, FIRST)
        above = above + np.einsum("pa,ap->p", coordinates - inside, np.stack([by_s, by_t]))
        on_surface = self.center + np.column_stack([coordinates, above]) @ self.axes
        normal = _local_frames(by_s, by_t)[:, 2] @ self.axes
        return np.asarray(on_surface + height * normal)

    def frames(self, coordinates: Array) -> Array:
        """Compute the local axes; see `Chart`."""
        inside = np.clip(coordinates, self.low, self.high)
        _, by_s, by_t = self._height(inside, FIRST)
        return _local_frames(by_s, by_t) @ self.axes

    def forms(self, coordinates: Array) -> LocalForms:
        """Compute how the surface and its axes change along it; see `Chart`."""
        inside = np.clip(coordinates, self.low, self.high)
        _, by_s, by_t, ss, st, tt = self._height(inside, (*FIRST, (2, 0), (1, 1), (0, 2)))
        second = np.stack([np.stack([ss, st], -1), np.stack([st, tt], -1)], axis=-2)
        frames = _local_frames(by_s, by_t)
        one, none = np.ones_like(by_s), np.zeros_like(by_s)
        tangents = np.stack([np.stack([one, none, by_s], -1), np.stack([none, one, by_t], -1)], 1)
        rate = np.linalg.inv(np.einsum("pax,pix->pai", tangents, frames[:, :2]))
        # n, whose third component is 1 / W
        bent = -np.einsum("pia,pab,pjb->pij", rate, second, rate) * frames[:, 2, 2, None, None]
        turned = second[:, 0] * (frames[:, 1, 2] / np.sqrt(1 + by_s**2))[:, None]
        return LocalForms(rate, bent, np.einsum("pia,pa->pi", rate, turned))

    def _height(self, inside: Array, orders: Sequence[tuple[int, int]]) -> list[Array]:
        """Evaluate derivatives of the height at places in the rectangle, shape (point,) each."""
        own = self.height.reshape(self.splines.along_s.count, -1)
        of_s = {i: self.splines.along(inside, 0, i) @ own for i in {i for i, _ in orders}}
        of_t = {j: self.splines.along(inside, 1, j) for j in {j for _, j in orders}}
        return [np.einsum("pj,pj->p", of_s[i], of_t[j]) for i, j in orders]


def _local_frames(by_s: Array, by_t: Array) -> Array:
    """Compute local axes along the axes of the plane from the slopes, shape (point, 3, 3)."""
    along = np.sqrt(1 + by_s**2)
    normal = np.stack([-by_s, -by_t, np.ones_like(by_s)], -1)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    first = np.stack([1 / along, np.zeros_like(along), by_s / along], -1)
    return np.stack([first, np.cross(normal, first), normal], axis=1)


def smooth_height(
    place: Array, height: Array, low: Array, high: Array
) -> tuple[TensorSplines, Array]:
    """Fit splines to heights, as smooth as generalised cross-validation says (Wahba 1990).

    Parameters
    ----------
    place : ndarray, shape (node, 2), m
    height : ndarray, shape (node,), m
    low, high : ndarray, shape (2,), m
        Corners of the rectangle that the splines cover.

    Returns
    -------
    splines : TensorSplines
    coefficients : ndarray, shape (function,), m
    """
    longest = (high - low).max()
    rim, unit = BEYOND * longest, longest / 3
    for cells in range(CELLS, 0, -1):
        splines = TensorSplines.over(low - rim, high + rim, cells, 5, unit)
        if NODES * splines.count <= len(place):
            break
    rows, penalty = splines(place), splines.penalty(4)
    normal, weights = rows.T @ rows, np.exp(WEIGHTS)
    weights = weights * np.trace(normal) / np.trace(penalty)
    least = weights[0]
    root = scipy.linalg.cholesky(normal + least * penalty, lower=True)
    half = scipy.linalg.solve_triangular(root, penalty, lower=True)
    values, vectors = np.linalg.eigh(scipy.linalg.solve_triangular(root, half.T, lower=True))
    turned = scipy.linalg.solve_triangular(root, vectors, lower=True, trans=1)
    shrink = 1 / (1 + (weights - least) * np.maximum(values, 0.0)[:, None])
    found = turned @ (shrink * (turned.T @ (rows.T @ height))[:, None])
    left = ((rows @ found - height[:, None]) ** 2).sum(axis=0)
    freedom = ((1 - least * values[:, None]) * shrink).sum(axis=0)
    best = int(np.argmin(left / (len(place) - freedom) ** 2))
    return splines, found[:, best]
