"""Ellipses fitted to edge points: maximum likelihood or Eq 4.19, outliers, covariance, refusals.

A robust start, the ellipse through five points with the least median distance, tells outliers; the
fit and the rejection then alternate until the same points remain. The likelihood minimises the
orthogonal distances over their standard errors by Gauss-Newton steps.

Estimators work in coordinates moved to the points' mean and scaled by their spread. Around the
origin of the mirrors, thousands of steps away, the columns of Eq 4.19 differ by seven orders of
magnitude and F = 1 weighs the points by where the origin happens to be (an ellipse through it has
F = 0); inside the ellipse F cannot vanish.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.errors import UserError, nearest
from sldvexp.geometry.conic import (
    Ellipse,
    coefficients_jacobian,
    distance_jacobian,
    from_point_conic,
    is_ellipse,
    point_conic,
    semi_axes,
    shape_matrix,
    signed_distance,
)
from sldvexp.statistics import NORMAL_MEDIAN
from sldvexp.typing import Array, BoolArray

#: Residuals below this many steps are rounding.
ROUNDING = 1e-9

#: Rounds of fitting and rejecting; the set of outliers settles within a few.
ROUNDS = 20

#: Least arc, and largest standard error of a semi-axis as a fraction of it.
LEAST_ARC = np.radians(120.0)

LARGEST_STD = 0.1

#: Numbers of an ellipse, hence the least number of edge points.
NUMBERS = 5

#: Sets of five points from which the robust start takes the best.
SUBSETS = 50

#: Sets of points whose robust start is kept: those of the circles of a view.
BEGINNINGS = 32

#: Steps of Gauss-Newton, and the change at which it has settled, in units of the points' spread.
STEPS, SETTLED = 50, 1e-10

#: Smallest cosine between a scan line and the edge's normal for which an error along the line is
#: one across the edge; nearer to tangential the edge's curvature counts.
GRAZING = 0.1

#: Semi-axes beyond this ratio to the points' spread belong to a parabola or a pair of lines.
EXTREME = 1e3


@dataclass(frozen=True, eq=False, repr=False)
class ConicFit:
    """An ellipse and what its edge points say about it.

    Parameters
    ----------
    residual : ndarray, shape (n,), steps
        Orthogonal distance of every edge point, positive outside.
    residual_std : ndarray, shape (n,), steps
        Standard error of each edge point across the edge.
    used : ndarray of bool, shape (n,)
        False for outliers.
    arc : float, rad
        360 deg less the largest gap between neighbouring edge points.
    """

    ellipse: Ellipse
    residual: Array
    residual_std: Array
    used: BoolArray
    arc: float

    def __repr__(self) -> str:
        fit = f"chi-square {self.chi_square:.3g} of {self.dof} degrees of freedom"
        return f"{self.ellipse!r}: {len(self.used)} edge points, {self.outliers} outliers, {fit}"

    @property
    def outliers(self) -> int:
        """Number of edge points that were rejected."""
        return int(np.count_nonzero(~self.used))

    @property
    def dof(self) -> int:
        """Degrees of freedom of `chi_square`."""
        return int(np.count_nonzero(self.used)) - NUMBERS

    @property
    def chi_square(self) -> float:
        """Sum of squared residuals over their variances; expected to be `dof`."""
        return float(np.sum((self.residual / self.residual_std)[self.used] ** 2))


def fit_ellipse(
    position: ArrayLike,
    std: ArrayLike | None = None,
    direction: ArrayLike | None = None,
    *,
    method: str = "likelihood",
    reject: float = 4.0,
    name: str = "the circle",
    start: ConicFit | None = None,
) -> ConicFit:
    """Fit an ellipse through edge points, with outliers rejected.

    Parameters
    ----------
    position : array_like, shape (n, 2), steps
    std : array_like, broadcastable to (n,), steps, optional
        Standard error of each point. Without it all are equal and their size is estimated from the
        residuals; the least number of points is then six instead of five.
    direction : array_like, shape (n, 2), optional
        Unit vectors of the scan lines, along which the errors are.
    method : str
        ``likelihood``: least squares of the orthogonal distances over their standard errors.
        ``algebraic``: least squares of Eq 4.19, weighted by the standard errors.
    reject : float
        Points farther from the ellipse than this many standard errors are outliers.
    name : str
        Name of the circle in messages.
    start : ConicFit, optional
        Of the same points, a little elsewhere; its ellipse and its outliers are where this fit
        begins.

    Raises
    ------
    UserError
        If the points are too few, fit a hyperbola, cover too short an arc or leave the ellipse
        undetermined; it names the circle and says what was seen.

    Examples
    --------
    >>> turn = np.linspace(0.0, 6.0, 9)
    >>> edge = np.stack([900 + 40 * np.cos(turn), -700 + 25 * np.sin(turn)], axis=-1)
    >>> fit = fit_ellipse(edge, std=0.1)
    >>> fit.ellipse.centre.round(6).tolist(), fit.ellipse.semi_axes.round(6).tolist()
    ([900.0, -700.0], [40.0, 25.0])
    """
    if method not in METHODS:
        raise UserError(f"there is no conic fit {method}; {nearest(method, METHODS)}")
    place = np.asarray(position, float).reshape(-1, 2)
    n, least = len(place), NUMBERS + (std is None)
    if n < least:
        raise UserError(f"{name}: an ellipse needs {least} edge points or more, not {n}")
    error = np.broadcast_to(1.0 if std is None else np.asarray(std, float), (n,))
    _check_numbers(place, error, name)
    arc = _check_arc(place, name)
    mean, scale = place.mean(axis=0), float(np.sqrt(place.var(axis=0).sum()))
    along = None if direction is None else np.asarray(direction, float)
    points = ScaledPoints((place - mean) / scale, error / scale, along)
    try:
        begin = None if start is None else _scaled(start, mean, scale)
        parameters, used = _without_outliers(points, method, reject, std is not None, begin)
    except NoEllipseError:
        seen = _seen(place, arc)
        raise UserError(
            f"{name}: its {seen}, fit a hyperbola, not an ellipse; look whether they belong to one "
            f"circle and go around it"
        ) from None

    distance, normal = signed_distance(points.position, parameters)
    across = points.across(normal)
    variance = 1.0
    if std is None:
        dof = np.count_nonzero(used) - NUMBERS
        variance = max(float(np.sum((distance / across)[used] ** 2)) / dof, ROUNDING**2)
    unit = _unit(scale)
    change = unit[:, None] * gain(points[used], normal[used], parameters, method)
    shifted = unit * parameters + np.array([*mean, 0.0, 0.0, 0.0])
    ellipse = Ellipse(shifted, variance * change @ change.T)
    _check_determined(ellipse, _seen(place[used], arc), name)
    return ConicFit(ellipse, scale * distance, np.sqrt(variance) * scale * across, used, arc)


def _unit(scale: float) -> Array:
    """Give the five numbers of an ellipse in units of a spread of points."""
    return np.array([scale, scale, scale**2, scale**2, scale**2])


def _scaled(fit: ConicFit, mean: Array, scale: float) -> tuple[Array, BoolArray]:
    """Give an ellipse in units of the points' spread, relative to their mean; which it used."""
    return (fit.ellipse.parameters - np.array([*mean, 0.0, 0.0, 0.0])) / _unit(scale), fit.used


