"""Findings about digitised points: wrong readings, exchanged names, shapes and units that differ.

A digitizer stands still while a point is digitised over and over, so that a point's readings differ
by noise alone, alike for all of them. As with registrations (`sldvexp.pose.outliers`) the search
goes forward: readings near their point's median are a core, and of the others the one that raises
the sum of squares least, by ``d^2 m / (m + 1)`` for a distance d from the mean of m readings, is
put back while ``F(3, dof)`` has a probability above 1 %/n. The distances of the mean points are
then compared with those of the points as they are known: neither depends on where the digitizer
stood.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from sldvexp.dataset import Finding, Severity
from sldvexp.geometry import rigid_transform
from sldvexp.statistics import f_test
from sldvexp.typing import Array, BoolArray

#: Cutoff of the core, in scales; the median of Maxwell's distribution, in standard deviations.
CUTOFF, MEDIAN = 4.0, 1.5382
#: Probability that right readings lose one, and that points as they are known are doubted.
LEVEL = 0.01
#: Least noise of a digitizer, m.
LEAST = 1e-6
#: Share of wrong readings above which it was the digitizer that moved.
MOVED = 0.25
#: Relative difference of sizes that is a unit's; that of distances that are alike.
SCALED, ALIKE = 0.1, 0.02
#: Misfit with other names, as a part of that with the given ones, from which those are believed.
BETTER = 0.2


def used_readings(digitised: Array) -> tuple[BoolArray, Array]:
    """Find the readings that agree with their points' others.

    Parameters
    ----------
    digitised : ndarray, shape (repeat, point, 3), m
        In axes that stand still.

    Returns
    -------
    used : ndarray of bool, shape (repeat, point)
    p_value : ndarray, shape (repeat, point)
        Of putting back a reading that is not used; NaN for others.
    """
    repeats, points = digitised.shape[:2]
    p_value = np.full((repeats, points), np.nan)
    away = np.linalg.norm(digitised - np.median(digitised, axis=0), axis=-1)
    # The median lies on a reading or between two: few repeats look quieter than they are.
    scale = np.median(away) / MEDIAN * math.sqrt(repeats / max(repeats - 1, 1))
    used = away <= CUTOFF * max(scale, LEAST)
    used |= away == away.min(axis=0)
    while not used.all():
        count = used.sum(axis=0)
        mean = np.einsum("kp,kpi->pi", used, digitised) / count[:, None]
        square = np.sum((digitised - mean) ** 2, axis=-1)
        dof = 3 * (count.sum() - points)
        variance = max(np.sum(square[used]) / dof, LEAST**2) if dof > 0 else np.inf
        test = f_test(square * (count / (count + 1)) / 3 / variance, 3, max(dof, 1), 1 - LEVEL)
        p_value = np.where(used, np.nan, test.p_value)
        best = np.unravel_index(np.nanargmax(p_value), p_value.shape)
        if not p_value[best] > LEVEL / used.size:
            break
        used[best] = True
    return used, np.where(used, np.nan, p_value)


def judge_readings(
    digitised: Array, names: Sequence[str], view: str, file: str
) -> tuple[BoolArray, list[Finding]]:
    """Find repeats with wrong readings, and name these.

    Parameters
    ----------
    digitised : ndarray, shape (repeat, point, 3), m
    names : sequence of str
        Of the points.

    Returns
    -------
    right : ndarray of bool, shape (repeat,)
        Repeats without a wrong reading.
    findings : list of Finding
    """
    repeats = len(digitised)
    everything, where = np.ones(repeats, bool), f"view {view}"
    if repeats < 3:
        told = f"{where}: fewer than three readings of a point hide a wrong one"
        return everything, [Finding("untested", where, told, Severity.note, views=(view,))]
    used, p_value = used_readings(digitised)
    wrong = np.argwhere(~used)
    if len(wrong) > MOVED * used.size:
        told = (
            f"{where}: {len(wrong)} of {used.size} readings of {file} lie beside the others of "
            "their point: the digitizer moved, and no wrong reading can be told"
        )
        return everything, [
            Finding("moved", where, told, Severity.note, size=float(len(wrong)), views=(view,))
        ]
    right: BoolArray = np.all(used, axis=1)
    if right.sum() < 2:  # nearly every repeat has a reading that is wrong
        right = everything
    severity = Severity.note if repeats >= 5 and 2 * right.sum() > repeats else Severity.doubtful
    then = "and its repeat is left out"
    if right.all():
        severity, then = Severity.void, "as in nearly every repeat, so that none is left out"
    mean = np.array([digitised[used[:, p], p].mean(axis=0) for p in range(len(names))])
    return right, [
        _of_reading(
            k, p, digitised, mean, names, (view, file, severity, then, float(p_value[k, p]))
        )
        for k, p in wrong.tolist()
    ]


def _of_reading(
    k: int,
    p: int,
    digitised: Array,
    mean: Array,
    names: Sequence[str],
    said: tuple[str, str, Severity, str, float],
) -> Finding:
    """Say that a reading is wrong, or is one of another point."""
    view, file, severity, then, p_value = said
    beside = float(np.linalg.norm(digitised[k, p] - mean[p]))
    near = np.linalg.norm(digitised[k, p] - mean, axis=1)
    other = int(np.argmin(near))
    # A reading is taken for one of another point if that is much nearer than the point's own.
    exchanged = other != p and near[other] < BETTER * near[p]
    told = f"lies {1e3 * beside:.3g} mm beside the others (p = {p_value:.1g})"
    told += f", where {names[other]} is" if exchanged else ""
    return Finding(
        "exchanged_points" if exchanged else "wrong_point",
        f"view {view}, point {names[p]}",
        f"view {view}: reading {k + 1} of {names[p]} in {file} {told}, {then}",
        severity,
        p_value=p_value,
        size=beside,
        remedy=f"correct reading {k + 1} of {names[p]} in {file}, or digitise it again",
        views=(view,),
    )


def judge_shape(
    measured: Array, known: Array, names: Sequence[str], view: str, setting: str
) -> Iterator[Finding]:
    """Compare distances between digitised points with those between the points as known.

    Parameters
    ----------
    measured : ndarray, shape (repeat, point, 3), m
        Right readings.
    known : ndarray, shape (point, 3), m
    names : sequence of str
    setting : str
        That tells the points, for messages.
    """
    where, mean = f"view {view}", measured.mean(axis=0)
    scale = relative_size(known, mean)
    if scale is not None:
        yield Finding(
            "unit",
            where,
            f"{where}: the points of {setting} lie {scale:.4g} times as far from each other as "
            "they were digitised",
            Severity.void,
            size=scale,
            remedy=f"state {setting} in pose.unit, and the unit of the digitised points",
            views=(view,),
        )
        return
    given = _misfit(mean, known)
    repeats, points = measured.shape[:2]
    square = np.sum((measured - mean) ** 2)
    dof, free = 3 * points * (repeats - 1), 3 * points - 6
    if repeats < 2 or free <= 0:
        return
    noise = max(square / dof, LEAST**2)
    test = f_test(repeats * given / free / noise, free, dof, 1 - LEVEL)
    if not test.p_value < LEVEL / 2:  # there are two sets of points
        return
    for a, b in combinations(range(points), 2):
        order = np.arange(points)
        order[[a, b]] = b, a
        if _misfit(mean, known[order]) < BETTER**2 * given:
            yield Finding(
                "exchanged_points",
                f"{where}, points {names[a]} and {names[b]}",
                f"{where}: {names[a]} and {names[b]} of {setting} have each other's places",
                Severity.void,
                float(test.statistic),
                float(test.p_value),
                math.sqrt(given / points),
                f"exchange {names[a]} and {names[b]} in {setting}",
                views=(view,),
            )
            return
    yield Finding(
        "shape",
        where,
        f"{where}: the points of {setting} lie {1e3 * math.sqrt(given / points):.2g} mm r.m.s. "
        "beside those that were digitised, more than repeats differ; the bounds rest on these",
        Severity.doubtful,
        float(test.statistic),
        float(test.p_value),
        math.sqrt(given / points),
        f"measure the points of {setting} again",
        views=(view,),
    )


def _misfit(source: Array, destination: Array) -> float:
    """Give the sum of squares that the best rigid motion leaves, m^2."""
    rotation, shift = rigid_transform(source, destination)
    return float(np.sum((source @ rotation.T + shift - destination) ** 2))


def relative_size(points: Array, others: Array) -> float | None:
    """Give how much larger points are than others of the same shape; None for a similar size.

    Parameters
    ----------
    points, others : ndarray, shape (N, 3)
    """
    pairs = np.triu_indices(len(points), 1)
    own, true = (np.linalg.norm(p[pairs[0]] - p[pairs[1]], axis=1) for p in (points, others))
    ratio = own[true > 0] / true[true > 0]
    if len(ratio) < 3:
        return None
    scale = float(np.median(ratio))
    alike = bool((np.abs(ratio / scale - 1) < ALIKE).all())
    return scale if alike and abs(scale - 1) > SCALED else None
