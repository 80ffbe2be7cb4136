"""Error of a field because its elements cannot follow it, estimated from the field itself.

A least-squares fit of linear elements to a smooth u gives ``u_h = u - h^2/12 u''`` at the nodes, in
one dimension: its mass matrix M passes a wave with ``1 - (kh)^2/6``, the samples' right side with
``1 - (kh)^2/12``. With the lumped (row sum) matrix L, ``u_h - L^-1 M u_h = -h^2/6 u''``, which is
twice the error. The same holds along each direction of a surface. ``L^-1 M`` is also a mean of a
node and those around it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.geometry import rim
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, ComplexArray
from sldvexp.volume import Prisms, SampleRule


@dataclass(frozen=True, eq=False)
class SurfaceMean:
    """Mean of nodal values over each node and those around it, layer by layer.

    Parameters
    ----------
    weights : csr_array, shape (surface_node, surface_node)
        ``L^-1 M`` of the surface's triangles: rows sum to one.
    rim : ndarray of bool, shape (surface_node,)
        Nodes with triangles on one side only.
    """

    layers: int
    weights: scipy.sparse.csr_array
    rim: BoolArray

    @classmethod
    def from_prisms(cls, prisms: Prisms, rule: SampleRule) -> SurfaceMean:
        """Prepare it for a volume."""
        return cls(prisms.layers, _surface_mass(prisms, rule), _rim(prisms))

    def of(self, values: Array | ComplexArray) -> Array | ComplexArray:
        """Average (node, ...) over what is known around each node; NaN where nothing is."""
        flat = values.reshape(self.layers, len(self.rim), -1)
        known = np.isfinite(flat)
        if known.all():
            return np.stack([self.weights @ layer for layer in flat]).reshape(values.shape)
        sums = np.stack([self.weights @ layer for layer in np.where(known, flat, 0.0)])
        share = np.stack([self.weights @ layer for layer in known.astype(float)])
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(share > 0, sums / share, np.nan).reshape(values.shape)

    def filled(self, values: Array | ComplexArray) -> Array | ComplexArray:
        """Fill nodes that are NaN with the mean of those around them, ring by ring."""
        left = np.isnan(values)
        while left.any():
            values = np.where(left, self.of(values), values)
            if np.array_equal(still := np.isnan(values), left):
                break
            left = still
        return values


def element_error(mean: SurfaceMean, velocity: ComplexArray) -> ComplexArray:
    """Estimate the error of nodal values along the surface, ``(u_h - L^-1 M u_h) / 2``.

    Parameters
    ----------
    velocity : ndarray of complex, shape (node, component, frequency), m/s

    Returns
    -------
    ndarray of complex, shape (node, component, frequency), m/s
        What is to be subtracted. About a third of the standard error is in it where there is no
        such error, an eighth in its mean over the nodes around. At the rim, where one side is
        missing, and beside nodes that are NaN it is the neighbours' mean; NaN where the velocity
        is, and everywhere if there is no inner node.
    """
    by_layer = velocity.reshape(mean.layers, len(mean.rim), -1)
    twice = np.stack([layer - np.asarray(mean.weights @ layer) for layer in by_layer])
    twice[:, mean.rim] = np.nan
    error = mean.filled(twice.reshape(velocity.shape) / 2)
    return np.where(np.isnan(velocity), np.nan, error)


def _surface_mass(prisms: Prisms, rule: SampleRule) -> scipy.sparse.csr_array:
    """Compute ``L^-1 M`` of the surface's triangles, shape (surface_node, surface_node)."""
    shape = rule.parameter[:, :3]
    local = shape.T @ shape
    corners = prisms.triangles
    rows, columns = np.repeat(corners, 3, axis=1), np.tile(corners, (1, 3))
    data = np.tile(local.ravel(), len(corners))
    size = (prisms.surface_nodes, prisms.surface_nodes)
    mass = scipy.sparse.csr_array((data, (rows.ravel(), columns.ravel())), shape=size)
    sums = np.asarray(mass.sum(axis=1)).ravel()
    return scipy.sparse.csr_array(
        scipy.sparse.diags_array(1 / np.where(sums == 0, 1.0, sums)) @ mass
    )


def _rim(prisms: Prisms) -> BoolArray:
    """Find nodes of sides that belong to one triangle only."""
    found = np.zeros(prisms.surface_nodes, bool)
    found[rim(prisms.triangles)] = True
    return found
