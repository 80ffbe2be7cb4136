"""Triangulated surface: the frames of its nodes, and what makes it useless.

The normal of a node is the mean of its triangles' normals weighted with their areas, and the first
tangent is the projection of one direction that serves the whole surface. Prisms along the normals
fold where the surface is bent more sharply than they are high. Every defect is told in one sentence
that names the node.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.lazy import scipy
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
    told : str
        What was done to the file's own nodes, for the record.
    tangent : ndarray, shape (node, 3), optional
        Unit first tangents, where the surface has directions of its own.
    """

    position: Array
    triangles: IntArray
    normal: Array | None = None
    source: str = ""
    number: IntArray | None = None
    kind: tuple[str, str] = ("node", "nodes")
    told: str = ""
    tangent: Array | None = None

    def wrong(self, message: str) -> UserError:
        """Make the error of a surface that cannot be used."""
        return UserError(f"{self.source}: {message}" if self.source else message)

    def named(self, *nodes: int) -> str:
        """Name nodes for messages: ``the nodes 3 and 7``."""
        numbers = [str(n if self.number is None else self.number[n]) for n in nodes]
        if len(numbers) == 1:
            return f"the {self.kind[0]} {numbers[0]}"
        return f"the {self.kind[1]} {', '.join(numbers[:-1])} and {numbers[-1]}"

    def at(self, node: int) -> str:
        """Describe where a node stands, for messages."""
        x, y, z = self.position[node]
        return f"({x:.6g}, {y:.6g}, {z:.6g}) m"


def area_vectors(surface: TriangulatedSurface) -> Array:
    """Compute twice the area of each triangle along its normal, shape (triangle, 3), m^2."""
    a, b, c = np.moveaxis(surface.position[surface.triangles], 1, 0)
    return np.cross(b - a, c - a)


def vertex_normals(surface: TriangulatedSurface) -> Array:
    """Average unit normals of the triangles at each node, weighted with their areas.

    Returns
    -------
    ndarray, shape (node, 3)

    Raises
    ------
    UserError
        If the triangles around a node cancel one another.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.volume import TriangulatedSurface, vertex_normals
    >>> corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    >>> vertex_normals(TriangulatedSurface(corners, np.array([[0, 1, 2]])))[0].tolist()
    [0.0, 0.0, 1.0]
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
    """Make tangents and normal of every node: t1 is the projection of one direction.

    Parameters
    ----------
    normal : ndarray, shape (node, 3)
        Of length one.
    tangent : ndarray, shape (3,) or (node, 3)
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
    toward = tangent / np.linalg.norm(tangent, axis=-1, keepdims=True)
    sine = np.linalg.norm(np.cross(toward, normal), axis=1)
    written = f"tangent: [{', '.join(f'{v:g}' for v in np.ravel(tangent)[:3])}]"
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
    """Find the coordinate axis farthest from a normal, for messages."""
    axis = np.zeros(3)
    axis[np.argmin(np.abs(normal))] = 1.0
    return ", ".join(f"{v:g}" for v in axis)


#: Nodes nearer to one another than this fraction of the surface's extent stand in one place.
TOGETHER = 1e-7

#: A triangle whose height is below this fraction of its longest side has no area.
FLAT = 1e-6

#: A prism whose height across its base shrinks below this fraction of that at depth 0 has folded.
FOLDED = 1e-6


def check_surface(surface: TriangulatedSurface) -> None:
    """Complain about a surface that no volume can be made of.

    Raises
    ------
    UserError
        If it has no triangles, or nodes twice or nowhere, or nodes in no triangle, or triangles
        that name no node or without area, or edges that more than two triangles share or pass in
        the same direction, or parts that do not touch.
    """
    if not len(surface.triangles):
        raise surface.wrong("the surface has no triangles")
    # In this order: all others count on finite positions and on triangles that name nodes.
    _check_numbers(surface)
    _check_apart(surface)
    _check_used(surface)
    _check_area(surface)
    _check_edges(surface)
    _check_connected(surface)


