"""Error of a field because its elements cannot follow it, estimated from the field itself.

A least-squares fit of linear elements to a smooth u gives ``u_h = u - h^2/12 u''`` at the nodes, in
one dimension: its mass matrix M passes a wave with ``1 - (kh)^2/6``, the samples' right side with
``1 - (kh)^2/12``. With the lumped (row sum) matrix L, ``u_h - L^-1 M u_h = -h^2/6 u''``, which is
twice the error. The same holds along each direction of a surface.
"""

from __future__ import annotations

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.typing import Array, ComplexArray
from sldvexp.volume import Prisms, SampleRule

#: Share of the bounds above which the error is told.
WORTH_TELLING = 0.5


def element_error(prisms: Prisms, rule: SampleRule, velocity: ComplexArray) -> ComplexArray:
    """Estimate the error of nodal values along the surface, ``(u_h - L^-1 M u_h) / 2``.

    Parameters
    ----------
    velocity : ndarray of complex, shape (node, component, frequency), m/s

    Returns
    -------
    ndarray of complex, shape (node, component, frequency), m/s
        What is to be subtracted. About a third of the standard error is in it where there is no
        such error. At the rim, where one side is missing, it is the neighbours' mean; NaN beside
        nodes that are NaN.
    """
    mass = _surface_mass(prisms, rule)
    from_inside = _from_inside(prisms, mass)
    by_layer = velocity.reshape(prisms.layers, prisms.surface_nodes, -1)
    twice = [layer - np.asarray(mass @ layer) for layer in by_layer]
    error: ComplexArray = np.array([from_inside @ t for t in twice], complex)
    return np.asarray(error.reshape(velocity.shape) / 2)


def _surface_mass(prisms: Prisms, rule: SampleRule) -> scipy.sparse.csr_array:
    """Compute ``L^-1 M`` of the surface's triangles, shape (surface_node, surface_node)."""
    shape = rule.parameter[:, :3]
    local = shape.T @ shape
    corners = prisms.triangles
    rows, columns = np.repeat(corners, 3, axis=1), np.tile(corners, (1, 3))
    data = np.tile(local.ravel(), len(corners))
    size = (prisms.surface_nodes, prisms.surface_nodes)
    return _rows_to_one(scipy.sparse.csr_array((data, (rows.ravel(), columns.ravel())), shape=size))


def _from_inside(prisms: Prisms, mass: scipy.sparse.csr_array) -> scipy.sparse.csr_array:
    """Keep the values of inner nodes; give a rim node the mean of the inner ones beside it."""
    edges = np.sort(prisms.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    rim = np.zeros(prisms.surface_nodes, bool)
    rim[unique[count == 1]] = True
    inner = scipy.sparse.csr_array(scipy.sparse.diags_array(1.0 - rim))
    beside = scipy.sparse.csr_array(
        scipy.sparse.diags_array(rim.astype(float)) @ mass.astype(bool).astype(float) @ inner
    )
    return scipy.sparse.csr_array(_rows_to_one(beside) + inner)


def _rows_to_one(matrix: scipy.sparse.csr_array) -> scipy.sparse.csr_array:
    """Divide rows by their sums; empty ones stay empty."""
    sums = np.asarray(matrix.sum(axis=1)).ravel()
    return scipy.sparse.csr_array(
        scipy.sparse.diags_array(1 / np.where(sums == 0, 1.0, sums)) @ matrix
    )


def mean_squares(error: ComplexArray, confidence: Array) -> Array:
    """Average squares of the elements' error and of the bounds, shape (2, component), m2/s2.

    Parameters
    ----------
    error : ndarray of complex, shape (node, component, frequency), m/s
    confidence : ndarray, shape (node, component, frequency), m/s
    """
    return np.stack([_mean_square(np.abs(error)), _mean_square(confidence)])


def _mean_square(values: Array) -> Array:
    """Average squares of what is determined, shape (component,); NaN where nothing is."""
    count = np.isfinite(values).sum(axis=(0, 2))
    total = np.nansum(values**2, axis=(0, 2))
    return np.divide(total, count, out=np.full(len(count), np.nan), where=count > 0)


def told(squares: Array) -> list[str]:
    """Say so if the elements' error, see `mean_squares`, is not small against the bounds."""
    size, bound = np.sqrt(squares)
    worst = int(np.nanargmax(size / bound))
    if not size[worst] > WORTH_TELLING * bound[worst]:
        return []
    return [
        f"the elements are coarse for this field: they add about {size[worst]:.2g} m/s (r.m.s.) to "
        f"a component whose bounds, {bound[worst]:.2g} m/s, do not contain that; elements of half "
        "the size add a quarter"
    ]
