"""Gradients of what is given at nodes alone, along the surface that the nodes lie in.

Around each node a polynomial of second to fourth order in two tangent coordinates is fitted to its
nearest neighbours; its linear terms are the gradient. Neighbours round a corner, whose normals
differ, have no say.
"""

from __future__ import annotations

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.typing import Array

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


def recovered_gradients(position: Array, normal: Array, values: Array) -> Array:
    """Differentiate values at nodes along the surface.

    Parameters
    ----------
    position : ndarray, shape (node, 3), m
    normal : ndarray, shape (node, 3)
    values : ndarray, shape (node, component, mode)

    Returns
    -------
    ndarray, shape (node, 3, component, mode), 1/m
        Along the world's axes; zero along the normal.

    Examples
    --------
    >>> x, y = (axis.ravel() for axis in np.meshgrid(np.arange(5.0), np.arange(5.0)))
    >>> flat = np.stack([x, y, 0 * x], axis=1)
    >>> up = np.tile([0.0, 0.0, 1.0], (25, 1))
    >>> recovered_gradients(flat, up, (x * y)[:, None, None])[7, :, 0, 0].round(9).tolist()
    [1.0, 2.0, 0.0]
    """
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
    slope = inverse[:, 1:3] * (weight / size[:, None])[:, None]  # of x, then of y
    own = np.einsum("nak,nkcm->nacm", slope, values[near])
    return np.asarray(np.einsum("nad,nacm->ndcm", plane, own))