def _without_outliers(
    points: ScaledPoints,
    method: str,
    reject: float,
    known: bool,
    begin: tuple[Array, BoolArray] | None,
) -> tuple[Array, BoolArray]:
    """Fit, reject what is far, fit again, until the same points remain.

    A point within `reject` of its known standard error is never an outlier, however well the
    others fit. One that is left out is judged by that and by how well the others tell the ellipse
    there: of few points those that count at all would else not come back.
    """
    least = 1.0 if known else ROUNDING
    if begin is None:
        parameters = least_quantile(points.position)
        used = _near(points, parameters, reject, least)
    else:
        parameters, used = begin
    for _ in range(ROUNDS):
        parameters = METHODS[method](points[used], parameters)
        near = _near(points, parameters, reject, least, used)
        if np.array_equal(near, used):
            break
        used = near
    return parameters, used


def _near(
    points: ScaledPoints,
    parameters: Array,
    reject: float,
    least: float,
    used: BoolArray | None = None,
) -> BoolArray:
    distance, normal = signed_distance(points.position, parameters)
    across = points.across(normal)
    size = np.abs(distance) / across
    spread = max(float(quantile(size)) / NORMAL_MEDIAN, least)
    if used is not None:
        rows = distance_jacobian(normal, parameters) / across[:, None]
        ellipse = np.linalg.pinv(rows[used].T @ rows[used])
        size = np.where(used, size, size / np.sqrt(1 + np.sum(rows @ ellipse * rows, axis=1)))
    return size <= reject * spread


def _check_numbers(position: Array, std: Array, name: str) -> None:
    bad = ~np.isfinite(position).all(axis=-1)
    if bad.any():
        raise UserError(f"{name}: the position of edge point {np.argmax(bad)} must be finite")
    bad = ~(np.isfinite(std) & (std > 0))
    if bad.any():
        raise UserError(
            f"{name}: the standard error of edge point {np.argmax(bad)} must be a positive number "
            f"of steps, not {std[bad][0]:.3g}"
        )


