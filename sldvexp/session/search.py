"""Circles of a calibration object, searched around where a rough pose predicts them.

A rough pose is wrong by degrees and centimetres, many times a circle's size in steps. A grid of
single pixels, half as far apart as the circle as seen is wide, grows ring by ring around the
predicted centre until it holds a moving spot of the circle's size with resting pixels all around;
the middle of that spot is the rough centre. Each circle that is found corrects the pose, so that
the next one is near where it is predicted. Assumption: around a speaker is something that rests.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.geometry import KnownPose, euler_from_rotation
from sldvexp.laser import corrected_pose, dac_of_points
from sldvexp.laser.aiming import FOUND
from sldvexp.lazy import scipy
from sldvexp.scan.calibration import CalibrationScan
from sldvexp.scan.lines import half_chords
from sldvexp.session.camera import ViewContext
from sldvexp.session.watching import SEARCH
from sldvexp.signal import ComplexImage, instrument_fault
from sldvexp.signal.instrument_faults import moving
from sldvexp.targets import Circles, shaded_circles
from sldvexp.targets.shadows import shade_told
from sldvexp.typing import Array, BoolArray, IntArray

#: Of coarse lines across a circle in the journal, behind the number of the circle.
COARSE = "coarse"
#: Distance of pixels over the half width of the circle as seen.
PITCH = 0.5
#: Pixels that a moving spot has, over those of the circle as seen.
FEWEST, MOST = 0.4, 2.0
#: Standard deviation of the middle of a spot of such pixels, over the half width.
SPOT = 0.1
#: Distance of a circle from where the corrected pose has it, over its half width, that is too much.
BESIDE = 0.5
#: Remedy where a circle is hidden by another one.
STAND_ELSEWHERE = (
    "stand more in front of the calibration object, or take that block or circle away; sldvexp aim "
    "tells of any rough pose which circles are hidden from it"
)
#: Share of the margin that is searched once a circle is found and has corrected the pose.
AFTER = 0.5


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
    outline : ndarray, shape (corner, 2), steps
        Points on its edge.
    origin : ndarray, shape (3,), m
        Of the instrument by that pose.
    """

    number: int
    centre: Array
    half_width: Array
    pixels: float
    reach: Array
    outline: Array
    origin: Array

    @property
    def pitch(self) -> Array:
        """Distance of the grid's pixels, shape (2,), steps."""
        return np.maximum(PITCH * self.half_width, 1.0)

    @property
    def rings(self) -> int:
        """How many rings of pixels reach as far as the circle may be."""
        return int(np.ceil((self.reach / self.pitch).max())) + 2


@dataclass(frozen=True, eq=False)
class RoughCircle:
    """Rough centre of a circle, and what else is known of it before its lines are scanned.

    Parameters
    ----------
    centre : ndarray of int, shape (2,), steps
    number : int, optional
        Of the circle, where a rough pose or the scan tells which of them it is.
    half_chord : ndarray, shape (line,), steps, optional
        How far its edge is from its middle along each coarse line.
    shade : str
        Which other circles hide it.
    marked : bool
        Whether somebody gave the centre, and it is none that was found.
    """

    centre: IntArray
    number: int | None = None
    half_chord: Array | None = None
    shade: str = ""
    marked: bool = False

    @property
    def name(self) -> str:
        """Name for what is said of its edge: "circle 2", or as `whereabouts`."""
        return self.whereabouts if self.number is None else f"circle {self.number}"

    @property
    def whereabouts(self) -> str:
        """Name for faults, as in "circle 2, around DAC steps (10, 20)"."""
        what = "the circle" if self.number is None else f"circle {self.number},"
        return f"{what} around DAC steps ({self.centre[0]}, {self.centre[1]})"


def search_circles(scan: CalibrationScan, at: ViewContext) -> list[RoughCircle]:
    """Find the circles of a view whose rough pose is known.

    Returns
    -------
    list of RoughCircle
        In the order of the target's circles.

    Raises
    ------
    UserError
        If a circle is not found as near to where it is predicted as ``scan.margin`` says.
    """
    search = CircleSearch(scan, at)
    if len(known := search.recorded()):
        return search.described(known)
    found = search.complete(np.zeros((0, 2)))
    if found is None:
        raise UserError(search.complaint())
    return search.described(found)


