"""A camera beside the virtual laser: its picture of the scene, and the spot in it.

A pinhole in the laser's frame, whose axis is the laser's z. A ray of the pixel at (row, column) has
the direction (a, b, 1), where a and b run evenly over ``+-tan(half the field of view)``; a point P
of the laser's frame is seen at ``(P_x / P_z, P_y / P_z)``. Surfaces are brighter the nearer they
are and the more they face the camera, which their distances at neighbouring pixels tell.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sldvexp.typing import Array
from sldvexp.virtual_lab.beam import Beams, SceneObject, Spot

#: Rows and columns of a picture.
SIZE = (150, 200)
#: Half the field of view along rows and along columns, as tangents.
FIELD = (0.24, 0.32)
#: Distance of the wall behind everything, m.
BACKDROP = 3.0
#: Brightness of the wall, of what stands before it, and of what moves in a calibration object.
WALL, SURFACE, SPEAKER = 40.0, 190.0, 90.0
#: Radius of the spot as it blooms in the picture, pixels.
BLOOM = 1.6
#: Any frequency: what moves at one moves at all.
TONE = np.array([100.0])


def photograph(objects: Sequence[SceneObject], rotation: Array, origin: Array) -> NDArray[np.uint8]:
    """Take a picture of some objects, without the spot.

    Parameters
    ----------
    rotation : ndarray, shape (3, 3)
        World to laser.
    origin : ndarray, shape (3,), m
        Of the camera, in the world.

    Returns
    -------
    ndarray of uint8, shape `SIZE`
    """
    # Up in the picture is y of the laser's frame, which is up, and left is x, which is left.
    up, left = (np.linspace(f, -f, n) for f, n in zip(FIELD, SIZE, strict=True))
    y, x = np.meshgrid(up, left, indexing="ij")
    along = np.stack([x, y, np.ones(SIZE)], axis=-1).reshape(-1, 3)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    start = np.broadcast_to(origin, along.shape)
    rays = Beams(start, along @ rotation, Spot(waist=0.0))
    bright, nearest = np.full(len(along), WALL), np.full(len(along), np.inf)
    for thing in objects:
        distance, velocity = thing.seen(rays, TONE)
        moves = np.abs(velocity[:, 0]) > 0 if thing.calibrates else np.zeros(len(along), bool)
        nearer = distance < nearest
        shade = np.where(moves, SPEAKER, SURFACE) / np.maximum(np.minimum(distance, BACKDROP), 1.0)
        bright[nearer] = shade[nearer] + WALL / 2
        nearest[nearer] = distance[nearer]
    return np.clip(bright, 0, 255).astype(np.uint8).reshape(SIZE)


def with_spot(picture: NDArray[np.uint8], spot: Array) -> NDArray[np.uint8]:
    """Draw the spot into a picture.

    Parameters
    ----------
    spot : ndarray, shape (3,), m
        In the laser's frame.
    """
    rows, columns = np.indices(picture.shape)
    row = (1.0 - spot[1] / spot[2] / FIELD[0]) * (picture.shape[0] - 1) / 2
    column = (1.0 - spot[0] / spot[2] / FIELD[1]) * (picture.shape[1] - 1) / 2
    away = np.hypot(rows - row, columns - column)
    return np.where(away <= BLOOM, 255, picture).astype(np.uint8)
