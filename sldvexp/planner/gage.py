"""Gage that stands are planned for: the strain between two nodes of the surface.

It is the difference of the velocities there along the line from one to the other, over its length
L and the circular frequency: ``strain = u . (V_b - V_a) / (2 pi f L)``. Errors of the two nodes are
independent, so that its bound is ``sqrt(2) / (2 pi f L)`` times the r.m.s. of their bounds along u.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.planner.place import Place
from sldvexp.typing import Array, IntArray

#: Part of the surface's extent that an end may be away from any node.
NEAR = 0.1


@dataclass(frozen=True, eq=False)
class PlannedGage:
    """Two nodes with the line between them.

    Attributes
    ----------
    nodes : ndarray of int, shape (2,)
        Of all nodes of the surface.
    along : ndarray, shape (3,)
        Unit vector from the first to the second.
    length : float, m
    """

    nodes: IntArray
    along: Array
    length: float

    @classmethod
    def from_ends(cls, ends: list[list[float]], place: Place) -> PlannedGage | None:
        """Find the nodes nearest to the ends; None without any.

        Raises
        ------
        UserError
            If an end is away from the surface, or both are at one node.
        """
        if not ends:
            return None
        nodes = []
        extent = float(np.ptp(place.nodes, axis=0).max())
        for end in ends:
            distance = np.linalg.norm(place.nodes - end, axis=1)
            nodes.append(int(distance.argmin()))
            if distance.min() > NEAR * extent:
                raise UserError(
                    f"plan.gage: {end} is {distance.min():.3g} m away from the surface; its ends "
                    "are places on it, m, in the world"
                )
        a, b = place.nodes[nodes]
        length = float(np.linalg.norm(b - a))
        if not length:
            raise UserError(
                "plan.gage: both ends are at the same node; take them further apart, or a finer "
                "volume"
            )
        return cls(np.array(nodes), (b - a) / length, length)

    def strain(self, bound: float, frequency: float) -> float:
        """Turn the r.m.s. of the ends' bounds along the gage, m/s, into that of the strain.

        Examples
        --------
        >>> gage = PlannedGage(np.array([0, 1]), np.array([1.0, 0, 0]), 0.1)
        >>> round(1e6 * gage.strain(1e-4, 100.0), 3)
        2.251
        """
        return float(np.sqrt(2) * bound / (2 * np.pi * frequency * self.length))
