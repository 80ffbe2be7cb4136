"""How far a mark lies off where the others put it, and whether errors explain that.

A fit of few marks follows each of them: of four good ones any is put by the other three to tens of
steps. So a mark is judged by how much it adds to the cost of the fit, ``d = cost(all) -
cost(all but it)``, which with errors that are stated right is chi-square of 2 whatever the
leverage. While another mark is wrong too, the others cannot tell which: then the one that costs
most is.

The distance up to which errors explain a mark, in all but `ODD` of the cases, is its own
``sqrt(quantile / d)`` times where it adds a cost of its own, `TELLS`; a mark that others meet
nearly exactly has no such ratio. Then it follows from how a mark scatters around the place where
the others put it, ``sqrt(quantile / (u' S^-1 u))`` along the direction u in which it lies off, with
``S = J C J' + pointing^2 + place^2`` of the pose of the others; of one that lies off by less than
the pointing's error, whose direction is chance, in the mean square of all directions. It is thus
never smaller than the pointing's own, and of a mark of leverage near one, whose place the others
hardly know, so large that nothing is told.

Three marks fit up to four poses: a mark is compared with the one to which all marks together
belong, ``min_k cost_k + r_k' S_k^-1 r_k``, whichever is the likeliest without it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.instrument.person import Steps
from sldvexp.pose import Aiming
from sldvexp.statistics import chi_square_p_value
from sldvexp.typing import Array

#: Part of the good marks that may be called off.
ODD = 0.01
#: Quantile of chi-square of 2 that belongs to it.
LARGEST = -2 * math.log(ODD)
#: Cost of a mark from which it tells by itself how far it may lie off.
TELLS = 1.0
#: Part of the mirrors' range beyond which a distance tells nothing.
OPEN = 0.1
#: What is said then.
NOTHING = "the others do not tell where it lies, so that it can be anywhere"


@dataclass(frozen=True)
class MarkMisfit:
    """A mark beside where the others put it.

    Parameters
    ----------
    expected : (up_down, left_right)
        Steps where these put it.
    off : float, steps
        Its distance from there.
    usual : float, steps
        Distance that way up to which errors explain it, in all but `ODD` of the cases; infinite
        where nothing tells.
    beside : bool
        Whether it lies farther off than that, and the others do not say that one of them does.
    """

    expected: Steps
    off: float
    usual: float
    beside: bool

    @property
    def told(self) -> dict[str, float | bool | str | None]:
        """What the page shows; of a mark of which nothing tells why there is no distance."""
        if not math.isfinite(self.usual):
            return {"off": None, "usual": None, "beside": False, "why": NOTHING}
        return {"off": self.off, "usual": self.usual, "beside": self.beside, "why": ""}


@dataclass(frozen=True, eq=False)
class _Others:
    """Fit of all marks but one, and how far off it that one lies.

    Parameters
    ----------
    cost : float
    dof : int
    expected : ndarray, shape (2,), steps
    off : ndarray, shape (2,), steps
    usual : float, steps
        Distance that way which errors explain, by the covariance of the fit.
    """

    cost: float
    dof: int
    expected: Array
    off: Array
    usual: float


def misfits_of(
    aiming: Aiming, marks: Mapping[str, Steps], alone: Callable[[], Aiming]
) -> dict[str, MarkMisfit]:
    """Judge each mark by the others; none of them if they do not say.

    Parameters
    ----------
    aiming : Aiming
        At all marks.
    marks : mapping of str to (up_down, left_right)
        These, by their names.
    alone : callable
        Makes such an aiming without any mark.
    """
    others = {name: fit for name in marks if (fit := _without(name, marks, alone)) is not None}
    whole = min((pose.cost for pose in aiming.poses), default=math.nan)
    added = {name: max(whole - fit.cost, 0.0) for name, fit in others.items()}
    most = max(added.values(), default=0.0)
    low, high = aiming.laser.board.value
    found = {}
    for name, fit in others.items():
        off, usual = float(np.hypot(*fit.off)), fit.usual
        if added[name] >= TELLS:
            usual = off * math.sqrt(LARGEST / added[name])
        agree = fit.dof == 0 or bool(chi_square_p_value(fit.cost, fit.dof) >= ODD)
        beside = added[name] > LARGEST and (agree or added[name] == most)
        up_down, left_right = np.rint(fit.expected).astype(int).tolist()
        told = usual if usual <= OPEN * (high - low) else math.inf
        found[name] = MarkMisfit((up_down, left_right), off, told, beside)
    return found


def _without(name: str, marks: Mapping[str, Steps], alone: Callable[[], Aiming]) -> _Others | None:
    """Fit all marks but one, and compare that one with the pose to which it belongs."""
    rest = alone()
    for other, steps in marks.items():
        if other != name:
            rest.take(other, steps)
    try:
        rest.predict(name)
    except UserError:  # too few, in a line, or out of the mirrors' reach
        return None
    found = []
    for pose in rest.poses:
        expected, covariance = rest.scatter(name, pose)
        if not np.isfinite(expected).all():
            continue
        off = np.array(marks[name], float) - expected
        added = float(off @ np.linalg.solve(covariance, off))
        usual = math.sqrt(LARGEST * _variance(covariance, off, rest.pointing))
        found.append((pose.cost + added, _Others(pose.cost, pose.dof, expected, off, usual)))
    least = min(pose.cost for pose in rest.poses)
    _, one = min(found, key=lambda pair: pair[0])
    return _Others(least, one.dof, one.expected, one.off, one.usual)


def _variance(covariance: Array, off: Array, pointing: float) -> float:
    """Give ``1 / (u' S^-1 u)`` along an offset; of one within the pointing's error the mean."""
    length = float(np.hypot(*off))
    if length < pointing:
        return float(np.trace(covariance) / 2)
    u = off / length
    return float(1 / (u @ np.linalg.solve(covariance, u)))
