"""`volume=grid`: a rectangular grid of nodes on a plane or on the panel of a cylinder."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.typing import IntArray
from sldvexp.units import beyond_belief
from sldvexp.volume.base import Volume, vector
from sldvexp.volume.surface import TriangulatedSurface


class Diagonals(Enum):
    """Ways to cut each cell of the grid in two triangles."""

    alternate = "alternate"
    forward = "forward"
    backward = "backward"


@register("volume", "grid")
@dataclass
class Grid(Volume):
    """Evenly spaced nodes in rows along the surface's own x and y; its center stands at `center`.

    Parameters
    ----------
    size : list of 2 float
        Sides along its own x (the arc, if it is curved) and y.
    shape : list of 2 int
        Nodes along the two sides.
    radius : float, optional
        Of a cylinder about the line x = 0, z = -radius; negative where the normals point towards
        that axis. Without it the grid is flat.
    diagonals : Diagonals
        ``forward`` runs with x and y, ``backward`` against one of them; ``alternate`` changes
        from cell to cell, so that no direction is preferred.
    """

    size: list[float] = field(default_factory=lambda: [0.3, 0.25])
    shape: list[int] = field(default_factory=lambda: [9, 7])
    radius: float | None = None
    diagonals: Diagonals = Diagonals.alternate

    def check(self, checks: Checks) -> None:
        """Note what no grid can be."""
        known = len(checks.problems)
        vector(checks, "size", self.size, 2)
        for i, side in enumerate(self.size):
            checks.positive(f"size[{i}]", side)
            told = beyond_belief(self.unit, side)
            checks.require(not told, f"size[{i}]", told)
        vector(checks, "shape", list(self.shape), 2)
        for i, nodes in enumerate(self.shape):
            message = f"must be 2 nodes or more, not {nodes}"
            checks.require(nodes >= 2, f"shape[{i}]", message)
        if self.radius is not None and len(checks.problems) == known:
            least = self.size[0] / (2 * math.pi)
            checks.require(
                math.isfinite(self.radius) and abs(self.radius) > least,
                "radius",
                f"must be finite and beyond +-{least:.6g} {self.unit.name}, where the panel "
                f"closes to a tube, not {self.radius}; null is flat",
            )

    def surface(self) -> TriangulatedSurface:
        """Make the grid in its own axes."""
        unit = self.unit.value
        (nx, ny), (a, b) = self.shape, (unit * side for side in self.size)
        flat = grid(nx, ny, a, b, self.diagonals)
        return flat if self.radius is None else cylinder(flat, unit * self.radius)


def grid(nx: int, ny: int, a: float, b: float, diagonals: Diagonals) -> TriangulatedSurface:
    """Make a flat grid about the origin, normals along z.

    Parameters
    ----------
    nx, ny : int
        Nodes along x and y; node ``i * ny + j`` is the j-th along y of the i-th row along x.
    a, b : float, m
        Sides along x and y.
    """
    x, y = np.meshgrid(
        np.linspace(-a / 2, a / 2, nx), np.linspace(-b / 2, b / 2, ny), indexing="ij"
    )
    position = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    normal = np.broadcast_to([0.0, 0.0, 1.0], position.shape)
    return TriangulatedSurface(position, _triangles(nx, ny, diagonals), normal)


def cylinder(flat: TriangulatedSurface, radius: float) -> TriangulatedSurface:
    """Bend a flat surface about the line x = 0, z = -radius; x becomes the arc.

    Parameters
    ----------
    flat : TriangulatedSurface
        In the plane z = 0.
    radius : float, m
        Negative where the normals point towards the axis.
    """
    x, y, _ = flat.position.T
    sine, cosine = np.sin(x / radius), np.cos(x / radius)
    normal = np.column_stack([sine, np.zeros_like(x), cosine])
    # radius (cos - 1) without the loss of digits that a nearly flat panel would suffer.
    sagitta = -2.0 * radius * np.sin(x / (2.0 * radius)) ** 2
    return TriangulatedSurface(np.column_stack([radius * sine, y, sagitta]), flat.triangles, normal)


def _triangles(nx: int, ny: int, diagonals: Diagonals) -> IntArray:
    """Make two triangles of each cell, counter-clockwise seen from +z, shape (triangle, 3)."""
    i, j = np.meshgrid(np.arange(nx - 1), np.arange(ny - 1), indexing="ij")
    near = (i * ny + j).ravel()
    right, up, far = near + ny, near + 1, near + ny + 1
    forward = np.stack([near, right, far, near, far, up], axis=-1)
    backward = np.stack([near, right, up, right, far, up], axis=-1)
    chosen = {
        Diagonals.forward: np.ones(len(near), bool),
        Diagonals.backward: np.zeros(len(near), bool),
        Diagonals.alternate: ((i + j) % 2 == 0).ravel(),
    }[diagonals]
    return np.where(chosen[:, None], forward, backward).reshape(-1, 3)