class CircleSearch:
    """Search of one view's circles, one after the other; a wrong spot is given up later.

    Parameters
    ----------
    scan : CalibrationScan
    at : ViewContext
        Of a view with a rough pose, before a target of circles.
    """

    def __init__(self, scan: CalibrationScan, at: ViewContext) -> None:
        assert isinstance(at.target, Circles)
        self.scan, self.at, self.target = scan, at, at.target
        self.rough = scan.views[at.view].pose
        self.numbers = list(at.target.circles)
        self.outlines = at.target.outlines()
        self._lines = 0  # a spot that is searched twice is scanned twice, under two names
        self._lost: tuple[int, PredictedCircle] | None = None  # and how many were found before it
        self._seen: ComplexImage | None = None

    def complete(self, found: Array) -> Array | None:
        """Add the circles that are not found yet to those found; None if one cannot be found."""
        k = len(found)
        if k == len(self.numbers):
            return found
        rotation, origin = self._pose(found)
        circle = self.predicted(k, rotation, origin)
        for centre in self._spots(circle):
            more = np.concatenate([found, centre[None]])
            if self._fits(more) and (whole := self.complete(more)) is not None:
                return whole
        if self._lost is None or k > self._lost[0]:
            self._lost = k, circle
        return None

    def recorded(self) -> Array:
        """Find where a recording has the circles' coarse lines, shape (circle, 2), steps.

        They go through the rough centres, which another estimator of signals may find elsewhere;
        none if something is measured, or a line is lost.
        """
        lines = [self.at.camera.recorded(f"{k}_{COARSE}") for k in range(1, len(self.numbers) + 1)]
        if not all(lines):
            return np.zeros((0, 2))
        return np.array([own[0][len(own[0]) // 2] for own in lines], float)

    def described(self, found: Array) -> list[RoughCircle]:
        """Say of circles that are found how wide they are seen, and which others hide them."""
        rotation, origin = self._pose(found)
        shaded = shaded_circles(origin, self.target)
        circles = []
        for k, centre in enumerate(np.rint(found).astype(np.int64)):
            circle = self.predicted(k, rotation, origin)
            others = shaded.get(circle.number, [])
            shade = shade_told(circle.number, others) if others else ""
            chords = half_chords(circle.outline, self.scan.coarse.lines)
            circles.append(RoughCircle(centre, circle.number, chords, shade))
        return circles

    def complaint(self) -> str:
        """Say that a circle is not where it is predicted, and what to do."""
        assert self._lost is not None
        known, circle = self._lost
        up_down, left_right = np.rint(circle.centre).astype(int)
        others = f", though {known} of {len(self.numbers)} were found" if known else ""
        fault = instrument_fault(self._seen) if self._seen and not known else ""
        away = 1000 * (AFTER if known else 1) * self.scan.margin
        nowhere = (
            f"circle {circle.number} is not found within {away:g} mm of DAC steps "
            f"({up_down}, {left_right}), where the rough pose predicts it{others}"
        )
        if (hides := shaded_circles(circle.origin, self.target)).get(circle.number):
            return (
                f"{nowhere}: {shade_told(circle.number, hides[circle.number])}; {STAND_ELSEWHERE}"
            )
        return (
            f"{nowhere}"
            f"{fault and '; around it, '}{fault}; if its speaker was dead or hidden, delete "
            f"{self.at.camera.journal.folder}/{SEARCH}_* and resume the run, else start anew with "
            "a better rough pose of the view, or a larger margin of the scan of circles"
        )

    def _pose(self, found: Array) -> tuple[Array, Array]:
        """Correct the rough pose by what is found."""
        assert self.rough is not None
        pose = self.rough.rotation, self.rough.place
        if not len(found):
            return pose
        centres = self.outlines[: len(found)].mean(axis=1)
        wide = np.array([self.predicted(k, *pose).half_width for k in range(len(found))])
        std = np.maximum(FOUND, SPOT * wide)
        names = [f"circle {number}" for number in self.numbers[: len(found)]]
        return corrected_pose(centres, found, *pose, self.at.laser, names, std)

    def predicted(self, k: int, rotation: Array, origin: Array) -> PredictedCircle:
        """Predict the image of a circle from points around its edge."""
        outline, laser = self.outlines[k], self.at.laser
        name = f"the edge of circle {self.numbers[k]}"
        steps = dac_of_points(outline, rotation, origin, laser, len(outline) * [name])
        centre = steps.mean(axis=0)
        half = (steps.max(axis=0) - steps.min(axis=0)) / 2
        x, y = (steps - centre).T
        area = 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))
        distance = float(np.linalg.norm(outline.mean(axis=0) - origin))
        margin = (AFTER if k else 1.0) * self.scan.margin
        pixels = area / float(np.prod(PITCH * half))
        reach = margin / (distance * laser.step)
        return PredictedCircle(self.numbers[k], centre, half, pixels, reach, steps, origin)

    def _fits(self, found: Array) -> bool:
        """Tell whether one pose explains all circles that are found."""
        try:
            rotation, origin = self._pose(found)
            circles = [self.predicted(k, rotation, origin) for k in range(len(self.numbers))]
        except UserError:  # such a pose has a circle behind it, or beyond its mirrors
            return False
        for circle, centre in zip(circles, found, strict=False):
            if (np.abs(circle.centre - centre) > BESIDE * circle.half_width).any():
                return False
        return True

    def _spots(self, circle: PredictedCircle) -> Iterator[Array]:
        """Scan rings of pixels around a predicted centre; the middles of spots of its size."""
        moves = np.zeros((2 * circle.rings + 1,) * 2, bool)
        known: set[tuple[float, ...]] = set()
        low, high = self.at.laser.board.value
        for ring in range(1, circle.rings + 1):
            cells = _ring(ring)
            steps = np.rint(circle.centre + cells * circle.pitch).astype(np.int64)
            inside = ((steps >= low) & (steps <= high)).all(axis=1)
            if not inside.any():
                return
            self._lines += 1
            image = self.at.camera.image(f"{SEARCH}_{self._lines:03d}", [steps[inside]])
            self._seen = image
            where = cells[inside] + circle.rings
            moves[where[:, 0], where[:, 1]] = moving(image) & (image.flags == 0)
            for middle in spots_of(moves, ring, circle):
                if tuple(middle) not in known:
                    known.add(tuple(middle))
                    yield circle.centre + middle * circle.pitch


def corrected_by_circles(centres: Array, rough: KnownPose, at: ViewContext) -> KnownPose:
    """Correct a view's rough pose by the centres of its circles, in the order of the target's.

    Parameters
    ----------
    centres : ndarray, shape (circle, 2), steps
    """
    assert isinstance(at.target, Circles)
    points = at.target.outlines().mean(axis=1)
    names = [f"circle {number}" for number in at.target.circles]
    pose = rough.rotation, rough.place
    rotation, origin = corrected_pose(points, centres, *pose, at.laser, names)
    return KnownPose(euler_from_rotation(rotation).tolist(), origin.tolist())


def _ring(number: int) -> IntArray:
    """List cells of a square ring around the origin; the first also has those inside."""
    span = np.arange(-number, number + 1)
    cells = np.stack(np.meshgrid(span, span, indexing="ij"), axis=-1).reshape(-1, 2)
    return cells if number == 1 else cells[np.abs(cells).max(axis=1) == number]


def spots_of(moves: BoolArray, ring: int, circle: PredictedCircle) -> list[Array]:
    """List middles of moving spots as large as the circle, from the middle of the grid, in cells.

    Parameters
    ----------
    moves : ndarray of bool, shape (n, n)
        Cells that move, the predicted centre in the middle.
    ring : int
        The outermost that was scanned; what reaches it may go on beyond.
    """
    labels, count = scipy.ndimage.label(moves, np.ones((3, 3), bool))
    spots = []
    for label in range(1, count + 1):
        cells = np.argwhere(labels == label) - circle.rings
        whole = np.abs(cells).max() < ring
        if whole and FEWEST * circle.pixels <= len(cells) <= MOST * circle.pixels:
            spots.append(cells.mean(axis=0))
    return sorted(spots, key=lambda spot: float(np.linalg.norm(spot)))
