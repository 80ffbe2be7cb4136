"""Modes without clicks: poles that stay as the order grows, and the clusters that they form.

A pole of one order is stable if the order below has one of nearly the same frequency, damping and
shape. Stable poles are joined to clusters by their distance ``df / f + 0.05 (1 - MAC)``; a mode is
a cluster that a good share of the orders has.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.modes.compression import PrincipalResponses
from sldvexp.modes.model import basis, split
from sldvexp.typing import Array, BoolArray, ComplexArray, IndexArray

#: Weight of shapes in the distance of two poles, and the distance that separates clusters.
SHAPE_WEIGHT, APART = 0.05, 0.01


@dataclass(frozen=True, eq=False)
class Stabilisation:
    """Poles of all orders within the band.

    Parameters
    ----------
    order : ndarray of int, shape (candidate,)
    pole : ndarray of complex, shape (candidate,), rad/s
    stable : ndarray of bool, shape (candidate,)
    mode : ndarray of int, shape (candidate,)
        Number of the mode from 0, -1 for poles of none.
    """

    order: IndexArray
    pole: ComplexArray
    stable: BoolArray
    mode: IndexArray

    @property
    def modes(self) -> int:
        """How many there are."""
        return int(self.mode.max(initial=-1)) + 1

    def renumbered(self, kept: IndexArray) -> Stabilisation:
        """Keep some of the modes, in another order."""
        mode = np.full(len(self.mode), -1)
        for new, old in enumerate(kept):
            mode[self.mode == old] = new
        return replace(self, mode=mode)

    def nearest(self, poles: ComplexArray) -> Stabilisation:
        """Give clusters the number of the pole that lies nearest, of several that are equal one."""
        own = np.array([int(np.abs(poles - start).argmin()) for start in self.starts()], int)
        return replace(self, mode=np.where(self.mode < 0, -1, own[self.mode]))

    def starts(self) -> ComplexArray:
        """Take the medians of each mode's poles, rad/s."""
        own = [self.pole[self.mode == k] for k in range(self.modes)]
        return np.array([np.median(p.real) + 1j * np.median(p.imag) for p in own], complex)


@dataclass(frozen=True)
class StabilityRules:
    """Largest changes of a stable pole from one order to the next, and what makes it a mode.

    Parameters
    ----------
    frequency, damping : float
        Relative changes.
    mac : float
        Smallest modal assurance criterion of the two shapes.
    highest_damping : float
    share : float
        Smallest share of the orders that a mode must have.
    """

    frequency: float
    damping: float
    mac: float
    highest_damping: float
    share: float


def stabilise(
    poles: Mapping[int, ComplexArray], responses: PrincipalResponses, rules: StabilityRules
) -> Stabilisation:
    """Find stable poles and their clusters."""
    omega = responses.omega
    orders, found, stable, shapes = [], [], [], []
    last: tuple[ComplexArray, ComplexArray] | None = None
    for order in sorted(poles):
        own = poles[order]
        damping = -own.real / np.abs(own)
        inside = (own.imag > omega[0]) & (own.imag < omega[-1])
        own = own[(damping > 0) & (damping < rules.highest_damping) & inside]
        shape = shapes_of(own, responses)
        orders.append(np.full(len(own), order))
        found.append(own)
        shapes.append(shape)
        stable.append(_stable(own, shape, *last, rules) if last else np.zeros(len(own), bool))
        last = own, shape
    all_orders, all_poles = np.concatenate(orders), np.concatenate(found)
    steady, directions = np.concatenate(stable), np.concatenate(shapes)
    mode = np.full(len(all_poles), -1)
    if steady.any():
        cluster = _clusters(all_poles[steady], directions[steady])
        mode[steady] = _kept(cluster, all_orders[steady], all_poles[steady], rules, len(poles))
    return Stabilisation(all_orders, all_poles, steady, mode)


def shapes_of(poles: ComplexArray, responses: PrincipalResponses) -> ComplexArray:
    """Fit residues of the principal responses at given poles, each of unit length.

    Returns
    -------
    ndarray of complex, shape (pole, response)
    """
    rows = responses.weighted(basis(poles, responses.omega))
    found = np.linalg.lstsq(rows, split(responses.values.T), rcond=None)[0]
    count = len(poles)
    shape = found[:count] + 1j * found[count : 2 * count]
    return np.asarray(shape / np.maximum(np.linalg.norm(shape, axis=1, keepdims=True), 1e-300))


def mac(some: ComplexArray, others: ComplexArray) -> Array:
    """Compute the modal assurance criterion of shapes of unit length, (some, others).

    Examples
    --------
    >>> mac(np.array([[1.0, 0.0]]), np.array([[1j, 0.0], [0.6, 0.8]])).round(2).tolist()
    [[1.0, 0.36]]
    """
    return np.asarray(np.abs(some.conj() @ others.T) ** 2)


def _stable(
    poles: ComplexArray,
    shapes: ComplexArray,
    before: ComplexArray,
    shapes_before: ComplexArray,
    rules: StabilityRules,
) -> BoolArray:
    """Compare each pole with the nearest one of the order below."""
    if not len(poles) or not len(before):
        return np.zeros(len(poles), bool)
    nearest = np.abs(before - poles[:, None]).argmin(axis=1)
    other = before[nearest]
    frequency = np.abs(np.abs(other) / np.abs(poles) - 1)
    damping = np.abs((other.real / np.abs(other)) / (poles.real / np.abs(poles)) - 1)
    alike = mac(shapes, shapes_before)[np.arange(len(poles)), nearest]
    return (frequency < rules.frequency) & (damping < rules.damping) & (alike > rules.mac)


def _clusters(poles: ComplexArray, shapes: ComplexArray) -> IndexArray:
    """Join poles that are near one another, by the mean distance of clusters."""
    if len(poles) == 1:
        return np.zeros(1, int)
    size = np.abs(poles)
    distance = np.abs(size[:, None] - size) / np.maximum(size[:, None], size)
    distance += SHAPE_WEIGHT * (1 - mac(shapes, shapes))
    pairs = distance[np.triu_indices(len(poles), 1)]
    tree = scipy.cluster.hierarchy.linkage(pairs, "average")
    return np.asarray(scipy.cluster.hierarchy.fcluster(tree, APART, "distance"))


def _kept(
    cluster: IndexArray, orders: IndexArray, poles: ComplexArray, rules: StabilityRules, count: int
) -> IndexArray:
    """Give clusters that enough orders have a number, by their frequency, and -1 to the others."""
    names = np.unique(cluster)
    kept = [c for c in names if len(np.unique(orders[cluster == c])) >= rules.share * count]
    kept.sort(key=lambda c: float(np.median(poles[cluster == c].imag)))
    number = {c: k for k, c in enumerate(kept)}
    return np.array([number.get(c, -1) for c in cluster])