def _check_arc(position: Array, name: str) -> float:
    """Measure the arc that the points cover, seen from the best circle, which always exists."""
    away = position - position.mean(axis=0)
    design = np.column_stack([2.0 * away, np.ones(len(away))])
    solution, _, rank, _ = np.linalg.lstsq(design, (away**2).sum(axis=-1), rcond=None)
    if rank < 3:
        raise UserError(
            f"{name}: its {_seen(position, 0.0)}, lie on one line; no ellipse fits them"
        )
    y, x = (away - solution[:2]).T[::-1]
    turn = np.sort(np.arctan2(y, x))
    gaps = np.diff(turn, append=turn[0] + 2 * np.pi)
    arc = float(2 * np.pi - gaps.max())
    if arc < LEAST_ARC:
        raise UserError(
            f"{name}: its {_seen(position, arc)}, go round too little of it, an ellipse needs "
            f"{np.degrees(LEAST_ARC):.0f} deg or more; scan lines that cross the rest of its edge"
        )
    return arc


def _check_determined(ellipse: Ellipse, seen: str, name: str) -> None:
    relative = float(np.max(ellipse.semi_axes_std / ellipse.semi_axes))
    if not relative <= LARGEST_STD:
        raise UserError(
            f"{name}: its {seen}, leave a semi-axis uncertain by {100 * relative:.0f} %, more than "
            f"{100 * LARGEST_STD:.0f} %; scan more lines across its edge"
        )


def _seen(position: Array, arc: float) -> str:
    low, high = position.min(axis=0), position.max(axis=0)
    return (
        f"{len(position)} edge points, over {np.degrees(arc):.0f} deg of arc and between steps "
        f"({low[0]:.0f}, {low[1]:.0f}) and ({high[0]:.0f}, {high[1]:.0f})"
    )


class NoEllipseError(Exception):
    """Points that fit a hyperbola or a parabola."""


@dataclass(frozen=True, eq=False)
class ScaledPoints:
    """Edge points in units of their spread, relative to their mean.

    Parameters
    ----------
    position : ndarray, shape (n, 2)
    std : ndarray, shape (n,)
        Standard error along the scan line.
    direction : ndarray, shape (n, 2), or None
        Unit vector of the scan line; without it the error is the same in every direction.
    """

    position: Array
    std: Array
    direction: Array | None

    def __getitem__(self, used: BoolArray) -> ScaledPoints:
        direction = None if self.direction is None else self.direction[used]
        return ScaledPoints(self.position[used], self.std[used], direction)

    def across(self, normal: Array) -> Array:
        """Give the standard error across an edge with these normals, shape (n,)."""
        if self.direction is None:
            return self.std
        cosine = np.abs((normal * self.direction).sum(axis=-1))
        return self.std * np.maximum(cosine, GRAZING)


def algebraic_conic(position: Array, std: ArrayLike = 1.0) -> Array:
    """Least-squares solution of Eq 4.19, rows over the points' standard errors.

    Parameters
    ----------
    position : ndarray, shape (..., n, 2)
        Relative to a point inside the ellipse.
    std : array_like, broadcastable to (..., n)

    Returns
    -------
    ndarray, shape (..., 3, 3)
        The matrix of Eq 4.22 with F = 1.
    """
    weight = 1.0 / np.broadcast_to(std, position.shape[:-1])
    rows = weight[..., None] * _data(position)
    found: Array = -(np.linalg.pinv(rows) @ weight[..., None])[..., 0]
    return _conic(found)


def _conic(numbers: Array) -> Array:
    """Make the matrix of Eq 4.22 with F = 1 of A to E, shape (..., 3, 3)."""
    a, b, c, d, e = np.moveaxis(numbers, -1, 0)
    matrix = [[a, c / 2, d / 2], [c / 2, b, e / 2], [d / 2, e / 2, np.ones_like(a)]]
    return np.stack([np.stack(row, axis=-1) for row in matrix], axis=-2)


def _through(position: Array) -> Array:
    """Make the conics through sets of five points, shape (..., 3, 3)."""
    try:
        found = np.linalg.solve(_data(position), np.full((*position.shape[:-1], 1), -1.0))
    except np.linalg.LinAlgError:  # of points that coincide
        return algebraic_conic(position)
    return _conic(np.asarray(found[..., 0], float))


def algebraic(points: ScaledPoints, start: Array) -> Array:
    """Estimate five numbers by Eq 4.19; `start` only tells how scan lines cross the edge."""
    _, normal = signed_distance(points.position, start)
    return _ellipse(from_point_conic(algebraic_conic(points.position, points.across(normal))))


