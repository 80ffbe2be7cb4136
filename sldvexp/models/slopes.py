"""Gradients of what is given at nodes alone, along the surface that the nodes lie in.

Around each node a polynomial of second to fourth order in two tangent coordinates is fitted to its
nearest neighbours; its linear terms are the gradient. Neighbours round a corner, whose normals
differ, have no say.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.typing import Array, IntArray

#: Order of the polynomial by the least number of nodes of a surface, and neighbours of the fit.
ORDERS = ((60, 4, 28), (20, 3, 18), (9, 2, 9), (0, 1, 5))
#: Cosine between normals from which neighbours have a say.
ALIKE = 0.5


def tangents(normal: Array) -> Array:
    """Choose two unit tangents beside each unit normal, shape (..., 2, 3).

    Examples
    --------
    >>> tangents(np.array([0.0, 0.0, 1.0])).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
    """
    least = np.argmin(np.abs(normal), axis=-1)
    axis = np.eye(3)[least]
    first = axis - np.sum(axis * normal, axis=-1, keepdims=True) * normal
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.stack([first, np.cross(normal, first)], axis=-2)


@dataclass(frozen=True, eq=False)
class NodalSlopes:
    """Slopes at the nodes of a surface, linear in what is given there.

    Attributes
    ----------
    near : ndarray of int, shape (node, neighbour)
    share : ndarray, shape (node, 2, neighbour), 1/m
        Of each neighbour's value in the slopes along both tangents.
    plane : ndarray, shape (node, 2, 3)
        The tangents.
    """

    near: IntArray
    share: Array
    plane: Array

    @classmethod
    def on(cls, position: Array, normal: Array) -> NodalSlopes:
        """Fit the polynomials of a surface.

        Parameters
        ----------
        position : ndarray, shape (node, 3), m
        normal : ndarray, shape (node, 3)
        """
        return cls(*_fitted(position, normal))

    def gradients(self, values: Array) -> Array:
        """Differentiate values at nodes along the surface.

        Parameters
        ----------
        values : ndarray, shape (node, component, mode)

        Returns
        -------
        ndarray, shape (node, 3, component, mode), 1/m
            Along the world's axes; zero along the normal.

        Examples
        --------
        >>> x, y = (axis.ravel() for axis in np.meshgrid(np.arange(5.0), np.arange(5.0)))
        >>> flat = np.stack([x, y, 0 * x], axis=1)
        >>> slopes = NodalSlopes.on(flat, np.tile([0.0, 0.0, 1.0], (25, 1)))
        >>> slopes.gradients((x * y)[:, None, None])[7, :, 0, 0].round(9).tolist()
        [1.0, 2.0, 0.0]
        """
        own = np.einsum("nak,nkcm->nacm", self.share, values[self.near])
        return np.asarray(np.einsum("nad,nacm->ndcm", self.plane, own))


def _fitted(position: Array, normal: Array) -> tuple[IntArray, Array, Array]:
    """Find neighbours, their shares in the linear terms, and the tangents."""
    order, count = next((o, n) for least, o, n in ORDERS if len(position) >= least)
    count = min(count, len(position))
    _, near = scipy.spatial.KDTree(position).query(position, k=count)
    near = near.reshape(len(position), count)
    plane = tangents(normal)
    step = np.einsum("nkd,nad->nka", position[near] - position[:, None], plane)
    size = np.linalg.norm(step, axis=2).max(axis=1)
    x, y = np.moveaxis(step / size[:, None, None], 2, 0)
    powers = [(i, n - i) for n in range(order + 1) for i in range(n, -1, -1)]
    terms = np.stack([x**i * y**j for i, j in powers], axis=-1)
    alike = np.einsum("nkd,nd->nk", normal[near], normal) > ALIKE
    weight = alike / (0.3 + x**2 + y**2)  # nearer neighbours tell more of the slope
    inverse = np.linalg.pinv(weight[..., None] * terms, rcond=1e-9)
    return near, inverse[:, 1:3] * (weight / size[:, None])[:, None], plane  # of x, then of y
