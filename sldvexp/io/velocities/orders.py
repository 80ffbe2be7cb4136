"""Orders of the dimensions of arrays without names of these, as MATLAB has them.

One order is that of all arrays of a file; each has those of its dimensions that it needs. Which
orders fit the arrays' lengths is only told, never chosen: several may.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sldvexp.errors import UserError
from sldvexp.io.questions import OpenQuestionError
from sldvexp.io.velocities.table import DIMENSIONS

#: Dimensions that each variable may have; the first is needed.
ALLOWED = {
    "direction_cosines": ("view", "point", "axis"),
    "velocity": ("view", "point", "frequency"),
    "velocity_std": ("view", "point", "frequency"),
    "position": ("point", "axis"),
}
#: Arrays that lie in one order, and lists along one dimension each.
ARRAYS = ("velocity", "std", "direction_cosines", "position")
LISTS = ("view", "point", "frequency")
#: Views beyond which they may be points.
MOST_VIEWS = 16
#: Orders that a message lists.
MOST_LISTED = 3


def cubes(cosines: ArrayLike, velocity: ArrayLike) -> tuple[NDArray, NDArray]:
    """Give missing point and frequency dimensions of directions and velocities length one."""
    directions, values = np.asarray(cosines), np.asarray(velocity)
    if directions.ndim == 2:
        directions, values = directions[:, None], np.expand_dims(values, 1)
    return directions, values if values.ndim == 3 else values[..., None]


def shapes_agree(values: Mapping[str, Any]) -> bool:
    """Tell whether velocities and directions have the same views and points, and 3 numbers."""
    cosines, velocity = cubes(values["direction_cosines"], values["velocity"])
    return (
        velocity.ndim == 3 and velocity.shape[:2] == cosines.shape[:2] and cosines.shape[2:] == (3,)
    )


def require_plausible(values: Mapping[str, Any], stored: Mapping[str, Any], path: Path) -> None:
    """Ask whether there are really many views of fewer points, or the two are exchanged.

    Raises
    ------
    OpenQuestionError
        If so.
    """
    views, points = cubes(values["direction_cosines"], values["velocity"])[0].shape[:2]
    if views > max(points, MOST_VIEWS) and points > 1:
        raise OpenQuestionError(
            f"{path}: has {views} views of {points} points, if its arrays begin with views; "
            f"{fitting_orders(stored)}"
        )


def told_shapes(values: Mapping[str, Any]) -> str:
    """Word that shapes do not agree."""
    cosines, velocity = cubes(values["direction_cosines"], values["velocity"])
    others = [f", {n} {np.shape(values[n])}" for n in ("position", *LISTS) if n in values]
    return (
        f"velocity has the shape {velocity.shape} and direction_cosines {cosines.shape}"
        f"{''.join(others)}; they must agree in views and points, and directions need 3 numbers"
    )


def fitting_orders(stored: Mapping[str, Any], given: Sequence[str] = ()) -> str:
    """Say which values of `instrument.order` fit the lengths of a file's arrays.

    Parameters
    ----------
    given : sequence of str
        Order that was tried, and does not.
    """
    listed = [f"instrument.order=[{','.join(order)}]" for order in orders_that_fit(stored)]
    if len(listed) == 1:
        return f"only {listed[0]} fits the lengths of all arrays"
    if not listed:
        tried = f" (also not [{','.join(given)}])" if given else ""
        return (
            f"no one order of dimensions{tried} fits all arrays; bring them into one order in the "
            "file, as with permute of MATLAB, and say it with instrument.order"
        )
    shown = " or ".join(listed[:MOST_LISTED]) + (" or others" if listed[MOST_LISTED:] else "")
    return f"say how the file's arrays lie: by their lengths {shown} may be right"


def orders_that_fit(stored: Mapping[str, Any]) -> list[tuple[str, ...]]:
    """List the orders that fit the lengths of a file's arrays, of equal ones the first."""
    found: dict[tuple[tuple[str, ...], ...], tuple[str, ...]] = {}
    there = [name for name in ARRAYS if name in stored and name in ALLOWED]
    several = np.ndim(stored["direction_cosines"]) > 2 or "position" in stored
    for dims in ((*DIMENSIONS,), ("view", "point", "axis"), ("view", "frequency", "axis")):
        if ("point" in dims) is not several:
            continue
        for order in permutations(dims):
            if _fits(stored, order):
                each = tuple(tuple(d for d in order if d in ALLOWED[a]) for a in there)
                found.setdefault(each, order)
    return list(found.values())


def _fits(stored: Mapping[str, Any], order: tuple[str, ...]) -> bool:
    """Tell whether arrays and lists have the same lengths of all dimensions in an order."""
    try:
        return all_agree(in_order(stored, order, Path()))
    except UserError:
        return False


def all_agree(values: Mapping[str, Any]) -> bool:
    """Tell whether names, frequencies and positions are as many as velocities say."""
    if not shapes_agree(values):
        return False
    cosines, velocity = cubes(values["direction_cosines"], values["velocity"])
    sizes = dict(zip(LISTS, velocity.shape, strict=True))
    lists = {name: np.size(values[name]) for name in LISTS if name in values}
    if any(size != sizes[name] for name, size in lists.items()):
        return False
    place = values.get("position")
    return place is None or np.atleast_2d(place).shape == (cosines.shape[1], 3)


def in_order(values: Mapping[str, Any], order: Sequence[str], path: Path) -> dict[str, Any]:
    """Put dimensions in the order (view, point, frequency), or (.., axis).

    MATLAB leaves dimensions of length one out at the end.
    """
    values = dict(values)
    named = order if "axis" in order else (*order, "axis")
    for name in ARRAYS:
        whole = ALLOWED["velocity" if name == "std" else name]
        if name not in values:
            continue
        own = [d for d in named if d in whole]
        array = np.asarray(values[name])
        array = array.reshape(array.shape + (1,) * (len(own) - array.ndim))
        if name == "position":
            own = own if "point" in own else ["point", "axis"]
        if array.ndim != len(own):
            raise UserError(
                f"{path}: {name} has {array.ndim} dimensions, but instrument.order says "
                f"{len(own)}: {', '.join(own)}"
            )
        values[name] = array.transpose([own.index(d) for d in whole if d in own])
    return values
