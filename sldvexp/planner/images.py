"""Images that a stand will take: corners of the region and circles in DAC steps, and the pixels.

A scan is told of both in steps of the D/A board. From a place and the point that is looked at they
follow by the two-mirror model, as well as the instrument will stand there: a centimetre beside it
moves them by some twenty steps of a 12-bit board.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sldvexp.config.experiment import Experiment
from sldvexp.field.visibility.view import View
from sldvexp.geometry import rotation_towards
from sldvexp.laser import direction_cosines
from sldvexp.planner.expected import empty_view
from sldvexp.planner.place import BESIDE, Place
from sldvexp.planner.structure import crosses
from sldvexp.planner.turning import angles_of, turned_towards
from sldvexp.scan.lines import box_corners, half_chords, rectangle, strided
from sldvexp.scan.rectangle import Rectangle
from sldvexp.scan.session import Session
from sldvexp.typing import Array, IntArray

#: Distance at which a place that is looked at is named where nothing says it, m.
AHEAD = 1.0
#: Part of an axis across the object's mean plane from which the two meet at a place to speak of.
GRAZING = 0.2
#: Rows and columns of an image where nothing says how many.
USUAL_PIXELS = (41, 41)
#: Part of the pixels that speckle costs, where nothing tells it.
USUAL_DROP_OUT = 0.002


@dataclass(frozen=True, eq=False)
class Stand:
    """One place of the instrument with what it looks at.

    Attributes
    ----------
    name : str
    origin, look_at : ndarray, shape (3,), m
    rotation : ndarray, shape (3, 3)
        World to laser.
    corners : ndarray of int, shape (4, 2), steps
        Of the region that is imaged.
    circles : ndarray of int, shape (circle, 2), steps
        Centres of the calibration object's circles; none of other objects.
    """

    name: str
    origin: Array
    look_at: Array
    rotation: Array
    corners: IntArray
    circles: IntArray

    def named(self, name: str) -> Stand:
        """Give it another name."""
        return replace(self, name=name)


def stand_at(name: str, origin: Array, place: Place) -> Stand:
    """Turn an upright instrument towards the object from a place."""
    _, rotation = turned_towards(origin[None], place.to_be_seen, place.laser)
    look_at = looked_at(origin, rotation[0, 2], place)
    look_at = look_at.round(3)  # as it is written, so that the angles are those of what is written
    return known_stand(name, origin, look_at, rotation_towards(origin, look_at), place)


def looked_at(origin: Array, axis: Array, place: Place) -> Array:
    """Find where an instrument's axis meets the object's mean plane, or passes beside the object.

    The second is of an object around which surfaces go, and of an axis along the plane.
    """
    way, normal = place.middle - origin, place.frame[:, 2].mean(axis=0)
    slope = float(normal @ axis)
    far = float(normal @ way) / slope if abs(slope) > GRAZING else 0.0
    return np.asarray(origin + (far if far > 0 else max(float(axis @ way), AHEAD)) * axis)


def known_stand(name: str, origin: Array, look_at: Array, rotation: Array, place: Place) -> Stand:
    """Take an instrument as it stands."""
    told = len(place.region) > 0
    edge = _dac(origin, rotation, place.region if told else place.outline, place)
    low, high = edge.min(axis=0), edge.max(axis=0)
    widen = (0.0 if told else BESIDE) * (high - low)
    board = place.laser.board.value
    least, most = np.clip(np.floor(low - widen), *board), np.clip(np.ceil(high + widen), *board)
    corners = box_corners(least, most, place.laser.ways, edge if told else None)
    circles = np.rint(_dac(origin, rotation, place.marks.centres, place)).astype(int)
    return Stand(name, origin, look_at, rotation, corners, circles)


def half_chords_of(stand: Stand, place: Place, lines: int) -> Array:
    """Find how far each circle reaches along each scan line, shape (circle, line), steps.

    A circle beyond the mirrors has no lines, and reaches zero.
    """
    if place.marks.circles is None:
        return np.zeros((0, lines))
    found = np.zeros((len(place.marks.circles.circles), lines))
    for chords, outline in zip(found, place.marks.circles.outlines(), strict=True):
        if _reached(stand.origin, stand.rotation, outline, place):
            dac = _dac(stand.origin, stand.rotation, outline, place)
            chords[:] = half_chords(dac, lines)
    return found


def held_by(raster: IntArray, stand: Stand, place: Place) -> int:
    """Count the nodes of the surface that the box of an image's pixels holds, as a stand sees them.

    Parameters
    ----------
    raster : ndarray of int, shape (row, column, 2), steps
    """
    dac, pixels = _dac(stand.origin, stand.rotation, place.nodes, place), raster.reshape(-1, 2)
    inside = (dac >= pixels.min(axis=0)) & (dac <= pixels.max(axis=0))
    return int(inside.all(axis=1).sum())


def _reached(origin: Array, rotation: Array, points: Array, place: Place) -> bool:
    """Tell whether the mirrors send the beam to all of some points."""
    angles = angles_of(origin[None], rotation[None], points, place.laser)[0]
    return bool(np.all(place.laser.reaches(angles)))


def _dac(origin: Array, rotation: Array, points: Array, place: Place) -> Array:
    """Project points to DAC steps, kept within the board, shape (point, 2)."""
    if not len(points):
        return np.zeros((0, 2))
    angles = angles_of(origin[None], rotation[None], points, place.laser)[0]
    return place.laser.dac_from_angle(np.clip(angles, *place.laser.reach))


def raster_of(stand: Stand, experiment: Experiment) -> IntArray:
    """Lay the pixels of a stand's image as the scan would, shape (row, column, 2), steps."""
    scan = experiment.scan
    part = scan.structure if isinstance(scan, Session) else scan
    if experiment.plan.pixels:
        return rectangle(stand.corners, *experiment.plan.pixels)
    if isinstance(part, Rectangle) and part.stride is not None:
        return strided(stand.corners, part.stride)
    pixels = part.pixels if isinstance(part, Rectangle) and part.pixels else USUAL_PIXELS
    return rectangle(stand.corners, *pixels)


def empty_image(
    stand: Stand, experiment: Experiment, raster: IntArray, number: int | None, place: Place
) -> View:
    """Make the image of a stand, still empty, without the pixels that will be lost.

    Those are the ones that speckle costs, and those whose beams a forbidden box stops.

    Parameters
    ----------
    raster : ndarray of int, shape (row, column, 2), steps
    number : int, optional
        Of the image, so that other pixels are lost in each; without it speckle costs none.
    """
    part = experiment.plan.drop_out
    if part is None:
        scene = experiment.scene
        part = USUAL_DROP_OUT if scene is None else scene.vibrometer.drop_out
    lost = np.zeros(raster.shape[:2], bool)
    if number is not None:
        lost = np.random.default_rng([experiment.seed, number]).random(lost.shape) < part
    if place.solid:
        angles = place.laser.angle_from_dac(raster.reshape(-1, 2))
        far = np.linalg.norm(place.middle - stand.origin)
        ends = stand.origin - far * direction_cosines(angles, stand.rotation)
        for box in place.solid:
            beyond = crosses(stand.origin[None], ends, box.low, box.high)
            lost |= beyond.reshape(lost.shape)
    return empty_view(stand.name, stand.rotation, stand.origin, raster, lost)
