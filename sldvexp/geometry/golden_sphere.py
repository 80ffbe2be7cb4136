"""Directions spread evenly over the sphere, along a spiral that turns by the golden angle.

Heights of the directions are the middles of equal parts of the axis, whose zones of the sphere have
equal areas, and each is turned on by ``pi (3 - sqrt 5)``, the angle that is farthest from any
fraction of a turn.
"""

from __future__ import annotations

import numpy as np

from sldvexp.typing import Array


def golden_sphere(count: int) -> tuple[Array, Array]:
    """Make azimuths and polar angles of directions that are spread evenly, shape (count,), rad.

    Examples
    --------
    >>> azimuth, polar = golden_sphere(500)
    >>> sine = np.sin(polar)
    >>> ways = np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(polar)])
    >>> (ways @ ways.T / 500).round(3) + 0.0  # as of all directions: a third of the unit matrix
    array([[0.333, 0.   , 0.   ],
           [0.   , 0.333, 0.   ],
           [0.   , 0.   , 0.333]])
    """
    i = np.arange(count)
    return np.pi * (3 - np.sqrt(5)) * i, np.arccos(1 - (2 * i + 1) / count)
