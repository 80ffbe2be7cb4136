"""Contradictions of a few points with known errors: one wrong, two exchanged, all seen mirrored.

Few points leave no majority that robust fits could follow, but their errors are known: n right
points have a cost that is chi-square of 2n - 6. If theirs is refuted, those explanations are tried
that a person would think of: one point wrong (two degrees of freedom fewer, so that it takes five
to tell which), two points with each other's angles (as many as before). An explanation is believed
if the points then agree, and by no other point or pair.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from sldvexp.errors import UserError
from sldvexp.pose.outliers import MatchedPoints
from sldvexp.pose.rough_pose import REFUTED, RoughPose, rough_poses
from sldvexp.statistics import chi_square_p_value
from sldvexp.typing import Array

#: Probability from which points agree with each other.
AGREE = 0.01
#: Least extent of points across a line or a plane, as a part of their length, that counts.
FLAT = 0.03


@dataclass(frozen=True)
class Contradiction:
    """A few points that no pose explains, or none that one believes.

    Parameters
    ----------
    kind : str
        ``exchanged_points``, ``wrong_point``, ``mirrored``; ``residuals`` if nothing explains it.
    points : list of int
        Positions of those that are, or may be, to blame.
    size : float, DAC steps
        How far these lie beside where the others put them.
    p_value : float
        Of the residuals with all points.
    """

    kind: str
    points: list[int]
    size: float
    p_value: float

    def sentence(self, names: Sequence[str], more: bool = True) -> str:
        """Say it, by the names of all points, without a full stop.

        Parameters
        ----------
        more : bool
            Whether there are points besides these, of which one more could be taken.
        """
        blamed, size = [names[k] for k in self.points], f"{self.size:.0f} steps"
        if self.kind == "exchanged_points":
            return (
                f"{joined(blamed)} seem to be exchanged, since all agree with each other's steps "
                "for the two"
            )
        if self.kind == "mirrored":
            return (
                f"{joined(names)} are seen from behind, against the world's z axis: unless the "
                "instrument stands there, two of them are exchanged or a mirror turns the other way"
            )
        if self.kind == "wrong_point" and len(blamed) == 1:
            return f"{blamed[0]} lies {size} beside where the others put it"
        told = f"{joined(names)} contradict one another by {size}"
        if self.kind == "wrong_point":
            return f"{told}: {joined(blamed, 'or')} is wrong" + ", and one more tells which" * more
        return f"{told}, and no single one explains it"


def contradiction_of(matched: MatchedPoints) -> Contradiction | None:
    """Find what a few points say against each other; None if they agree or are too few to.

    Parameters
    ----------
    matched : MatchedPoints
        With the standard deviations of their angles.
    """
    poses = _poses(matched)
    if not poses:
        return None
    p_value = _probability(poses)
    everything = list(range(len(matched)))
    if not p_value < REFUTED:  # three points leave no residuals, and no probability
        mirrored = is_flat(matched.points) and not _in_front(poses[0], matched)
        return Contradiction("mirrored", everything, 0.0, p_value) if mirrored else None
    wrong = list(_wrong(matched)) if len(matched) > 4 else everything
    if len(wrong) == 1:
        return Contradiction("wrong_point", wrong, _beside(matched, wrong[0]), p_value)
    exchanged = list(_exchanged(matched))
    if len(exchanged) == 1:
        # Each stands where the other should.
        one, other = exchanged[0]
        apart = (matched.angles[one] - matched.angles[other]) / matched.step
        return Contradiction("exchanged_points", [one, other], math.hypot(*apart), p_value)
    spread = math.sqrt(min(pose.cost for pose in poses) / len(matched) / 2)
    size = spread * float(matched.relative_std.mean())
    kind = "wrong_point" if wrong else "residuals"
    return Contradiction(kind, wrong or everything, size, p_value)


def is_flat(points: Array) -> bool:
    """Tell if points lie nearly in one plane.

    Examples
    --------
    >>> corners = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    >>> is_flat(corners), is_flat(corners + [[0, 0, 0], [0, 0, 1], [0, 0, 0], [0, 0, 1]])
    (True, False)
    """
    extent = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(extent[2] < FLAT * extent[0])


def _exchanged(matched: MatchedPoints) -> Iterator[tuple[int, int]]:
    """Find pairs of points with whose angles exchanged all agree."""
    for one, other in combinations(range(len(matched)), 2):
        order = np.arange(len(matched))
        order[[one, other]] = other, one
        poses = _poses(replace(matched, angles=matched.angles[order]))
        if poses and _probability(poses) >= AGREE and _in_front(poses[0], matched):
            yield one, other


def _wrong(matched: MatchedPoints) -> Iterator[int]:
    """Find points without which the others agree."""
    for one in range(len(matched)):
        poses = _poses(without(matched, one))
        if poses and _probability(poses) >= AGREE:
            yield one


def _beside(matched: MatchedPoints, one: int) -> float:
    """Give the distance, DAC steps, of a point from where the others put it."""
    pose = _poses(without(matched, one))[0]
    angle, _ = pose.angles(matched.points[[one]], matched.mirror_offset)
    return float(np.linalg.norm((matched.angles[one] - angle[0]) / matched.step))


def without(matched: MatchedPoints, one: int) -> MatchedPoints:
    """Leave one point out."""
    kept = np.arange(len(matched)) != one
    std = None if matched.std is None else matched.std[kept]
    return replace(matched, points=matched.points[kept], angles=matched.angles[kept], std=std)


def _poses(matched: MatchedPoints) -> list[RoughPose]:
    try:
        return rough_poses(matched)
    except UserError:  # in a line, say
        return []


def _probability(poses: Sequence[RoughPose]) -> float:
    """Give the probability of residuals at least as large as the best fitting pose's."""
    return float(chi_square_p_value(min(pose.cost for pose in poses), poses[0].dof))


def _in_front(pose: RoughPose, matched: MatchedPoints) -> bool:
    """Tell if the instrument stands before the points, on the side that z points to."""
    return bool(pose.origin[2] > matched.points[:, 2].mean())


def joined(names: Sequence[str], word: str = "and") -> str:
    """Write names as in a sentence, a noun that all have but once.

    Examples
    --------
    >>> joined(["mark 1", "mark 2", "mark 4"]), joined(["circle 1", "corner 2"], "or")
    ('marks 1, 2 and 4', 'circle 1 or corner 2')
    """
    nouns = {name.rpartition(" ")[0] for name in names}
    noun = next(iter(nouns)) if len(nouns) == 1 else ""
    *some, last = [name.removeprefix(f"{noun} ") for name in names] if noun else names
    listed = f"{', '.join(some)} {word} {last}" if some else last
    return f"{noun}{'s' if word == 'and' and some else ''} {listed}" if noun else listed
