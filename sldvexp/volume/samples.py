"""Sample points in prisms (Section 5.3.4): where they lie and which nodes they mix.

A rule is the product of symmetric points of the triangle and Gauss points of the line, or a list of
points. With products the equations may be a Kronecker product of surface and depth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.lazy import scipy
from sldvexp.typing import Array, IntArray


@dataclass(frozen=True, eq=False)
class Prisms:
    """Layers of one triangulated surface, moved along its normals, and the prisms between them.

    Node ``layer * surface_nodes + surface_node`` stands at ``surface + depth[layer] * normal``:
    with 63 surface nodes, the nodes 127 to 252 (counted from 1) are the layers 3 and 4.

    Parameters
    ----------
    position : ndarray, shape (node, 3), m
        In the world, layer by layer.
    triangles : ndarray of int, shape (triangle, 3)
        Surface nodes, counter-clockwise seen from the side to which the normals point.
    depth : ndarray, shape (layer,), m
        Along the normals, ascending; 0 is the given surface.
    frame : ndarray, shape (surface_node, 3, 3)
        Unit rows t1, t2, n in the world's axes, right-handed.
    """

    position: Array
    triangles: IntArray
    depth: Array
    frame: Array

    @property
    def layers(self) -> int:
        """Number of surfaces."""
        return len(self.depth)

    @property
    def gaps(self) -> int:
        """Number of layers of prisms."""
        return self.layers - 1

    @property
    def surface_nodes(self) -> int:
        """Nodes of one layer."""
        return len(self.frame)

    @property
    def nodes(self) -> int:
        """Nodes of all layers."""
        return len(self.position)

    @property
    def surface(self) -> Array:
        """Nodes of the given surface, at depth 0, shape (surface_node, 3), m."""
        lowest = self.position[: self.surface_nodes]
        return np.asarray(lowest - self.depth[0] * self.frame[:, 2])

    @property
    def layer(self) -> IntArray:
        """Layer that each node belongs to, from 0, shape (node,)."""
        return np.repeat(np.arange(self.layers), self.surface_nodes)

    @property
    def element(self) -> IntArray:
        """Nodes of each prism, shape (element, 6), ``element = gap * triangles + triangle``.

        The corners 0 to 2 are of the lower layer, 3 to 5 stand above them, as in Eq 5.20.
        """
        step = self.surface_nodes
        one_gap = np.concatenate([self.triangles, self.triangles + step], axis=1)
        return (step * np.arange(self.gaps)[:, None, None] + one_gap).reshape(-1, 6)

    @property
    def node_frame(self) -> Array:
        """Frame of every node, shape (node, 3, 3): that of its surface node, in each layer."""
        return np.tile(self.frame, (self.layers, 1, 1))


def extruded(surface: Array, triangles: IntArray, frame: Array, depth: Array) -> Prisms:
    """Extrude a surface along its normals to prisms between its copies.

    Parameters
    ----------
    surface : ndarray, shape (surface_node, 3), m
    triangles : ndarray of int, shape (triangle, 3)
    frame : ndarray, shape (surface_node, 3, 3)
    depth : ndarray, shape (layer,), m
        Ascending.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.volume import extruded
    >>> surface, triangle = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]), np.array([[0, 1, 2]])
    >>> prisms = extruded(surface, triangle, np.array(3 * [np.eye(3)]), np.array([0, 2.0]))
    >>> prisms.nodes, prisms.element.tolist(), prisms.position[3].tolist()
    (6, [[0, 1, 2, 3, 4, 5]], [0.0, 0.0, 2.0])
    """
    position = surface + depth[:, None, None] * frame[:, 2]
    return Prisms(position.reshape(-1, 3), triangles, depth, frame)


WHOLE = slice(None)


@dataclass(frozen=True, eq=False)
class SampleRule:
    """Places of samples in every prism: the parameters xi1, xi2, xi3, zeta of Eq 5.19.

    Parameters
    ----------
    parameter : ndarray, shape (point, 4)
        Barycentric xi1, xi2, xi3, which add up to 1, and zeta from -1 (lower) to 1 (upper layer).
    triangle : ndarray, shape (triangle_point, 3), optional
    line : ndarray, shape (line_point,), optional
        The factors, if the parameters are their tensor product:
        ``point = line_point * triangle_points + triangle_point``.
    """

    parameter: Array
    triangle: Array | None = None
    line: Array | None = None

    @classmethod
    def tensor(cls, triangle: Array, line: Array) -> SampleRule:
        """Combine all pairs of triangle points (q, 3) and zetas (r,)."""
        xi = np.tile(triangle, (len(line), 1))
        zeta = np.repeat(line, len(triangle))
        return cls(np.column_stack([xi, zeta]), triangle, line)

    @property
    def points(self) -> int:
        """Samples in each prism."""
        return len(self.parameter)

    def shape(self) -> Array:
        """Evaluate the basis functions N1 to N6 of a prism (Eq 5.20), shape (point, 6)."""
        xi, half = self.parameter[:, :3], _line_shape(self.parameter[:, 3])
        return np.concatenate([xi * half[:, :1], xi * half[:, 1:]], axis=1)

    def triangle_shape(self) -> Array:
        """Evaluate the basis functions of a tensor product's triangle, shape (triangle_point, 3).

        With `line_shape`, ``shape[(r, q), (h, c)] = line_shape[r, h] triangle_shape[q, c]``.
        """
        assert self.triangle is not None, "the rule is no tensor product"
        return self.triangle

    def line_shape(self) -> Array:
        """Evaluate a tensor product's basis functions through the thickness, (line_point, 2)."""
        assert self.line is not None, "the rule is no tensor product"
        return _line_shape(self.line)