def _check_numbers(surface: TriangulatedSurface) -> None:
    """Refuse nodes that stand nowhere, and corners that are no node."""
    if (bad := np.flatnonzero(~np.isfinite(surface.position).all(axis=1))).size:
        raise surface.wrong(f"{surface.named(bad[0])} has a coordinate that is not a number")
    nodes = len(surface.position)
    outside = (surface.triangles < 0) | (surface.triangles >= nodes)
    if (rows := np.argwhere(outside)).size:
        triangle, corner = rows[0]
        raise surface.wrong(
            f"the triangle {triangle} names node {surface.triangles[triangle, corner]}, but "
            f"there are {nodes} nodes, counted from 0"
        )


def _check_apart(surface: TriangulatedSurface) -> None:
    """Refuse two nodes in one place."""
    position = surface.position
    extent = float(np.linalg.norm(np.ptp(position, axis=0)))
    pairs = scipy.spatial.KDTree(position).query_pairs(TOGETHER * extent, output_type="ndarray")
    if len(pairs):
        first, second = sorted(map(int, min(pairs.tolist())))
        raise surface.wrong(
            f"{surface.named(first, second)} stand in one place, {surface.at(first)}; every node "
            "must stand there once"
        )


def _check_used(surface: TriangulatedSurface) -> None:
    """Refuse nodes that are the corner of no triangle."""
    used = np.bincount(surface.triangles.ravel(), minlength=len(surface.position))
    if (idle := np.flatnonzero(used == 0)).size:
        raise surface.wrong(
            f"{surface.named(idle[0])} at {surface.at(idle[0])} belongs to no triangle"
            f"{_in_all(len(idle), 'node')}; leave it out or connect it"
        )


def _check_area(surface: TriangulatedSurface) -> None:
    """Refuse triangles that are lines."""
    corner = surface.position[surface.triangles]
    side = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=-1).max(axis=1)
    flat = np.linalg.norm(area_vectors(surface), axis=1) <= FLAT * side**2
    if (bad := np.flatnonzero(flat)).size:
        corners = surface.triangles[bad[0]]
        raise surface.wrong(
            f"the triangle of {surface.named(*corners)} at {surface.at(corners[0])} has no "
            f"area{_in_all(len(bad), 'triangle')}, so that its prisms have no volume"
        )


def _check_edges(surface: TriangulatedSurface) -> None:
    """Refuse edges but of one triangle, or of two that pass them in opposite directions."""
    start = surface.triangles.ravel()
    end = np.roll(surface.triangles, -1, axis=1).ravel()
    nodes = len(surface.position)
    undirected = np.minimum(start, end) * nodes + np.maximum(start, end)
    edge, count = np.unique(undirected, return_counts=True)
    if (bad := np.flatnonzero(count > 2)).size:
        ends = divmod(int(edge[bad[0]]), nodes)
        raise surface.wrong(
            f"{count[bad[0]]} triangles meet at the edge between {surface.named(*ends)} at "
            f"{surface.at(ends[0])}{_in_all(len(bad), 'edge')}; a surface has two at most"
        )
    edge, count = np.unique(start * nodes + end, return_counts=True)
    if (bad := np.flatnonzero(count > 1)).size:
        ends = divmod(int(edge[bad[0]]), nodes)
        raise surface.wrong(
            "the two triangles at the edge between "
            f"{surface.named(*ends)} at {surface.at(ends[0])} face opposite ways"
            f"{_in_all(len(bad), 'edge')}, so that the prisms of one are inverted; order the "
            "corners of all triangles alike"
        )


def _check_connected(surface: TriangulatedSurface) -> None:
    """Refuse nodes that do not hang together."""
    nodes = len(surface.position)
    start, end = surface.triangles.ravel(), np.roll(surface.triangles, 1, axis=1).ravel()
    graph = scipy.sparse.coo_array(
        (np.ones(len(start), np.int8), (start, end)), shape=(nodes, nodes)
    )
    parts, part = scipy.sparse.csgraph.connected_components(graph, directed=False)
    if parts > 1:
        other = int(np.flatnonzero(part != part[0])[0])
        raise surface.wrong(
            f"the surface has {parts} parts that do not touch: {surface.named(0)} at "
            f"{surface.at(0)} is of one, {surface.named(other)} at {surface.at(other)} of "
            "another; make a volume of each"
        )


