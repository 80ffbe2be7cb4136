"""How far a mark lies off where the others put it, and whether errors explain that.

A fit of few marks follows each of them: of four good ones any is put by the other three to tens of
steps. So a mark is judged by how much it adds to the cost of the fit, ``d = cost(all) -
cost(all but it)``, which with errors that are stated right is chi-square of 2 whatever the
leverage; the distance that goes with the probability `ODD` is its own ``sqrt(quantile / d)`` times.
While another mark is wrong too, the others cannot tell which: then the one that costs most is.
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

#: Part of the good marks that may be called off.
ODD = 0.01
#: Quantile of chi-square of 2 that belongs to it.
LARGEST = -2 * math.log(ODD)


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
        Distance that way up to which errors explain it, in all but `ODD` of the cases.
    beside : bool
        Whether it lies farther off than that, and the others do not say that one of them does.
    """

    expected: Steps
    off: float
    usual: float
    beside: bool

    @property
    def told(self) -> dict[str, float | bool | None]:
        """What the page shows; of a mark that is nowhere off there is no usual distance."""
        usual = self.usual if math.isfinite(self.usual) else None
        return {"off": self.off, "usual": usual, "beside": self.beside}


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
    cost = {name: rest for name in marks if (rest := _without(name, marks, alone)) is not None}
    whole = min((pose.cost for pose in aiming.poses), default=math.nan)
    added = {name: max(whole - left, 0.0) for name, (left, _, _) in cost.items()}
    most = max(added.values(), default=0.0)
    found = {}
    for name, (left, dof, expected) in cost.items():
        off = float(np.hypot(*np.subtract(marks[name], expected)))
        usual = off * math.sqrt(LARGEST / added[name]) if added[name] else math.inf
        agree = dof == 0 or bool(chi_square_p_value(left, dof) >= ODD)
        beside = added[name] > LARGEST and (agree or added[name] == most)
        found[name] = MarkMisfit(expected, off, usual, beside)
    return found


def _without(
    name: str, marks: Mapping[str, Steps], alone: Callable[[], Aiming]
) -> tuple[float, int, Steps] | None:
    """Fit all marks but one: the cost, its degrees of freedom, and where they put that one."""
    rest = alone()
    for other, steps in marks.items():
        if other != name:
            rest.take(other, steps)
    try:
        expected = rest.predict(name).steps
    except UserError:  # too few, in a line, or out of the mirrors' reach
        return None
    return min(pose.cost for pose in rest.poses), rest.poses[0].dof, expected