def sample_positions(
    prisms: Prisms, rule: SampleRule, triangles: slice | NDArray[np.integer] = WHOLE
) -> Array:
    """Compute sample points in the world, ``P = sum_i N_i P_i`` (Section 5.3.4).

    Parameters
    ----------
    triangles : slice
        Of the surface's triangles, to go through a large volume in parts.

    Returns
    -------
    ndarray, shape (gap, triangle, point, 3), m

    Examples
    --------
    >>> from sldvexp.volume import Grid, sample_positions
    >>> plate = Grid(size=[0.3, 0.3], shape=[2, 2], layers=2)
    >>> sample_positions(plate.prisms(), plate.rule()).shape
    (1, 2, 6, 3)
    """
    layers = prisms.position.reshape(prisms.layers, prisms.surface_nodes, 3)
    corner = layers[:, prisms.triangles[triangles]]
    shape = rule.shape()
    return shape[:, :3] @ corner[:-1] + shape[:, 3:] @ corner[1:]


def sample_frames(
    prisms: Prisms, rule: SampleRule, triangles: slice | NDArray[np.integer] = WHOLE
) -> Array:
    """Interpolate tangents and normal of the nodes at the samples, and make them orthonormal again.

    Parameters
    ----------
    triangles : slice
        As for `sample_positions`.

    Returns
    -------
    ndarray, shape (gap, triangle, point, 3, 3)
        Unit rows t1, t2, n, right-handed. The same in every gap: a read-only view.
    """
    corner = prisms.frame[prisms.triangles[triangles]]
    t1, _, n = np.moveaxis(np.einsum("pc,tcij->tpij", rule.parameter[:, :3], corner), 2, 0)
    frame = orthonormal(t1, n)
    return np.broadcast_to(frame, (prisms.gaps, *frame.shape))


