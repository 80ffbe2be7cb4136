"""Rectangular grids of triangles, flat or bent to a cylinder."""

from __future__ import annotations

import numpy as np

from sldvexp.typing import IntArray
from sldvexp.volume.grid import Diagonals
from sldvexp.volume.surface import Surface


def grid(nx: int, ny: int, a: float, b: float, diagonals: Diagonals) -> Surface:
    """A flat grid about the origin, normals along z.

    Parameters
    ----------
    nx, ny : int
        Nodes along x and y; node ``i * ny + j`` is the j-th along y of the i-th row along x.
    a, b : float, m
        Sides along x and y.
    diagonals : Diagonals
    """
    x, y = np.meshgrid(
        np.linspace(-a / 2, a / 2, nx), np.linspace(-b / 2, b / 2, ny), indexing="ij"
    )
    position = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    normal = np.broadcast_to([0.0, 0.0, 1.0], position.shape)
    return Surface(position, _triangles(nx, ny, diagonals), normal)


def cylinder(flat: Surface, radius: float) -> Surface:
    """A flat surface bent about the line x = 0, z = -radius; x becomes the arc.

    Parameters
    ----------
    flat : Surface
        In the plane z = 0.
    radius : float, m
        Negative where the normals point towards the axis.
    """
    x, y, _ = flat.position.T
    sine, cosine = np.sin(x / radius), np.cos(x / radius)
    normal = np.column_stack([sine, np.zeros_like(x), cosine])
    # radius (cos - 1) without the loss of digits that a nearly flat panel would suffer.
    sagitta = -2.0 * radius * np.sin(x / (2.0 * radius)) ** 2
    return Surface(np.column_stack([radius * sine, y, sagitta]), flat.triangles, normal)


def _triangles(nx: int, ny: int, diagonals: Diagonals) -> IntArray:
    """Two triangles for each cell, counter-clockwise seen from +z, shape (triangle, 3)."""
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
