"""The laser's intrinsics among the unknowns of a pose: their names, their effect, what to mind."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import EXTRINSICS
from sldvexp.pose.least_squares import INTRINSICS
from sldvexp.typing import Array

#: Share of an intrinsic in an undetermined direction from which it is named.
NOTABLE = 0.1
#: By how much an adjusted intrinsic may enlarge a bound of the pose before that is noted.
COSTLY = 1.5
#: Standard error, as a part of the prior's, from which the data added nothing.
NOTHING_ADDED = 0.9


def nominal_intrinsics(mirror_offset: float) -> Array:
    """Give the values of `INTRINSICS` by the calibration, shape (5,).

    Examples
    --------
    >>> nominal_intrinsics(0.03)
    array([0.03, 1.  , 0.  , 1.  , 0.  ])
    """
    return np.array([mirror_offset, 1.0, 0.0, 1.0, 0.0])


def places(names: Iterable[str]) -> list[int]:
    """Find the positions of named intrinsics in `INTRINSICS`.

    Examples
    --------
    >>> places(["mirror_offset", "gain_left_right"])
    [0, 3]
    """
    return [INTRINSICS.index(name) for name in names]


def true_angles(recorded: ArrayLike, intrinsics: Array) -> Array:
    """Correct recorded angles, ``gain recorded + zero``, shape (..., 2), rad.

    Parameters
    ----------
    recorded : array_like, shape (..., 2), rad
        (up_down, left_right) by the nominal calibration.
    intrinsics : ndarray, shape (5,)
        In the order of `INTRINSICS`.

    Examples
    --------
    >>> true_angles([0.1, -0.2], np.array([0.03, 1.01, 0.0, 1.0, 0.005])).round(4)
    array([ 0.101, -0.195])
    """
    return np.asarray(intrinsics[1::2] * np.asarray(recorded) + intrinsics[2::2])


def named(names: Sequence[str], share: Array) -> str:
    """Join the names whose share (not negative) in a direction is notable; empty if none is."""
    return " and ".join(n for n, s in zip(names, share, strict=True) if s > NOTABLE)


def adjusted_notes(
    own: Mapping[str, float], shared: Mapping[str, float], pose: xr.Dataset
) -> Iterator[str]:
    """Say which adjusted intrinsics the data does not determine.

    Parameters
    ----------
    own, shared : mapping of str to float
        Those adjusted for each view and for all views, with the standard deviations of their
        priors.
    pose : xarray.Dataset
        The group ``pose``; its attribute ``mirror_offset`` is the nominal one.
    """
    nominal = nominal_intrinsics(pose.attrs["mirror_offset"])
    cases = [(f"view {v}", [v], name, own[name]) for v in pose["view"].values for name in own]
    cases += [("all views", list(pose["view"].values), name, shared[name]) for name in shared]
    for where, views, name, prior_std in cases:
        expected = nominal[INTRINSICS.index(name)]
        of = pose.sel(view=views, adjusted=name)
        value, std, width = (
            float(of[f"intrinsic{what}"][0]) for what in ("", "_std", "_confidence")
        )
        times = _cost_of(of["covariance"].values, list(pose["parameter"].values).index(name))
        if prior_std < np.inf and std > NOTHING_ADDED * prior_std:
            yield f"{where}: {name} is what was assumed of it beforehand; this data adds nothing"
        elif not abs(value - expected) > width and not times < COSTLY:
            yield (
                f"{where}: this data barely determines {name}: {value:.4f} with a standard error "
                f"of {std:.4f}, so that {expected:g} is as good; fixed there it would leave the "
                f"pose's bounds up to {times:.1f} times smaller"
            )


def _cost_of(covariance: Array, place: int) -> float:
    """Say how much larger the worst bound of any view is than if one intrinsic were known.

    Knowing it takes ``c_pi^2 / c_ii`` off the variance of each parameter p of the pose.
    """
    pose = slice(0, len(EXTRINSICS))
    variance = np.einsum("vkk->vk", covariance)
    explained = covariance[:, pose, place] ** 2 / variance[:, place, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        return float(np.sqrt(np.max(variance[:, pose] / (variance[:, pose] - explained))))
