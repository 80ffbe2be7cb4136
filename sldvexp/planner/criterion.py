"""Criterion of stands: the bounds of a node from the directions in which it is seen.

A view k that sees a node along the unit vector d_k with pixels of standard error sigma adds
``d_k d_k' / sigma^2`` to its information, so that the covariance of its velocity is ``C = (sum_k
d_k d_k' / sigma^2)^-1``; here sigma is 1, and bounds are in units of the pixels' noise. One more
view changes the variance along a direction u without any inverse (Sherman and Morrison),

    u' C+ u = u' C u - (u' C d)^2 / (1 + d' C d).

A small prior, ``C = PRIOR I`` of a node that nobody sees, makes this hold from the first view on;
it costs a direction that no view sees so much that the next stand goes there.

Analytic limits: N stands evenly on a cone of half-angle t around the normal give ``sqrt(2/N) /
sin t`` along the surface and ``1 / (sqrt(N) cos t)`` across it; the mean of all is smallest at
``tan^2 t = 2``, where all three are ``sqrt(3/N)``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sldvexp.config.planning import PlanCriterion
from sldvexp.typing import Array, IntArray

#: Variance of what no view sees, in units of the pixels' variance.
PRIOR = 1e3


@dataclass(frozen=True, eq=False)
class Goal:
    """Goal that stands are compared by: bounds of some directions at every node.

    Parameters
    ----------
    wanted : ndarray, shape (node, direction, 3)
        Unit vectors u.
    criterion : PlanCriterion
    weight : ndarray, shape (node,)
        Of each node in the mean, together 1; nodes of no weight do not count.
    factor : ndarray, shape (node,)
        Standard error of the reconstruction over that of the closed form, from the pixels, samples
        and elements around each node; ones until it is known.
    """

    wanted: Array
    criterion: PlanCriterion
    weight: Array
    factor: Array

    @classmethod
    def evenly(cls, wanted: Array, criterion: PlanCriterion) -> Goal:
        """Let all nodes count alike, and be as the closed form says."""
        nodes = len(wanted)
        return cls(wanted, criterion, np.full(nodes, 1 / nodes), np.ones(nodes))

    def with_factor(self, factor: Array) -> Goal:
        """Give the nodes other factors."""
        return replace(self, factor=factor)

    def of_nodes(self, chosen: IntArray) -> Goal:
        """Keep some nodes."""
        return Goal(self.wanted[chosen], self.criterion, self.weight[chosen], self.factor[chosen])

    def value(self, variance: Array) -> Array:
        """Compute the criterion of variances ``u' C u``, shape (..., node, direction)."""
        square = variance * np.square(self.factor)[:, None]
        if self.criterion is PlanCriterion.worst:
            return np.asarray(np.sqrt(square[..., self.weight > 0, :].max(axis=(-2, -1))))
        return np.asarray(np.sqrt(square.mean(axis=-1) @ self.weight))

    def of(self, covariance: Array) -> float:
        """Compute the criterion of the nodes' covariances, shape (node, 3, 3)."""
        return float(self.value(variances(covariance, self.wanted)))

    def with_one_more(self, covariance: Array, directions: Array) -> Array:
        """Compute the criterion with each of some stands added, shape (stand,).

        Parameters
        ----------
        covariance : ndarray, shape (node, 3, 3)
            From the stands that there are.
        directions : ndarray, shape (stand, node, 3)
            To each of the others; zero where it does not see a node.
        """
        spread = np.einsum("nij,snj->sni", covariance, directions)
        along = np.einsum("nui,sni->snu", self.wanted, spread)
        surprise = 1.0 + np.einsum("sni,sni->sn", directions, spread)
        before = variances(covariance, self.wanted)
        return self.value(before - np.square(along) / surprise[..., None])


def covariance_of(directions: Array) -> Array:
    """Compute the nodes' covariances ``(I / PRIOR + sum_k d_k d_k')^-1``, shape (node, 3, 3).

    Parameters
    ----------
    directions : ndarray, shape (stand, node, 3)
        Zero where a stand does not see a node.

    Examples
    --------
    Four stands on a cone of tan^2 t = 2 see all components alike, ``sqrt(3/4)``:

    >>> turn, t = np.radians([0, 90, 180, 270]), np.arctan(np.sqrt(2))
    >>> d = [np.sin(t) * np.cos(turn), np.sin(t) * np.sin(turn), np.full(4, np.cos(t))]
    >>> np.sqrt(np.diagonal(covariance_of(np.stack(d, axis=-1)[:, None])[0])).round(3)
    array([0.866, 0.866, 0.866])
    """
    information = np.einsum("sni,snj->nij", directions, directions)
    return np.linalg.inv(information + np.eye(3) / PRIOR)


def variances(covariance: Array, wanted: Array) -> Array:
    """Compute ``u' C u``, shape (node, direction)."""
    return np.einsum("nui,nij,nuj->nu", wanted, covariance, wanted)


def directions_wanted(of: str | list[float], frame: Array) -> Array:
    """List the unit vectors whose bounds are asked for, shape (node, direction, 3).

    Parameters
    ----------
    of : str or list of 3 float
        See `sldvexp.config.planning.PlanSettings`.
    frame : ndarray, shape (node, 3, 3)
        Unit rows t1, t2, n of every node.

    Examples
    --------
    >>> directions_wanted("in_plane", np.eye(3)[None]).tolist()
    [[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]]
    """
    nodes = len(frame)
    if not isinstance(of, str):
        one = np.array(of, float) / np.linalg.norm(of)
        return np.broadcast_to(one, (nodes, 1, 3))
    axes = {"x": [0], "y": [1], "z": [2], "all": [0, 1, 2]}
    if of in axes:
        return np.broadcast_to(np.eye(3)[axes[of]], (nodes, len(axes[of]), 3))
    own = {"t1": [0], "t2": [1], "n": [2], "in_plane": [0, 1]}
    return frame[:, own[of]]