def shape_matrix(prisms: Prisms, rule: SampleRule) -> scipy.sparse.csr_array:
    """Compute the matrix N of Eq 5.32: a sample's value from the nodal values.

    Returns
    -------
    scipy.sparse.csr_array, shape (sample, node)
        ``sample = (gap * triangles + triangle) * points + point``.

    Examples
    --------
    >>> from sldvexp.volume import Grid, shape_matrix
    >>> plate = Grid(size=[0.3, 0.3], shape=[2, 2], layers=2)
    >>> basis = shape_matrix(plate.prisms(), plate.rule())
    >>> basis.shape, basis.sum(axis=1).round(9).max().item()
    ((12, 8), 1.0)
    """
    element, shape = prisms.element, rule.shape()
    samples = len(element) * rule.points
    index = np.int32 if 6 * samples < np.iinfo(np.int32).max else np.int64
    columns = np.repeat(element.astype(index), rule.points, axis=0).ravel()
    rows = np.arange(0, 6 * samples + 1, 6, dtype=index)
    values = np.tile(shape.ravel(), len(element))
    matrix = scipy.sparse.csr_array((values, columns, rows), shape=(samples, prisms.nodes))
    matrix.sort_indices()
    return matrix


def orthonormal(t1: Array, n: Array) -> Array:
    """Make right-handed unit rows t1, t2, n with n along the given one, shape (..., 3, 3).

    Parameters
    ----------
    t1, n : ndarray, shape (..., 3)
        Of any length but zero, and not parallel.
    """
    n = n / np.linalg.norm(n, axis=-1, keepdims=True)
    t1 = t1 - np.einsum("...i,...i->...", t1, n)[..., None] * n
    t1 = t1 / np.linalg.norm(t1, axis=-1, keepdims=True)
    return np.stack([t1, np.cross(n, t1), n], axis=-2)


def _line_shape(zeta: Array) -> Array:
    """Evaluate the linear basis functions on the line from -1 to 1, shape (..., 2)."""
    return np.stack([(1.0 - zeta) / 2.0, (1.0 + zeta) / 2.0], axis=-1)


#: Generators of symmetric Gauss points of the triangle (Dunavant 1985; degrees 1, 2, 4, 5
#: and 6 are exact): the centroid, (a, a, 1 - 2a) with its 3 places, (a, b, 1 - a - b) with its 6.
_ROOT = math.sqrt(15.0)
_CENTROID = (1.0 / 3.0, 1.0 / 3.0)
TRIANGLE_POINTS: dict[int, tuple[tuple[float, float], ...]] = {
    1: (_CENTROID,),
    3: ((1.0 / 6.0, 1.0 / 6.0),),
    6: ((0.445948490915965,) * 2, (0.091576213509771,) * 2),
    7: (_CENTROID, ((6.0 - _ROOT) / 21.0,) * 2, ((6.0 + _ROOT) / 21.0,) * 2),
    12: (
        (0.249286745170910,) * 2,
        (0.063089014491502,) * 2,
        (0.310352451033785, 0.053145049844816),
    ),
}  # fmt: skip


def tensor_rule(triangle: int, line: int) -> SampleRule:
    """Multiply Gauss points of the triangle and Gauss points of the line.

    Parameters
    ----------
    triangle : int
        One of `TRIANGLE_POINTS`.
    line : int
        Through the thickness of each prism, 1 or more.

    Examples
    --------
    >>> from sldvexp.volume import tensor_rule
    >>> tensor_rule(triangle=1, line=2).parameter.round(3).tolist()
    [[0.333, 0.333, 0.333, -0.577], [0.333, 0.333, 0.333, 0.577]]
    """
    return SampleRule.tensor(triangle_points(triangle), np.polynomial.legendre.leggauss(line)[0])


def triangle_points(count: int) -> Array:
    """List barycentric coordinates of symmetric points inside a triangle, shape (count, 3)."""
    places: list[tuple[float, ...]] = []
    for a, b in TRIANGLE_POINTS[count]:
        places += _orbit(a, b, 1.0 - a - b)
    return np.array(places)


def _orbit(a: float, b: float, c: float) -> list[tuple[float, ...]]:
    """List the different permutations of barycentric coordinates with a = b, or with none alike."""
    turned: list[tuple[float, ...]] = [(a, b, c), (c, a, b), (b, c, a)]
    if math.isclose(a, b):
        return turned[:1] if math.isclose(a, c) else turned
    return [*turned, *((p[1], p[0], p[2]) for p in turned)]
