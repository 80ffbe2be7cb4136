"""One stand more, after those that are there: where, and what it is worth.

The criterion is flat once there are many stands: a place right beside one of them is as good as the
best then, by a thousandth. Of the places that are as good the one is taken that is farthest from
the stands that are there, in direction as the object sees it: what these have wrong in common, a
pose, a speckle, a face that is badly lit, it does not share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.planner.criterion import PRIOR, Goal, covariance_of, variances
from sldvexp.planner.place import StandExamination
from sldvexp.typing import Array

#: Part of the best bound by which another one is as good.
AS_GOOD = 0.01
#: Part of the prior's variance from which a direction counts as seen by nobody.
UNSEEN = 0.1


@dataclass(frozen=True)
class OneMore:
    """Worth of one stand more.

    Attributes
    ----------
    best : float
        Part by which the bound becomes smaller from the best place.
    least : float
        That from the worst of the places that are feasible.
    """

    best: float
    least: float

    @property
    def told(self) -> str:
        """Sentence on it."""
        told = f"one stand more lowers the bound by {self.best:.0%}".replace("%", " %")
        if 1 - self.least <= (1 + AS_GOOD) * (1 - self.best):
            return f"{told}, wherever it stands; this place is the one farthest from the others"
        return f"{told} at best"


def one_more(
    goal: Goal, tried: StandExamination, begun: Array, there: Array, middle: Array
) -> tuple[StandExamination, OneMore | None]:
    """Take of the places that are as good as the best the one farthest from stands that are there.

    Parameters
    ----------
    tried : StandExamination
        Of feasible places.
    begun : ndarray, shape (stand, node, 3)
        Directions of the stands that are there.
    there, middle : ndarray, shape (stand, 3) and (3,), m
        Their places, and that of the object.

    Returns
    -------
    taken : StandExamination
        Of one place.
    worth : OneMore, optional
        None if the stands that are there do not determine what is asked for.
    """
    covariance = covariance_of(begun)
    values = goal.with_one_more(covariance, tried.looks)
    good = np.flatnonzero(values <= (1 + AS_GOOD) * values.min())
    nearest = (_ways(tried.origins[good], middle) @ _ways(there, middle).T).max(axis=1)
    taken = tried.take([int(good[nearest.argmin()])])
    counts = goal.weight > 0
    if variances(covariance, goal.wanted)[counts].max() > UNSEEN * PRIOR:
        return taken, None
    before = goal.of(covariance)
    return taken, OneMore(1 - float(values.min()) / before, 1 - float(values.max()) / before)


def _ways(places: Array, middle: Array) -> Array:
    """Make unit vectors from the object to places."""
    ways = places - middle
    return np.asarray(ways / np.linalg.norm(ways, axis=1, keepdims=True))