def check_prisms(surface: TriangulatedSurface, normal: Array, depth: Array) -> None:
    """Complain about prisms that are inverted or have no volume somewhere.

    A prism's Jacobian at its corner c is ``J(d) = n_c . (u + d p) x (v + d q)`` at the depth d,
    with two sides u, v of its triangle and the differences p, q of the normals along them; in
    between it is interpolated, so that the prism is sound if all three stay positive.

    Parameters
    ----------
    normal : ndarray, shape (node, 3)
        Of length one.
    depth : ndarray, shape (layer,), m
        Ascending.

    Raises
    ------
    UserError
        If a normal points away from one of its triangles, or normals meet between depth 0 and
        the farthest layers.
    """
    j0, j1, j2 = _jacobian(surface, normal)
    area = np.linalg.norm(area_vectors(surface), axis=1)
    if (bad := np.argwhere(j0 <= FOLDED * area[:, None])).size:
        triangle, corner = bad[0]
        nodes = surface.triangles[triangle]
        raise surface.wrong(
            f"the prisms on the triangle of {surface.named(*nodes)} are inverted: the normal of "
            f"{surface.named(nodes[corner])} at {surface.at(nodes[corner])} points to its other "
            "side; the surface must turn by less than 90 degrees from one triangle to the next"
        )
    low, high = min(depth[0], 0.0), max(depth[-1], 0.0)
    turning = np.clip(-j1 / np.where(j2 == 0, np.inf, 2 * j2), low, high)
    least = np.min([j0 + d * (j1 + d * j2) for d in (low, high, turning)], axis=0)
    folded = (least <= FOLDED * j0).any(axis=1)
    if folded.any():
        where = _first_fold(j0[folded], j1[folded], j2[folded], low, high)
        nodes = surface.triangles[np.flatnonzero(folded)[where[0]]]
        raise surface.wrong(
            f"the prisms on the triangle of {surface.named(*nodes)} at {surface.at(nodes[0])} "
            f"have no volume at a depth of {where[1]:.4g} m and are inverted beyond, because the "
            f"normals meet there{_in_all(int(folded.sum()), 'triangle')}; the layers, from "
            f"{depth[0]:.4g} to {depth[-1]:.4g} m, must stay on this side of it"
        )


def _jacobian(surface: TriangulatedSurface, normal: Array) -> tuple[Array, Array, Array]:
    """Compute coefficients of 1, d and d^2 of J at every corner, each of shape (triangle, 3)."""
    place, turn = surface.position[surface.triangles], normal[surface.triangles]
    u, v = place[:, 1] - place[:, 0], place[:, 2] - place[:, 0]
    p, q = turn[:, 1] - turn[:, 0], turn[:, 2] - turn[:, 0]
    areas = (np.cross(u, v), np.cross(u, q) + np.cross(p, v), np.cross(p, q))
    j0, j1, j2 = (np.einsum("tci,ti->tc", turn, area) for area in areas)
    return j0, j1, j2


def _first_fold(j0: Array, j1: Array, j2: Array, low: float, high: float) -> tuple[int, float]:
    """Find which of folded triangles folds first when the depth grows from 0, and where."""
    with np.errstate(divide="ignore", invalid="ignore"):
        # The stable form of the roots; j0 > 0, so that neither divisor is zero at a root.
        half = -(j1 + np.copysign(np.sqrt(np.maximum(j1**2 - 4 * j0 * j2, 0.0)), j1)) / 2
        roots = np.stack([half / j2, j0 / half])
    # A depth that is FOLDED from a double root lies beside it by the root of FOLDED.
    valid = (roots >= 1.01 * low) & (roots <= 1.01 * high)
    distance = np.where(valid, np.abs(roots), np.inf)
    root, triangle, corner = np.unravel_index(np.argmin(distance), distance.shape)
    return int(triangle), float(roots[root, triangle, corner])


def _in_all(count: int, what: str) -> str:
    """Count such places if there are more than the one that a message names."""
    return f" ({count} {what}s in all)" if count > 1 else ""
