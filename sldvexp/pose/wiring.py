"""Recognition of mirrors that are exchanged or turn the other way, before a pose is fitted to them.

A scanner can be wired in eight ways: its two mirrors exchanged or not, each turning one way or the
other. The same edges are looked at through each of them. Three things tell the right one:

- An exchange, like one inverted mirror, turns the image into a mirror image, which fits the object
  only as seen from behind.
- The two mirrors are not alike: the angle of one is measured in a plane that the other turns (Eqs
  4.2 and 4.3), so that exchanged ones leave residuals of up to some steps.
- Two inverted mirrors are an instrument upside down, to the last digit. Only somebody who knows
  which way is up can tell them; nor do they tell one inverted mirror from the other, and either
  from an object that is the mirror image of the target.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.geometry import BitangentPoints
from sldvexp.image import ScanLineEdges
from sldvexp.laser import MIRRORS, TwoMirror
from sldvexp.pose.circle_images import (
    CircleImages,
    match_images,
    registration_table,
    with_shared_errors,
)
from sldvexp.pose.pointing import UNLIKELY
from sldvexp.pose.single_view import solve_points
from sldvexp.targets import Circles

#: Cosine of the angle between the instrument's up axis and the object's within which it stands.
STANDS = 0.5
#: Difference of two views' phases, rad, that is no noise, and how much smaller it must become.
PHASE, OPPOSITE = 0.1, 3.0
#: Residuals, over the smallest of all wirings, that miscalibrated mirrors may leave.
MISCALIBRATED = 4.0


@dataclass(frozen=True)
class Wiring:
    """Way in which the channels of the D/A board reach the mirrors.

    Parameters
    ----------
    turns : tuple of int
        +1 or -1 for (up_down, left_right), by the mirrors that really turn.
    """

    exchanged: bool = False
    turns: tuple[int, int] = (1, 1)

    @property
    def inverted(self) -> list[str]:
        """Mirrors that turn the other way."""
        return [name for name, turn in zip(MIRRORS, self.turns, strict=True) if turn < 0]

    def __str__(self) -> str:
        parts = ["up_down and left_right exchanged"] if self.exchanged else []
        if self.inverted:
            parts.append(f"{self.inverted[0] if len(self.inverted) == 1 else 'both'} inverted")
        return " and ".join(parts) or "as recorded"


STRAIGHT = Wiring()
#: All eight, the plainest first.
WIRINGS = [Wiring(e, turns) for e in (False, True) for turns in itertools.product((1, -1), (1, -1))]


@dataclass(frozen=True)
class Hypothesis:
    """A wiring, and how well the edges fit the object through it.

    Parameters
    ----------
    residual : float, steps
        Root mean square, at the bitangent points.
    explained : bool
        Whether edges and circles explain residuals this large.
    faces : bool
        Whether the instrument stands in front of all circles.
    up : float
        Cosine of the angle between the instrument's up axis and the object's y axis.
    """

    wiring: Wiring
    residual: float
    explained: bool
    faces: bool
    up: float

    def right(self, upright: bool) -> bool:
        """Tell whether nothing speaks against it."""
        return self.faces and self.explained and (not upright or self.stance == "upright")

    @property
    def stance(self) -> str:
        """Stance of the instrument."""
        if self.up < -STANDS:
            return "upside down"
        return "upright" if self.up > STANDS else "on its side"


def check_wiring(
    view: str,
    edges: Sequence[ScanLineEdges],
    target: Circles,
    laser: TwoMirror,
    adjust: Mapping[str, float],
    upright: bool,
) -> CircleImages:
    """Match the circles' images, unless another wiring of the mirrors explains them better.

    Parameters
    ----------
    edges : sequence of ScanLineEdges
        Of the circles in any order, DAC steps.
    adjust : mapping of str to float
        Intrinsics that are adjusted with the pose, with what is known of them beforehand.
    upright : bool
        Whether the instrument stands upright before an upright object.

    Returns
    -------
    CircleImages
        With conics fitted in pinhole coordinates.

    Raises
    ------
    UserError
        If the mirrors look wired wrongly: which, by which evidence, and what would look the same.
        If the edges make no images of the object at all, as `match_images`.
    """

    def hypothesis(images: CircleImages, wiring: Wiring) -> Hypothesis | None:
        return _hypothesis(images, wiring, target, laser, adjust)

    images, problem = _images(view, edges, target, laser)
    straight = None if images is None else hypothesis(images, STRAIGHT)
    if images is not None and straight is not None and straight.right(upright):
        return images
    exchanged, _ = _images(view, [_exchanged(e) for e in edges], target, laser)
    seen = {False: images, True: exchanged}
    tried = (hypothesis(i, w) for w in WIRINGS if (i := seen[w.exchanged]) is not None)
    found = [h for h in tried if h is not None and h.faces]
    likely = [h for h in found if h.explained]
    if straight is not None and straight.faces and (not upright or straight.stance == "upright"):
        # Noise that is not what it is taken for leaves nothing to explain the right one better.
        likely = [h for h in likely if h.residual < straight.residual]
    if not likely and straight is not None:
        # With miscalibrated mirrors only what fits far worse than another is surely wrong.
        least = min((h.residual for h in found), default=0.0)
        likely = [h for h in found if h.residual <= MISCALIBRATED * least]
    standing = [h for h in likely if h.stance == "upright"] if upright else []
    best = standing or likely
    if best and all(h.wiring != STRAIGHT for h in best):
        raise UserError(f"view {view}: {_sentence(best, likely, straight, laser)}")
    if images is None:
        raise problem or AssertionError
    return images


def _images(
    view: str, edges: Sequence[ScanLineEdges], target: Circles, laser: TwoMirror
) -> tuple[CircleImages | None, UserError | None]:
    """Match the images of the circles, or give the reason why there are none."""
    try:
        return match_images(view, list(edges), target, laser), None
    except UserError as error:
        return None, error


def _exchanged(edges: ScanLineEdges) -> ScanLineEdges:
    """Turn the edges into what they are if each channel drives the other mirror."""
    return replace(edges, position=edges.position[:, ::-1], direction=edges.direction[:, ::-1])


def _hypothesis(
    images: CircleImages,
    wiring: Wiring,
    target: Circles,
    laser: TwoMirror,
    adjust: Mapping[str, float],
) -> Hypothesis | None:
    """Solve bitangent points, turned as the mirrors turn; None if they have no pose."""
    turns = np.array(wiring.turns)
    table = registration_table(images, target)
    assert table.dac is not None
    try:
        solution = solve_points(
            table.object_point,
            laser.angle_from_dac(table.dac * turns),
            step=laser.step,
            mirror_offset=laser.mirror_offset,
            adjust=adjust,
        )
    except UserError:
        return None
    points, covariance = images.bitangents
    turned = BitangentPoints(points * turns, covariance * turns[:, None, None, None, None] * turns)
    seen = replace(images, bitangents=turned)
    _, probability = with_shared_errors(solution, seen, target, laser)
    return Hypothesis(
        wiring,
        residual=float(np.sqrt(np.mean(solution.residual**2))),
        explained=probability >= UNLIKELY,
        faces=_faces(target, solution.origin),
        up=float(solution.rotation[1, 1]),
    )


def _faces(target: Circles, origin: np.ndarray) -> bool:
    """Tell whether a point is in front of all planes that have circles."""
    planes = [target.planes[name] for name in {c.plane for c in target.circles.values()}]
    height = [
        (origin - target.unit.value * np.array(plane.origin)) @ plane.axes()[2] for plane in planes
    ]
    return bool(np.min(height) > 0)


def _sentence(
    best: Sequence[Hypothesis],
    likely: Sequence[Hypothesis],
    straight: Hypothesis | None,
    laser: TwoMirror,
) -> str:
    """Say what looks wrong, by which evidence, what puts it right and what would look the same."""
    first, *rest = sorted(best, key=lambda h: -h.up)
    told = (
        f"the mirrors look wired wrongly, {first.wiring}: so the calibration object fits to "
        f"{first.residual:.2g} steps rms with the instrument {first.stance}, while as recorded "
        f"{_as_recorded(straight)}; {_remedy(first.wiring, laser)}"
    )
    others = [*rest, *(h for h in likely if h not in best and h.wiring != STRAIGHT)]
    same = [f"{h.wiring} with the instrument {h.stance}" for h in others]
    if any(not h.wiring.exchanged and len(h.wiring.inverted) == 1 for h in likely):
        same.append("an object that is the mirror image of the target")
    return told + (f" (what would look the same: {'; '.join(same)})" if same else "")


def _as_recorded(straight: Hypothesis | None) -> str:
    """Say what is wrong without another wiring."""
    if straight is None:
        return "the image is not that of the calibration object"
    mirrored = "" if straight.faces else "as a mirror image seen from behind, "
    return f"it fits to {straight.residual:.2g}, {mirrored}with the instrument {straight.stance}"


def _remedy(wiring: Wiring, laser: TwoMirror) -> str:
    """Say what puts a wrong wiring right."""
    if wiring.exchanged:
        return "check the cables from the D/A board to the mirrors"
    gains = [f"laser.{name}.gain={-getattr(laser, name).gain:g}" for name in wiring.inverted]
    really = ", or pose.upright=false if instrument or object really stand upside down"
    return f"set {' and '.join(gains)}{really if len(gains) == 2 else ''}"


def phase_notes(images: Sequence[CircleImages]) -> list[str]:
    """Find views whose speakers move with the phases of the first view's, but of opposite sign.

    Every speaker has one phase, wherever it is seen from. The pose does not depend on it.
    """
    if not images or not images[0].edges:
        return []
    first, *others = images
    phasor = _speakers(first)
    notes = []
    for image in others:
        as_is, conjugated = (
            float(np.sqrt(np.mean(np.angle(_speakers(image) * p) ** 2)))
            for p in (phasor.conj(), phasor)
        )
        if as_is > PHASE and conjugated * OPPOSITE < as_is:
            notes.append(
                f"views {first.view} and {image.view}: the speakers' phases differ by {as_is:.2g} "
                f"rad, but by {conjugated:.2g} if one view's are conjugated: in one of the two the "
                "samples run backwards in time, or came as A + iB; phases alone do not say in "
                "which, and the pose does not depend on it, but velocities do"
            )
    return notes


def _speakers(images: CircleImages) -> np.ndarray:
    """Average the direction ``exp(i phase)`` of every circle's motion, by the circles' numbers."""
    return np.array([np.exp(1j * images.edges[n].phase).mean() for n in sorted(images.edges)])
