"""A triangulated surface: what a volume is extruded from, and the frames of its nodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.typing import Array, IntArray
from sldvexp.volume.samples import orthonormal

#: Sine of the angle between a tangent's wish and a normal below which it has no projection.
PARALLEL = 1e-3


@dataclass(frozen=True, eq=False)
class TriangulatedSurface:
    """Nodes and triangles of one surface.

    Parameters
    ----------
    position : ndarray, shape (node, 3), m
    triangles : ndarray of int, shape (triangle, 3)
        Counter-clockwise seen from the side to which the normals point.
    normal : ndarray, shape (node, 3), optional
        Unit normals, where the geometry is known better than by its triangles.
    source : str
        The file it comes from, for messages.
    number : ndarray of int, shape (node,), optional
        What the file calls each node, for messages; without it they are counted from 0.
    kind : tuple of str
        What such a number counts, one and several of them.
    """

    position: Array
    triangles: IntArray
    normal: Array | None = None
    source: str = ""
    number: IntArray | None = None
    kind: tuple[str, str] = ("node", "nodes")

    def wrong(self, message: str) -> UserError:
        """The error of a surface that cannot be used."""
        return UserError(f"{self.source}: {message}" if self.source else message)

    def named(self, *nodes: int) -> str:
        """Nodes for messages: ``the nodes 3 and 7``."""
        numbers = [str(n if self.number is None else self.number[n]) for n in nodes]
        if len(numbers) == 1:
            return f"the {self.kind[0]} {numbers[0]}"
        return f"the {self.kind[1]} {', '.join(numbers[:-1])} and {numbers[-1]}"

    def at(self, node: int) -> str:
        """Where a node stands, for messages."""
        x, y, z = self.position[node]
        return f"({x:.6g}, {y:.6g}, {z:.6g}) m"


def area_vectors(surface: TriangulatedSurface) -> Array:
    """Twice the area of each triangle along its normal, shape (triangle, 3), m^2."""
    a, b, c = np.moveaxis(surface.position[surface.triangles], 1, 0)
    return np.cross(b - a, c - a)


def vertex_normals(surface: TriangulatedSurface) -> Array:
    """Unit normals of the nodes: the mean of their triangles' normals, weighted with the area.

    Returns
    -------
    ndarray, shape (node, 3)

    Raises
    ------
    UserError
        If the triangles around a node cancel one another.
    """
    area = area_vectors(surface)
    total = np.column_stack([_gathered(surface, area[:, axis]) for axis in range(3)])
    weight = _gathered(surface, np.linalg.norm(area, axis=1))
    length = np.linalg.norm(total, axis=1)
    if (bad := np.flatnonzero(length <= PARALLEL * weight)).size:
        raise surface.wrong(
            f"{surface.named(bad[0])} at {surface.at(bad[0])} has no normal, because the "
            "triangles around it face opposite ways; the surface must not be folded there"
        )
    return total / length[:, None]


def _gathered(surface: TriangulatedSurface, value: Array) -> Array:
    """Sum of the triangles' values at each node, shape (node,)."""
    total = np.zeros(len(surface.position))
    np.add.at(total, surface.triangles, value[:, None])
    return total


def node_frames(surface: TriangulatedSurface, normal: Array, tangent: Array) -> Array:
    """Tangents and normal of every node: t1 is the projection of one direction.

    Parameters
    ----------
    surface : TriangulatedSurface
    normal : ndarray, shape (node, 3)
        Of length one.
    tangent : ndarray, shape (3,)
        Direction whose projection on the surface is t1; any length but zero.

    Returns
    -------
    ndarray, shape (node, 3, 3)
        Unit rows t1, t2, n, right-handed.

    Raises
    ------
    UserError
        If the direction is parallel to a normal, or its projection turns within a triangle so
        far that nothing in between can be interpolated.
    """
    toward = tangent / np.linalg.norm(tangent)
    sine = np.linalg.norm(np.cross(toward, normal), axis=1)
    written = f"tangent: [{', '.join(f'{v:g}' for v in tangent)}]"
    if (bad := np.flatnonzero(sine < PARALLEL)).size:
        raise surface.wrong(
            f"{written} is parallel to the normal of {surface.named(bad[0])} at "
            f"{surface.at(bad[0])}; choose a direction that lies along the surface, as "
            f"[{_across(normal[bad[0]])}] does there"
        )
    frame = orthonormal(np.broadcast_to(toward, normal.shape), normal)
    t1 = frame[surface.triangles, 0]
    least = np.einsum("tci,tci->tc", t1, np.roll(t1, 1, axis=1)).min(axis=1)
    if (bad := np.flatnonzero(least <= 0)).size:
        corners = surface.triangles[bad[0]]
        raise surface.wrong(
            f"{written} has projections that turn by 90 degrees or more between "
            f"{surface.named(*corners)} at {surface.at(corners[0])}; choose another direction, "
            "or triangles that are smaller there"
        )
    return frame


def _across(normal: Array) -> str:
    """The coordinate axis farthest from a normal, for messages."""
    axis = np.zeros(3)
    axis[np.argmin(np.abs(normal))] = 1.0
    return ", ".join(f"{v:g}" for v in axis)
