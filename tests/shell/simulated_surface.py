"""Meshes of surfaces that bend both ways, from their height over a plane."""

from __future__ import annotations

import numpy as np

from sldvexp.volume import TriangulatedSurface, vertex_normals
from sldvexp.volume.grid import Grid
from sldvexp.volume.samples import Prisms, extruded
from sldvexp.volume.surface import node_frames

RADIUS = 0.5


def sphere(x, y):
    """Height of a cap of a sphere."""
    return np.sqrt(RADIUS**2 - x**2 - y**2) - RADIUS


def saddle(x, y):
    """Height of a smooth surface that bends up along one direction and down along another."""
    return 0.4 * x**2 - 0.7 * y**2 + 0.5 * x * y + 0.8 * x**3


def torus(x, y):
    """Height of a patch of a torus, tube 0.3 m, ring 0.4 m."""
    return np.sqrt((np.sqrt(0.3**2 - x**2) + 0.4) ** 2 - y**2) - 0.7


HEIGHTS = {"sphere": sphere, "saddle": saddle, "torus": torus}


def mesh(
    height, shape=(33, 27), size=(0.26, 0.21), rotation=None, center=(0.0, 0.0, 0.0)
) -> Prisms:
    """Prisms around a surface, in the world through a rotation, whose rows are its own axes."""
    flat = Grid(size=list(size), shape=list(shape)).surface()
    x, y = flat.position[:, :2].T
    turn = np.eye(3) if rotation is None else rotation
    position = np.array(center) + np.column_stack([x, y, height(x, y)]) @ turn
    surface = TriangulatedSurface(position, flat.triangles)
    frame = node_frames(surface, vertex_normals(surface), turn[0])
    return extruded(position, flat.triangles, frame, np.array([-0.01, 0.01]))
