"""A family of surfaces made of triangular prisms (Section 5.3.1), the volume of Section 5.3.3."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

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
