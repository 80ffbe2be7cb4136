"""Marks that no rough pose within its errors explains.

``cost = sum (missed / std)^2 + sum (gone / ROUGH)^2`` at the pose that some marks correct is
chi-square of two degrees of freedom a mark, since the correction is bought by the errors that a
rough pose is allowed. A mark without which that cost falls by more than errors explain, and is
likely, is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.geometry import KnownPose
from sldvexp.laser.aiming import FOUND, ROUGH, corrected_pose, dac_of_points
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.statistics import chi_square_p_value
from sldvexp.typing import Array, IndexArray

#: Probability of marks below which they do not fit: of four standard deviations.
REFUTED = math.erfc(4 / math.sqrt(2))


@dataclass(frozen=True, eq=False)
class RoughDoubt:
    """Marks that a rough pose does not explain.

    Parameters
    ----------
    wrong : str
        Mark without which the others fit; empty if there is none.
    told : str
        The same in one sentence, with what to do.
    """

    wrong: str
    told: str


def doubt_of_rough_pose(
    marks: dict[str, tuple[int, int]],
    points: Array,
    rough: KnownPose,
    laser: TwoMirror,
    std: Array | float = 0.0,
) -> RoughDoubt | None:
    """Compare marks with a rough pose; None if they fit it.

    Parameters
    ----------
    marks : dict of str to (up_down, left_right), steps
        By their names, in the order in which they were taken: of two that do not fit each other
        the later one is named.
    points : ndarray, shape (N, 3), m
        Places of the marks.
    std : ndarray, shape (N,), or float, steps
        Standard deviations of the marks, beside those of corrections.

    Examples
    --------
    >>> rough = KnownPose([0, 0, 0], [0.0, 0, 0])
    >>> points = np.array([[0, 0, 2.0], [0.2, 0, 2.0]])
    >>> doubt_of_rough_pose({"mark 1": (9, 5), "mark 2": (9, 940)}, points, rough, TwoMirror())
    >>> doubt_of_rough_pose({"mark 1": (9, 5), "mark 2": (9, 470)}, points, rough, TwoMirror()).told
    'mark 2 lies 471 steps from where the rough pose and mark 1 put it: take it or mark 1 again, \
or correct the rough pose'
    """
    problem = _Problem(np.array(list(marks.values()), float), points, rough, laser, std)
    every = np.arange(len(marks), dtype=np.intp)
    cost = problem.cost(every)
    if _fits(cost, len(marks)):
        return None
    names = list(marks)
    without = {k: problem.cost(np.delete(every, k)) for k in every.tolist()}
    could = [
        k
        for k, rest in without.items()
        if _fits(rest, len(marks) - 1) and not _fits(cost - rest, 1)
    ]
    if not could:
        one = len(names) == 1
        told = f"{_listed(names)} {'does' if one else 'do'} not agree with the rough pose"
        return RoughDoubt("", f"{told}: take {'it' if one else 'them'} again, or correct that pose")
    # Of two marks either may be wrong, by nearly as much.
    wrong = could[-1] if len(names) == 2 else min(could, key=lambda k: without[k])
    others = [name for name in names if name != names[wrong]]
    by = f"and {others[0] if len(others) == 1 else 'the other marks'} put" if others else "puts"
    again = f"it or {others[0]} again" if len(others) == 1 else "it again"
    return RoughDoubt(
        names[wrong],
        f"{names[wrong]} lies {problem.beside(wrong)} from where the rough pose {by} it: "
        f"take {again}, or correct the rough pose",
    )


@dataclass(frozen=True, eq=False)
class _Problem:
    """Marks, and what they are compared with."""

    dac: Array
    points: Array
    rough: KnownPose
    laser: TwoMirror
    std: Array | float

    @property
    def error(self) -> Array:
        """Standard deviations of the marks, shape (N, 1)."""
        return np.hypot(FOUND, np.broadcast_to(self.std, len(self.dac)))[:, None]

    def corrected(self, by: IndexArray) -> tuple[Array, Array]:
        """Correct the rough pose by some marks."""
        pose = self.rough.rotation, self.rough.place
        if not len(by):
            return pose
        names = ["it"] * len(by)
        return corrected_pose(
            self.points[by], self.dac[by], *pose, self.laser, names, self.error[by]
        )

    def cost(self, of: IndexArray) -> float:
        """Sum the squares of what some marks miss, and of the correction that they want."""
        try:
            rotation, origin = self.corrected(of)
            missed = self.dac[of] - self._seen(of, rotation, origin)
        except UserError:  # no pose near the rough one
            return math.inf
        cosine = (np.trace(rotation @ self.rough.rotation.T) - 1) / 2
        turned = math.acos(min(max(float(cosine), -1.0), 1.0)) / ROUGH[0]
        moved = (origin - self.rough.place) / ROUGH[3:]
        return float(np.sum((missed / self.error[of]) ** 2) + turned**2 + np.sum(moved**2))

    def beside(self, one: int) -> str:
        """Say how far a mark lies from where the rough pose and the others put it."""
        try:
            pose = self.corrected(np.delete(np.arange(len(self.dac)), one))
            off = self.dac[one] - self._seen(np.array([one]), *pose)[0]
        except UserError:
            return "far"
        return f"{np.hypot(*off):.0f} steps"

    def _seen(self, of: IndexArray, rotation: Array, origin: Array) -> Array:
        points = self.points[of]
        return dac_of_points(points, rotation, origin, self.laser, ["it"] * len(points))


def _fits(cost: float, marks: int) -> bool:
    """Tell if errors explain a cost of so many marks."""
    return cost < math.inf and (not marks or bool(chi_square_p_value(cost, 2 * marks) >= REFUTED))


def _listed(names: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
