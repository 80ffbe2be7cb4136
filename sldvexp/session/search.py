"""Circles of a calibration object, searched around where a rough pose predicts them.

A rough pose is wrong by degrees and centimetres, many times a circle's size in steps. A grid of
single pixels, half as far apart as the circle as seen is wide, grows ring by ring around the
predicted centre until it holds a moving spot of the circle's size with resting pixels all around;
the middle of that spot is the rough centre. Each circle that is found corrects the pose, so that
the next one is near where it is predicted. Assumption: around a speaker is something that rests.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.geometry import KnownPose, euler_from_rotation
from sldvexp.laser import corrected_pose, dac_of_points
from sldvexp.lazy import scipy
from sldvexp.scan.calibration import CalibrationScan
from sldvexp.session.camera import ViewContext
from sldvexp.signal.instrument_faults import moving
from sldvexp.targets import Circles
from sldvexp.typing import Array, BoolArray, IntArray

#: Distance of pixels over the half width of the circle as seen.
PITCH = 0.5
#: Pixels that a moving spot has, over those of the circle as seen.
FEWEST, MOST = 0.4, 2.0
#: Distance of a circle from where the corrected pose has it, over its width, that is too much.
BESIDE = 0.7


@dataclass(frozen=True, eq=False)
class PredictedCircle:
    """A circle where a pose predicts it.

    Parameters
    ----------
    number : int
    centre : ndarray, shape (2,), steps
    half_width : ndarray, shape (2,), steps
        Along each mirror.
    pixels : float
        Of the grid that fall on it.
    reach : ndarray, shape (2,), steps
        How far from the centre it may be.
    """

    number: int
    centre: Array
    half_width: Array
    pixels: float
    reach: Array

    @property
    def pitch(self) -> Array:
        """Distance of the grid's pixels, shape (2,), steps."""
        return np.maximum(PITCH * self.half_width, 1.0)

    @property
    def rings(self) -> int:
        """How many rings of pixels reach as far as the circle may be."""
        return int(np.ceil((self.reach / self.pitch).max())) + 2


def search_circles(scan: CalibrationScan, at: ViewContext) -> IntArray:
    """Find the circles of a view whose rough pose is known, and correct that pose by them.

    Returns
    -------
    ndarray of int, shape (circle, 2), steps
        Rough centres in the order of the target's circles.

    Raises
    ------
    UserError
        If a circle is not found as near to where it is predicted as ``scan.margin`` says.
    """
    pose = scan.views[at.view].pose
    assert pose is not None
    assert isinstance(at.target, Circles)
    outlines = at.target.outlines()
    rotation, origin = pose.rotation, pose.place
    found = np.zeros((0, 2))
    for k, number in enumerate(at.target.circles):
        circle = _predict(number, outlines[k], rotation, origin, scan.margin, at)
        centre = _search(circle, k + 1, at)
        if centre is None:
            raise UserError(_not_found(circle, k, scan, at))
        found = np.concatenate([found, centre[None]])
        rotation, origin = corrected_pose(
            outlines[: k + 1].mean(axis=1), found, pose.rotation, pose.place, at.laser
        )
    return np.rint(found).astype(np.int64)


def corrected_by_circles(centres: Array, rough: KnownPose, at: ViewContext) -> KnownPose:
    """Correct a view's rough pose by the centres of its circles, in the order of the target's.

    Parameters
    ----------
    centres : ndarray, shape (circle, 2), steps
    """
    assert isinstance(at.target, Circles)
    points = at.target.outlines().mean(axis=1)
    rotation, origin = corrected_pose(points, centres, rough.rotation, rough.place, at.laser)
    return KnownPose(euler_from_rotation(rotation).tolist(), origin.tolist())


def _predict(
    number: int, outline: Array, rotation: Array, origin: Array, margin: float, at: ViewContext
) -> PredictedCircle:
    """Predict the image of a circle from points around its edge."""
    name = f"the edge of circle {number}"
    steps = dac_of_points(outline, rotation, origin, at.laser, len(outline) * [name])
    half = (steps.max(axis=0) - steps.min(axis=0)) / 2
    x, y = (steps - steps.mean(axis=0)).T
    area = 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))
    distance = float(np.linalg.norm(outline.mean(axis=0) - origin))
    reach = margin / (distance * at.laser.step)
    return PredictedCircle(
        number, steps.mean(axis=0), half, area / float(np.prod(PITCH * half)), reach
    )


def _search(circle: PredictedCircle, key: int, at: ViewContext) -> Array | None:
    """Scan rings of pixels around a predicted centre; the middle of the spot that they show."""
    size = 2 * circle.rings + 1
    moves = np.zeros((size, size), bool)
    for ring in range(1, circle.rings + 1):
        cells = _ring(ring)
        steps = np.rint(circle.centre + cells * circle.pitch).astype(np.int64)
        low, high = at.laser.board.value
        inside = ((steps >= low) & (steps <= high)).all(axis=1)
        if not inside.any():
            return None
        image = at.camera.image(f"{key}_search_{ring:02d}", [steps[inside]])
        where = cells[inside] + circle.rings
        moves[where[:, 0], where[:, 1]] = moving(image) & (image.flags == 0)
        if (middle := _spot(moves, ring, circle)) is not None:
            return circle.centre + middle * circle.pitch
    return None


def _ring(number: int) -> IntArray:
    """List cells of a square ring around the origin; the first also has those inside."""
    span = np.arange(-number, number + 1)
    cells = np.stack(np.meshgrid(span, span, indexing="ij"), axis=-1).reshape(-1, 2)
    return cells if number == 1 else cells[np.abs(cells).max(axis=1) == number]


def _spot(moves: BoolArray, ring: int, circle: PredictedCircle) -> Array | None:
    """Find the middle of the moving spot nearest to the origin that is as large as the circle."""
    labels, count = scipy.ndimage.label(moves, np.ones((3, 3), bool))
    spots = []
    for label in range(1, count + 1):
        cells = np.argwhere(labels == label) - circle.rings
        whole = np.abs(cells).max() < ring
        if whole and FEWEST * circle.pixels <= len(cells) <= MOST * circle.pixels:
            spots.append(cells.mean(axis=0))
    return min(spots, key=lambda spot: float(np.linalg.norm(spot)), default=None)


def _not_found(circle: PredictedCircle, known: int, scan: CalibrationScan, at: ViewContext) -> str:
    """Say that a circle is not where it is predicted, and what to do."""
    up_down, left_right = np.rint(circle.centre).astype(int)
    others = f", though {known} of its circles were found" if known else ""
    return (
        f"circle {circle.number} is not found within {1000 * scan.margin:g} mm of DAC steps "
        f"({up_down}, {left_right}), where the rough pose predicts it{others}; see that its "
        "speaker sounds, correct the pose of the view, or search farther with the scan's margin"
    )
