"""Turn of an instrument that stands upright: where it looks so that all is within its mirrors.

The laser frame's z points at a place, its x is level, as `sldvexp.geometry.rotation_towards` makes
it. The mirrors' ranges are used best if the angles of all that is to be seen lie evenly around
their middle: the place looked at moves along the beam of the middle of their box until it is there.
"""

from __future__ import annotations

import numpy as np

from sldvexp.geometry import rotation_towards
from sldvexp.laser import TwoMirror, project, rays
from sldvexp.typing import Array

#: Steps of turning; each makes what is off smaller by a factor of ten or more.
STEPS = 4


def angles_of(origins: Array, rotations: Array, points: Array, laser: TwoMirror) -> Array:
    """Project points as each stand sees them, shape (stand, point, 2), rad.

    Points behind the instrument have angles beyond 90 deg, which no mirror reaches.
    """
    in_laser = np.einsum("sij,spj->spi", rotations, points[None] - origins[:, None])
    return project(in_laser, laser.mirror_offset)


def turned_towards(origins: Array, points: Array, laser: TwoMirror) -> tuple[Array, Array]:
    """Turn each stand so that the points lie evenly in the ranges of its mirrors.

    Parameters
    ----------
    origins : ndarray, shape (stand, 3), m
    points : ndarray, shape (point, 3), m

    Returns
    -------
    look_at : ndarray, shape (stand, 3), m
    rotations : ndarray, shape (stand, 3, 3)
    """
    low, high = laser.reach
    look_at = np.broadcast_to(points.mean(axis=0), origins.shape)
    rotations = rotation_towards(origins, look_at)
    for _ in range(STEPS):
        angles = angles_of(origins, rotations, points, laser)
        middle = (angles.max(axis=1) + angles.min(axis=1)) / 2 - (low + high) / 2
        _, beam = rays(middle)
        far = np.linalg.norm(look_at - origins, axis=1, keepdims=True)
        look_at = origins + far * np.einsum("sji,sj->si", rotations, beam)
        rotations = rotation_towards(origins, look_at)
    return look_at, rotations