def likelihood(points: ScaledPoints, start: Array) -> Array:
    """Estimate five numbers by least squares of orthogonal distances over standard errors.

    Gauss-Newton; a step that leaves the ellipses is halved until it does not. It has settled once
    the next step, which is taken as smaller by as much as this one is, would change nothing.
    """
    parameters, before = start, 1.0
    for _ in range(STEPS):
        distance, normal = signed_distance(points.position, parameters)
        weight = 1.0 / points.across(normal)
        jacobian = weight[:, None] * distance_jacobian(normal, parameters)
        step = -np.linalg.lstsq(jacobian, weight * distance, rcond=None)[0]
        while not is_ellipse(parameters + step) and np.abs(step).max() > SETTLED:
            step /= 2.0
        parameters = _ellipse(parameters + step)
        size = float(np.abs(step).max())
        if size * min(size / before, 1.0) < SETTLED:
            return parameters
        before = size
    raise NoEllipseError


#: The conic fits by name.
METHODS: dict[str, Callable[[ScaledPoints, Array], Array]] = {
    "likelihood": likelihood,
    "algebraic": algebraic,
}


def gain(points: ScaledPoints, normal: Array, parameters: Array, method: str) -> Array:
    """Differentiate the five numbers by each point's error in standard errors, shape (5, n).

    Of the likelihood, the pseudoinverse of the distances' derivative; of Eq 4.19, where a point
    that moves by d across the edge changes its row by ``|gradient| d``, that of [Data].
    """
    weight = 1.0 / points.across(normal)
    if method == "likelihood":
        jacobian = weight[:, None] * distance_jacobian(normal, parameters)
        return np.asarray(np.linalg.pinv(jacobian))
    conic = point_conic(parameters)
    homogeneous = np.concatenate([points.position, np.ones_like(normal[:, :1])], axis=-1)
    gradient = 2.0 * (homogeneous @ conic)[:, :2] / conic[2, 2]
    by_row = np.linalg.pinv(weight[:, None] * _data(points.position))
    by_coefficient = np.linalg.inv(coefficients_jacobian(parameters))
    change: Array = by_coefficient @ by_row * np.linalg.norm(gradient, axis=-1)
    return change


def least_quantile(position: Array) -> Array:
    """Find the ellipse through five points that has the least median distance from all others.

    One point comes from each fifth of the turn about the mean, so that every ellipse is well
    determined; the members follow an additive recurrence, spread evenly and the same every time.
    Errors do not count, so that fits of the same points with other errors begin at the same.
    """
    return _least_quantile(position.shape, position.tobytes()).copy()


@lru_cache(maxsize=BEGINNINGS)
def _least_quantile(shape: tuple[int, ...], content: bytes) -> Array:
    position = np.frombuffer(content).reshape(shape)
    turn = np.argsort(np.arctan2(position[:, 1], position[:, 0]))
    sectors = np.array_split(turn, NUMBERS)
    fraction = np.outer(np.arange(SUBSETS), np.sqrt([2.0, 3.0, 5.0, 7.0, 11.0])) % 1.0
    member = [s[(f * len(s)).astype(int)] for s, f in zip(sectors, fraction.T, strict=True)]
    subset = position[np.stack(member, axis=-1)]
    conics = np.concatenate([_through(subset), algebraic_conic(position)[None]])
    candidates = from_point_conic(conics)
    candidates = candidates[np.isfinite(candidates).all(axis=-1) & is_ellipse(candidates)]
    if not len(candidates):
        raise NoEllipseError
    away = position - candidates[:, None, :2]
    pull = away @ np.linalg.inv(shape_matrix(candidates))
    radius = np.sqrt((away * pull).sum(axis=-1))
    distance = np.abs(radius - 1.0) * radius / np.linalg.norm(pull, axis=-1)
    best: Array = candidates[np.argmin(quantile(distance))]
    return best


def quantile(size: Array) -> Array:
    """Take a median of residuals that does not count those which the five numbers make small."""
    rank = (size.shape[-1] + NUMBERS + 1) // 2 - 1
    return np.asarray(np.sort(size, axis=-1)[..., rank])


def _data(position: Array) -> Array:
    """Make the matrix [Data] of Eq 4.20, shape (..., n, 5)."""
    x, y = np.moveaxis(position, -1, 0)
    return np.stack([x**2, y**2, x * y, x, y], axis=-1)


def _ellipse(parameters: Array) -> Array:
    if not is_ellipse(parameters):
        raise NoEllipseError
    larger, smaller = semi_axes(parameters)
    if not (larger < EXTREME and smaller > 1.0 / EXTREME):
        raise NoEllipseError
    return parameters
