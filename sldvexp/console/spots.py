"""Spots of a quick look, and which circle each of them is.

A spot is what moves together in a look: cells next to one another above a part of the largest
amplitude. Near a rough pose the circles lie where it predicts them, all moved by one error x of the
pose, ``p_i + J_i x``, which is known to `ROUGH`. One circle alone may lie between two spots; all of
them together rarely fit in two ways. For each pair of a circle and a spot near it the others are
assigned to the spots that are nearest then, x is estimated from all, and the assignment costs

``sum |q_j - p_i - J_i x|^2 / s_j^2 + sum (x / ROUGH)^2 + ALONE (circles in the look without a spot
+ spots without a circle)``.

The cheapest is taken; circles to which one that costs hardly more gives another spot are open.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sldvexp.lazy import scipy
from sldvexp.typing import Array, IntArray

#: Part of the largest amplitude, and times the median one, above which a cell is of a spot.
BRIGHT, ABOVE = 0.2, 5.0
#: Error of a spot's middle, in cells of the look.
CELLS = 0.4
#: Part of the predicted area that a spot has at least and at most.
AREA = (0.3, 2.5)
#: Cost of a circle that is looked at and has no spot, and of a spot that is no circle.
ALONE = 20.0
#: Squared distance, over its variance, up to which a spot may be a circle.
NEAR = 20.0
#: Difference of costs below which two assignments are not told apart: a spot that is taken for
#: another circle costs more time than a wider look does.
OPEN = 16.0
#: How often an assignment is made anew by what it tells of the pose.
ROUNDS = 3


@dataclass(frozen=True, eq=False)
class LookSpot:
    """What moves together in a look.

    Parameters
    ----------
    dac : ndarray, shape (2,), steps
        Its middle.
    area : float, squared steps
    std : float, steps
        Standard deviation of the middle.
    """

    dac: Array
    area: float
    std: float


@dataclass(frozen=True, eq=False)
class LookedAt:
    """Region of a look with its spots, at one fineness.

    Parameters
    ----------
    low, high : ndarray, shape (2,), steps
    spots : list of LookSpot
        Those that lie wholly in it.
    """

    low: Array
    high: Array
    spots: list[LookSpot]

    def has(self, dac: Array) -> bool:
        """Tell whether a place lies in the region."""
        return bool(np.all(dac >= self.low) and np.all(dac <= self.high))


@dataclass
class SpotsSeen:
    """Spots of the looks at one view; where looks overlap the last one counts.

    Parameters
    ----------
    looks : list of LookedAt
        The oldest first.
    """

    looks: list[LookedAt] = field(default_factory=list)
    _parts: list[tuple[int, IntArray, Array, Array]] = field(default_factory=list)

    def begin(self) -> None:
        """Begin another look."""
        self._parts = []

    def add(self, cell: int, dac: IntArray, value: Array, flags: Array) -> bool:
        """Take a part of a look; true if one fineness was ended by it, and spots may be others."""
        ended = bool(self._parts) and self._parts[0][0] != cell and self.end()
        self._parts.append((cell, dac, value, flags))
        return ended

    def end(self) -> bool:
        """Take what there is of this fineness as all of it; true if there was any."""
        parts, self._parts = self._parts, []
        if not parts:
            return False
        cell = parts[0][0]
        dac, value, flags = (np.concatenate([part[k] for part in parts]) for k in (1, 2, 3))
        low, high = dac.min(axis=0) - cell / 2, dac.max(axis=0) + cell / 2
        look = LookedAt(low, high, list(spots_of(dac, value, flags, cell)))
        within = [np.all(old.low >= low) and np.all(old.high <= high) for old in self.looks]
        self.looks = [old for old, is_in in zip(self.looks, within, strict=True) if not is_in]
        self.looks.append(look)
        return True

    @property
    def spots(self) -> list[LookSpot]:
        """Spots that no later look has looked at again."""
        return [
            spot
            for k, look in enumerate(self.looks)
            for spot in look.spots
            if not any(later.has(spot.dac) for later in self.looks[k + 1 :])
        ]

    def looked_at(self, dac: Array) -> bool:
        """Tell whether a place lies in any look."""
        return any(look.has(dac) for look in self.looks)


def spots_of(dac: IntArray, value: Array, flags: Array, cell: int) -> Iterator[LookSpot]:
    """Find the spots of a look of one fineness that do not reach its edge.

    Examples
    --------
    >>> dac = np.stack(np.meshgrid(range(0, 90, 10), range(0, 90, 10)), axis=-1).reshape(-1, 2)
    >>> value = np.exp(-((dac - [32, 50]) ** 2).sum(axis=1) / 200)
    >>> [(spot.dac.round().tolist(), spot.area) for spot in spots_of(dac, value, value < 0, 10)]
    [([32.0, 50.0], 1000.0)]
    """
    rows, row = np.unique(dac[:, 0], return_inverse=True)
    columns, column = np.unique(dac[:, 1], return_inverse=True)
    amplitude = np.zeros((len(rows), len(columns)))
    amplitude[row, column] = np.where(flags == 0, value, 0.0)
    least = max(BRIGHT * amplitude.max(), ABOVE * float(np.median(amplitude)))
    labels, count = scipy.ndimage.label(amplitude > least)
    for k in range(1, count + 1):
        up, left = np.nonzero(labels == k)
        if up.min() == 0 or left.min() == 0:
            continue
        if up.max() == len(rows) - 1 or left.max() == len(columns) - 1:
            continue
        weight = amplitude[up, left]
        places = np.stack([rows[up], columns[left]], axis=1)
        middle = np.average(places, axis=0, weights=weight)
        yield LookSpot(np.asarray(middle), float(len(up)) * cell**2, CELLS * cell)


@dataclass(frozen=True, eq=False)
class CirclePattern:
    """Circles as a rough pose predicts them.

    Parameters
    ----------
    dac : ndarray, shape (circle, 2), steps
    jacobian : ndarray, shape (circle, 2, 6)
        Change by the pose's error.
    area : ndarray, shape (circle,), squared steps
    rough : ndarray, shape (6, 6)
        Information on the pose's error, of its statement and of marks.
    """

    dac: Array
    jacobian: Array
    area: Array
    rough: Array


@dataclass(frozen=True)
class SpotAssignment:
    """Spots of circles.

    Parameters
    ----------
    spots : dict of int to int
        Numbers of spots by those of circles.
    open : dict of int to list of int
        Of circles of which it is open which spot they are: those that it may be.
    """

    spots: Mapping[int, int]
    open: Mapping[int, list[int]]


def assign(pattern: CirclePattern, spots: Sequence[LookSpot], seen: SpotsSeen) -> SpotAssignment:
    """Say which spot is which circle, and of which circles that is open."""
    if not spots or not len(pattern.dac):
        return SpotAssignment({}, {})
    place = np.array([spot.dac for spot in spots])
    area = np.array([spot.area for spot in spots])
    ratio = area[None] / pattern.area[:, None]
    alike = (ratio >= AREA[0]) & (ratio <= AREA[1])
    fit = _Fit(pattern, place, np.array([spot.std for spot in spots]), alike, seen)
    found: dict[tuple[int, ...], float] = {}
    for circle, spot in zip(*np.nonzero(fit.near(np.zeros(6), pattern.rough)), strict=True):
        spot_of = np.full(len(pattern.dac), -1)
        spot_of[circle] = spot
        cost, settled = fit.settled(spot_of)
        key = tuple(settled.tolist())
        found[key] = min(cost, found.get(key, np.inf))
    if not found:
        return SpotAssignment({}, {})
    best = min(found, key=lambda key: found[key])
    rivals = [key for key, cost in found.items() if cost < found[best] + OPEN]
    choices = [{key[k] for key in rivals} for k in range(len(best))]
    unsure = {k: sorted(each - {-1}) for k, each in enumerate(choices) if len(each) > 1}
    sure = {k: spot for k, spot in enumerate(best) if spot >= 0 and k not in unsure}
    return SpotAssignment(sure, unsure)


@dataclass(frozen=True, eq=False)
class _Fit:
    """Estimate of the pose's error from some circles whose spots are known."""

    pattern: CirclePattern
    place: Array
    std: Array
    alike: NDArray[np.bool_]
    seen: SpotsSeen

    def near(self, x: Array, information: Array) -> NDArray[np.bool_]:
        """Tell which spots each circle may be, shape (circle, spot)."""
        return (self._distance(x, information) < NEAR) & self.alike

    def settled(self, spot_of: IntArray) -> tuple[float, IntArray]:
        """Assign all circles from some on; the cost, and each circle's spot or -1."""
        for _ in range(ROUNDS):
            x, information = self._estimate(spot_of)
            distance = np.where(self.near(x, information), self._distance(x, information), np.inf)
            spot_of = _nearest(distance)
        x, _ = self._estimate(spot_of)
        has = spot_of >= 0
        moved = self._moved(x)
        off = (self.place[spot_of[has]] - moved[has]) / self.std[spot_of[has], None]
        lonely = sum(self.seen.looked_at(dac) for dac in moved[~has])
        lonely += len(self.place) - int(has.sum())
        cost = float((off**2).sum() + x @ self.pattern.rough @ x + ALONE * lonely)
        return cost, spot_of

    def _moved(self, x: Array) -> Array:
        return np.asarray(self.pattern.dac + self.pattern.jacobian @ x)

    def _estimate(self, spot_of: IntArray) -> tuple[Array, Array]:
        """Estimate the pose's error, and the information on it."""
        has = np.flatnonzero(spot_of >= 0)
        weight = 1 / self.std[spot_of[has], None]
        rows = (self.pattern.jacobian[has] * weight[..., None]).reshape(-1, 6)
        right = ((self.place[spot_of[has]] - self.pattern.dac[has]) * weight).ravel()
        information = rows.T @ rows + self.pattern.rough
        return np.asarray(np.linalg.solve(information, rows.T @ right)), information

    def _distance(self, x: Array, information: Array) -> Array:
        """Compute squared distances of circles and spots over their variance."""
        jacobian = self.pattern.jacobian
        scatter = jacobian @ np.linalg.solve(information, jacobian.swapaxes(1, 2))
        own = np.einsum("s,ab->sab", self.std**2, np.eye(2))
        inverse = np.linalg.inv(scatter[:, None] + own[None])
        off = self.place[None] - self._moved(x)[:, None]
        return np.asarray(np.einsum("csa,csab,csb->cs", off, inverse, off))


def _nearest(distance: Array) -> IntArray:
    """Assign circles to spots, each to one at most, so that all distances together are least."""
    count = len(distance)
    alone = np.where(np.eye(count, dtype=bool), NEAR, 10 * NEAR)
    every = np.concatenate([np.where(np.isfinite(distance), distance, 1e6), alone], axis=1)
    _, spot = scipy.optimize.linear_sum_assignment(every)
    return np.where(spot < distance.shape[1], spot, -1)
