"""Limits of a room for many stands at once, which may be those of several rooms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.config.planning import PlanRoom
from sldvexp.typing import Array


@dataclass(frozen=True, eq=False)
class StandLimits:
    """Limits of every stand: a row for each, or one for all.

    Attributes
    ----------
    nearest, farthest : ndarray, shape (stand, 1), m
    incidence : ndarray, shape (stand, 1), deg
    mirrors : ndarray, shape (stand, 1)
        Part of their range.
    low, high : ndarray, shape (stand, 3), m
    """

    nearest: Array
    farthest: Array
    incidence: Array
    mirrors: Array
    low: Array
    high: Array

    @classmethod
    def from_room(cls, room: PlanRoom) -> StandLimits:
        """Take the limits that a room has for all stands; what it does not say is none.

        Examples
        --------
        >>> StandLimits.from_room(PlanRoom(high=[None, 1.5, None])).high.tolist()
        [[inf, 1.5, inf]]
        """
        nearest, farthest = room.distance or (0.0, np.inf)
        low = [-np.inf if v is None else v for v in room.low or (None,) * 3]
        high = [np.inf if v is None else v for v in room.high or (None,) * 3]
        numbers = ([nearest], [farthest], [room.incidence], [room.mirrors], low, high)
        return cls(*(np.array([row], float) for row in numbers))

    @classmethod
    def from_rooms(cls, rooms: Sequence[PlanRoom], counts: Sequence[int]) -> StandLimits:
        """Take those of several rooms, with so many stands in each, one room after the other.

        Examples
        --------
        >>> rooms = [PlanRoom(), PlanRoom(incidence=70.0)]
        >>> StandLimits.from_rooms(rooms, [1, 2]).incidence.ravel().tolist()
        [60.0, 70.0, 70.0]
        """
        every = [vars(cls.from_room(room)).values() for room in rooms]
        rows = (np.concatenate(of) for of in zip(*every, strict=True))
        return cls(*(np.repeat(of, counts, axis=0) for of in rows))
