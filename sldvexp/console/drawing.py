"""Drawing of the calibration object by which people tell its circles or marks apart.

It is seen from far away, along the mean of the normals of the planes that have circles, so that
every such plane is seen; of one plane that is its front. Where places would lie over one another
it is seen from a little above, below or beside that, whichever parts the nearest two most.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from sldvexp.config.experiment import Experiment
from sldvexp.console.marks import CIRCLE, Name
from sldvexp.geometry import rotation_from_vector
from sldvexp.pose import AimingPlace
from sldvexp.targets import Circles
from sldvexp.typing import Array

#: Angle from the front at which an object is seen whose places would lie over one another, rad.
ASIDE = math.radians(30)
#: Distance of the nearest two places, as a part of the drawing's extent, that is enough.
APART = 0.12
#: Points of a rim that are drawn.
ROUND = 12


def drawn_layout(
    experiment: Experiment, places: Mapping[Name, AimingPlace], rims: Sequence[Array]
) -> tuple[list[dict[str, object]], str]:
    """Draw places flat, x to the right and y up, and say from where they are seen.

    Parameters
    ----------
    places : mapping of (kind, number) to AimingPlace
    rims : sequence of ndarray, shape (point, 3), m
        Of the circles, in the order of their numbers.

    Returns
    -------
    list of dict
        Of each place its ``kind`` and ``number``, where it is drawn, ``at``, and its ``rim``.
    str
        From where.
    """
    if not places:
        return [], ""
    position = np.array([place.position for place in places.values()])
    normals = _normals(experiment)
    axes, told = _view(position, normals)
    circles = [name for name in places if name[0] == CIRCLE]
    edges = dict(zip(circles, rims, strict=False))
    drawn: list[dict[str, object]] = []
    for (kind, number), at in zip(places, position @ axes.T, strict=True):
        edge = edges.get((kind, number))
        rim = np.zeros((0, 2)) if edge is None else edge[:: max(1, len(edge) // ROUND)] @ axes.T
        one = {"kind": kind, "number": number, "at": np.round(at, 4).tolist()}
        drawn.append({**one, "rim": np.round(rim, 4).tolist()})
    return drawn, told


def _normals(experiment: Experiment) -> Array:
    """List the normals of planes that have circles; that towards people where there are none."""
    target = experiment.target
    if not isinstance(target, Circles):
        return np.array([[0.0, 0.0, 1.0]])
    used = dict.fromkeys(circle.plane for circle in target.circles.values())
    return np.array([target.planes[name].axes()[2] for name in used])


def _view(position: Array, normals: Array) -> tuple[Array, str]:
    """Choose from where places are seen: axes to the right and up, shape (2, 3)."""
    mean = normals.mean(axis=0)
    towards = mean if np.linalg.norm(mean) > 0.1 else normals[0]
    front = _axes(towards / np.linalg.norm(towards))
    flat = bool(np.allclose(normals, normals[0]))
    told = "from its front" if flat else "obliquely"
    if _gap(position, front) >= APART:
        return front, told
    right, up = front
    turns = [ASIDE * side * axis for axis in (right, up) for side in (-1, 1)]
    aside = [_axes(rotation_from_vector(turn) @ np.cross(right, up)) for turn in turns]
    best = max([front, *aside], key=lambda axes: _gap(position, axes))
    return best, told if best is front else "obliquely"


def _axes(towards: Array) -> Array:
    """Lay axes to the right and up across a direction to who looks; y is up unless along it."""
    upright = np.array([0.0, 1.0, 0.0]) if abs(towards[1]) < 0.95 else np.array([0.0, 0.0, -1.0])
    right = np.cross(upright, towards)
    right /= np.linalg.norm(right)
    return np.array([right, np.cross(towards, right)])


def _gap(position: Array, axes: Array) -> float:
    """Give the distance of the nearest two places as they are seen, over the extent of all."""
    flat = position @ axes.T
    if len(flat) < 2:
        return math.inf
    apart = np.linalg.norm(flat[:, None] - flat[None], axis=-1)
    extent = float(np.ptp(flat, axis=0).max()) or 1.0
    return float(apart[~np.eye(len(flat), dtype=bool)].min()) / extent
