"""Comparison of views at single points: without images only the points themselves can tell.

At every point and frequency ``y_k = D_k . V + e_k``; with more than three views residuals remain,
``r = (1 - H) y``, all divided by their noise. T = sum |r|^2 is a chi-square of two degrees for
every residual direction, and ``|r_k|^2 / (1 - h_kk)``, summed over points and frequencies, one of
two degrees each if view k is as the others: what leaving it out would take off T. All points and
frequencies are tested together, since a mistake of a view is the same in all of them.

A mistake is named by refits: view k against what the others predict, ``p = D_k . V_-k`` with the
variance g, gives ``T_-k + sum |y_k - c p|^2 / (1 + |c|^2 g)`` for a factor c, and the like for a
conjugate, for turned directions, for exchanged views.

A view may be wrong at single points or frequencies alone, a misread number or two points that were
exchanged: then the fit without these values is as good as it should be, for two numbers each.

If whichever view is left out the others still disagree, the noise is larger than stated, or more
than one view is wrong. Then nothing is named by the stated noise, and a view is only rejected if it
is much further off than all others are.

Where no noise is stated, its size is what the refit leaves: with q numbers and n degrees left over,
``F = (T - T_refit) / q / (T_refit / n)`` of every kind, as many times less probable as kinds are
tried. Four views have that test alone, since three always agree.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sldvexp.dataset import Finding
from sldvexp.lazy import scipy
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, BoolArray, ComplexArray, IndexArray
from sldvexp.verdict.explanation import (
    CONJUGATES,
    LEAST_VIEWS,
    NAMED,
    SMALLEST,
    Explanation,
    ViewTests,
    tells_views_apart,
)
from sldvexp.verdict.repairs import Repair, examined_repairs
from sldvexp.verdict.repeated import repeated_views
from sldvexp.verdict.sample_places import SamplePlaces
from sldvexp.verdict.wording import OFF_NOISE, disagreement, noise_finding, unexplained, untested

#: Points and frequencies that are compared; of more, evenly chosen ones.
MOST_SAMPLES = 20_000
#: Least reciprocal condition number of the directions of a sample that is compared.
DETERMINED = 1e-3
STEPS = 8
#: Why views that are enough are not compared.
FEW = "as too few points are seen by enough of them"
#: Single points, lines or values at which a view may be wrong alone, and their part of all at most.
MOST_PLACES, PART = 3, 1 / 3


@dataclass(frozen=True, eq=False)
class PointData:
    """Samples, each a point at a frequency, as all views see them.

    Attributes
    ----------
    directions : ndarray, shape (sample, view, 3)
    velocity : ndarray of complex, shape (sample, view), m/s
    noise : ndarray, shape (sample, view), m/s
        Of real and imaginary part each; infinite where a velocity is missing.
    stated : bool
        True if the noise is known; otherwise it is even, and its size is not.
    places : SamplePlaces
        Which point and frequency every sample is.
    """

    names: tuple[str, ...]
    directions: Array
    velocity: ComplexArray
    noise: Array
    stated: bool
    places: SamplePlaces

    @classmethod
    def from_dataset(cls, line_of_sight: xr.Dataset) -> PointData:
        """Collect the samples of a group ``line_of_sight``."""
        one = line_of_sight["velocity"]
        cases = [d for d in ("point", "frequency") if d in one.dims]
        full = one.transpose("view", *cases)
        shape = full.shape
        values = full.values.reshape(shape[0], -1).T.astype(complex)
        cosines = line_of_sight["direction_cosines"]
        spread = cosines.broadcast_like(one).transpose("view", *cases, "axis")
        directions = np.moveaxis(spread.values.reshape(shape[0], -1, 3), 0, 1)
        stated = "velocity_std" in line_of_sight
        noise = np.ones(values.shape)
        if stated:
            std = line_of_sight["velocity_std"].broadcast_like(one).transpose("view", *cases)
            noise = std.values.reshape(shape[0], -1).T.astype(float)
        missing = ~np.isfinite(values) | ~np.isfinite(noise)
        missing |= ~np.isfinite(directions).all(axis=2)
        directions = np.where(missing[..., None], 0.0, directions)
        values, noise = np.where(missing, 0.0, values), np.where(missing, np.inf, noise)
        stated = stated and bool((noise > 0).all())
        if not stated:
            noise = np.where(missing, np.inf, 1.0)
        step = max(1, int(np.ceil(len(values) / MOST_SAMPLES)))
        names = tuple(str(v) for v in line_of_sight["view"].values)
        places = SamplePlaces.from_coordinates(one, cases)
        found = cls(names, directions, values, noise, stated, places)
        found = found.take(slice(None, None, step))
        return found.take(found.determined)

    def take(self, kept: slice | Array) -> PointData:
        """Keep some samples."""
        return replace(
            self,
            directions=self.directions[kept],
            velocity=self.velocity[kept],
            noise=self.noise[kept],
            places=self.places.take(kept),
        )

    def without(self, k: int, samples: BoolArray) -> PointData:
        """Forget what a view has at some samples."""
        noise, velocity = self.noise.copy(), self.velocity.copy()
        noise[samples, k], velocity[samples, k] = np.inf, 0.0
        return replace(self, noise=noise, velocity=velocity)

    @property
    def determined(self) -> Array:
        """Samples that all views together determine."""
        values = np.linalg.eigvalsh(np.swapaxes(self.design, 1, 2) @ self.design)
        return np.asarray(values[:, 0] > DETERMINED**2 * values[:, -1])

    @cached_property
    def design(self) -> Array:
        """Directions over noise, shape (sample, view, 3)."""
        return self.directions / self.noise[..., None]

    @cached_property
    def white(self) -> ComplexArray:
        """Velocities over noise, shape (sample, view)."""
        return np.asarray(self.velocity / self.noise)

    @property
    def seen(self) -> Array:
        """Samples that a view has, shape (sample, view)."""
        return np.isfinite(self.noise)


@dataclass(frozen=True, eq=False)
class SampleVelocities:
    """Velocities of all samples from some views, by least squares.

    Attributes
    ----------
    velocity : ndarray of complex, shape (sample, 3), m/s
    covariance : ndarray, shape (sample, 3, 3), m2/s2
        Of real and imaginary part each.
    squares : float
        T.
    dof : int
    """

    velocity: ComplexArray
    covariance: Array
    squares: float
    dof: int

    @classmethod
    def of(cls, data: PointData, views: Sequence[int]) -> SampleVelocities:
        """Fit some views; where they do not determine a sample, it is left out."""
        design, white = data.design[:, views], data.white[:, views]
        normal = np.swapaxes(design, 1, 2) @ design
        values, vectors = np.linalg.eigh(normal)
        there = values > DETERMINED**2 * np.maximum(values[:, -1:], np.finfo(float).tiny)
        inverse = np.where(there, 1 / np.where(there, values, 1.0), 0.0)
        covariance = (vectors * inverse[:, None]) @ np.swapaxes(vectors, 1, 2)
        velocity = (covariance @ np.swapaxes(design, 1, 2) @ white[..., None])[..., 0]
        left = white - (design @ velocity[..., None])[..., 0]
        freedom = data.seen[:, views].sum() - there.sum()
        return cls(velocity, covariance, float(np.sum(np.abs(left) ** 2)), 2 * int(freedom))

    def predict(self, directions: Array) -> tuple[ComplexArray, Array]:
        """Predict a view: values (sample,) and their variances, of directions (sample, 3)."""
        value = np.einsum("si,si->s", directions, self.velocity)
        return value, np.einsum("si,sij,sj->s", directions, self.covariance, directions)


def examine_points(
    line_of_sight: xr.Dataset, use_repair: Sequence[str] = ()
) -> tuple[xr.Dataset, list[Finding]]:
    """Compare the views of single points with one another.

    Parameters
    ----------
    line_of_sight : xarray.Dataset
        The group of a run.
    use_repair : sequence of str
        Repairs to take, as ``view_left.sign``.

    Returns
    -------
    xarray.Dataset
        The group, repaired as asked.
    list of Finding

    Raises
    ------
    UserError
        If a repair is named that nothing proposes.

    Examples
    --------
    Five views of a point, the third with the wrong sign:

    >>> import numpy as np
    >>> from sldvexp import dataset
    >>> from sldvexp.verdict import examine_points
    >>> directions = np.array([[6, 0, 8], [-5, 2, 8], [1, 6, 8], [-3, -6, 7], [0, 1, 9.0]])
    >>> directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    >>> velocity = directions @ np.outer([1e-3, 2e-3, 1e-2], np.exp(1j * np.arange(20)))
    >>> velocity[2] *= -1
    >>> group = dataset.group(
    ...     "line_of_sight", {"view": list("abcde"), "frequency": np.arange(20.0)},
    ...     direction_cosines=directions, velocity=velocity,
    ...     velocity_std=np.full(velocity.shape, 1e-5),
    ... )
    >>> [(f.kind, f.subject) for f in examine_points(group)[1]]
    [('sign', 'view c')]
    """

    def examine(groups: dict[str, xr.Dataset]) -> tuple[list[Finding], list[Repair]]:
        return _examine(PointData.from_dataset(groups["line_of_sight"]))

    groups, findings, _ = examined_repairs({"line_of_sight": line_of_sight}, use_repair, examine)
    names = map(str, line_of_sight["view"].values)
    seen = dict(zip(names, line_of_sight["velocity"].transpose("view", ...).values, strict=True))
    return groups["line_of_sight"], [*repeated_views(seen), *findings]


def _examine(data: PointData) -> tuple[list[Finding], list[Repair]]:
    """Test the views, and name one that is wrong."""
    views = len(data.names)
    if views < LEAST_VIEWS or not len(data.white):
        return [untested(views, FEW)], []
    fit = SampleVelocities.of(data, range(views))
    if fit.dof <= 0:
        return [untested(views, FEW)], []
    each = range(views)
    others = [SampleVelocities.of(data, [i for i in each if i != k]) for k in each]
    kinds = _kinds(data, fit, others)
    excess = _excess(others) if data.stated else 1.0
    tests = _tests(data, fit, others, kinds, excess)
    if not tests.rejects:
        noise = noise_finding(tests, of_points=True) if data.stated else None
        return [noise] if noise else [], []
    for k in each:
        kinds += _at_places(data, k, others[k])
    ranked = _ranked(data, kinds, excess)
    if not ranked[0].view:
        return [unexplained(data.names, tests, of_points=True)], []
    best, other = tells_views_apart(ranked)
    finding, repairs = disagreement(data.names, tests, best, other, of_points=True)
    return [finding], repairs


#: An explanation, how many numbers it adds, and the degrees of freedom that it leaves.
Kind = tuple[Explanation, float, int]


def _tests(
    data: PointData,
    fit: SampleVelocities,
    others: Sequence[SampleVelocities],
    kinds: Sequence[Kind],
    excess: float,
) -> ViewTests:
    """Test every view as a whole, by what leaving it out takes off the misfit.

    Without a stated noise by the kinds of mistakes besides. With an `excess` above one the stated
    noise is no measure either.
    """
    statistic, p_value = [], []
    for left in others:
        drop, q = fit.squares - left.squares, fit.dof - left.dof
        if q <= 0:
            statistic.append(0.0)
            p_value.append(1.0)
        elif (data.stated and excess <= 1) or left.dof <= 0:
            statistic.append(drop / q)
            p_value.append(float(scipy.special.chdtrc(q, drop)) if data.stated else 1.0)
        else:
            f = (drop / q) / max(left.squares / left.dof, np.finfo(float).tiny)
            statistic.append(f)
            p_value.append(float(scipy.special.fdtrc(q, left.dof, f)))
    above = float(scipy.special.chdtrc(fit.dof, fit.squares)) if data.stated else 0.5
    statistics = {"whole": np.array(statistic)}
    p_values = {"whole": np.array(p_value)}
    if not data.stated:
        statistics["mistake"], p_values["mistake"] = _mistakes(fit, kinds, len(others))
    return ViewTests(
        statistics,
        p_values,
        fit.squares / fit.dof,
        2 * min(above, 1 - above),
    )


def _excess(others: Sequence[SampleVelocities]) -> float:
    """Give the least misfit that leaving a view out leaves, over its noise; 1 if that is noise."""
    each = [
        (float(scipy.special.chdtrc(o.dof, o.squares)), o.squares / o.dof) for o in others if o.dof
    ]
    p_value, misfit = max(each, default=(1.0, 1.0))
    return misfit if p_value < OFF_NOISE else 1.0


def _mistakes(fit: SampleVelocities, kinds: Sequence[Kind], views: int) -> tuple[Array, Array]:
    """Test every view by the kind of mistake that takes most off the misfit: F and p-value."""
    statistic, p_value = np.zeros(views), np.ones(views)
    tried = np.zeros(views)
    for told, q, _ in kinds:
        n = fit.dof - int(q)
        for k in told.view if n > 0 else ():
            tried[k] += 1
            left = max(told.criterion / n, np.finfo(float).tiny)
            f = (fit.squares - told.criterion) / q / left
            p = float(scipy.special.fdtrc(q, n, max(f, 0.0)))
            if p < p_value[k]:
                statistic[k], p_value[k] = f, p
    return statistic, np.minimum(p_value * tried, 1.0)


def _kinds(
    data: PointData, fit: SampleVelocities, others: Sequence[SampleVelocities]
) -> list[Kind]:
    """Try explanations of all kinds, none among them."""
    found: list[Kind] = [(Explanation((), "clean", fit.squares), 0.0, fit.dof)]
    for k, left in enumerate(others):
        found += _of_view(data, k, left)
    for i in range(len(data.names)):
        for j in range(i):
            swapped = data.velocity.copy()
            swapped[:, [i, j]] = swapped[:, [j, i]]
            tried = SampleVelocities.of(replace(data, velocity=swapped), range(len(data.names)))
            found.append((Explanation((j, i), "exchanged", tried.squares), 1.0, fit.dof))
    return found


def _ranked(data: PointData, found: Sequence[Kind], excess: float) -> list[Explanation]:
    """Rank explanations, the best first."""
    scale = excess
    if not data.stated:
        scale = max(min(h.criterion / max(dof, 1) for h, _, dof in found), np.finfo(float).tiny)
    penalty = float(np.log(2 * max(data.seen.sum(), 2)))
    told = [
        replace(h, criterion=h.criterion / scale + q * penalty, misfit=excess) for h, q, _ in found
    ]
    return sorted(told, key=lambda h: h.criterion)


def _of_view(data: PointData, k: int, left: SampleVelocities) -> Iterator[Kind]:
    """Yield all kinds of mistakes of one view, with the numbers that they add."""
    samples = np.flatnonzero(data.seen[:, k])
    seen, noise = data.velocity[samples, k], data.noise[samples, k]
    own = data.directions[samples, k]
    at = replace(left, velocity=left.velocity[samples], covariance=left.covariance[samples])
    predicted, variance = at.predict(own)
    dof = left.dof + 2 * len(samples)
    yield Explanation((k,), "other_field", left.squares), 2.0 * len(samples), left.dof
    for values, named in ((np.conj(seen), CONJUGATES), (seen, NAMED)):
        for kind, factor in named.items():
            squares = left.squares + _misfit(values, complex(factor), predicted, variance, noise)
            # Of velocities without phase a conjugate is nothing: it must not tie with a sign.
            q = 2.0 if kind == "conjugate_sign" else 1.0
            yield Explanation((k,), kind, squares, complex(factor)), q, dof
        if named is not NAMED:
            continue
        for kind, c in _fitted(values, predicted, variance, noise):
            squares = left.squares + _misfit(values, c, predicted, variance, noise)
            weight = np.sum(np.abs(predicted) ** 2 / (noise**2 + abs(c) ** 2 * variance))
            std = 1 / np.sqrt(max(weight, np.finfo(float).tiny))
            told = Explanation((k,), kind, squares, c, (std, std))
            yield told, 3.0 if kind == "factor" else 2.0, dof
    yield from _directions(data, k, at, left, samples, dof)


def _at_places(data: PointData, k: int, left: SampleVelocities) -> Iterator[Kind]:
    """Yield single points, frequencies and values at which a view may be wrong alone."""
    predicted, variance = left.predict(data.directions[:, k])
    seen = data.seen[:, k]
    variance = np.where(seen, data.noise[:, k] ** 2 + variance, np.inf)
    off = np.abs(data.velocity[:, k] - predicted) ** 2 / variance
    for group, said in data.places.groupings():
        count = np.bincount(group, seen, len(said))
        mean = np.bincount(group, off, len(said)) / np.maximum(count, 1)
        worst = np.argsort(-mean, kind="stable")
        for many in range(1, MOST_PLACES + 1):
            if many > PART * np.count_nonzero(count):
                break
            chosen = worst[:many]
            fit = SampleVelocities.of(
                data.without(k, np.isin(group, chosen)), range(len(data.names))
            )
            told = tuple(said[i] for i in sorted(chosen))
            # Which of them it is was chosen too: a number more of each.
            numbers = 2 * float(count[chosen].sum()) + 2 * many
            yield Explanation((k,), "other_values", fit.squares, places=told), numbers, fit.dof


def _misfit(
    seen: ComplexArray, c: complex, predicted: ComplexArray, variance: Array, noise: Array
) -> float:
    """Compute ``sum |y - c p|^2 / (s^2 + |c|^2 g)``."""
    off = np.abs(seen - c * predicted) ** 2
    return float(np.sum(off / (noise**2 + abs(c) ** 2 * variance)))


def _fitted(
    seen: ComplexArray, predicted: ComplexArray, variance: Array, noise: Array
) -> Iterator[tuple[str, complex]]:
    """Yield the gain, the phase and the factor that fit a view best."""
    c = complex(1.0)
    for _ in range(STEPS):
        weight = 1 / (noise**2 + abs(c) ** 2 * variance)
        power = float(np.sum(weight * (np.abs(predicted) ** 2 - 2 * variance)))
        across = complex(np.sum(weight * np.conj(predicted) * seen))
        if power <= 0:  # all that is predicted is noise
            return
        c = across / power
        if not abs(c) > SMALLEST:
            c = complex(SMALLEST)
    yield "factor", c
    if across.real > 0:
        yield "gain", complex(across.real / power)
    yield "phase", c / abs(c)


def _directions(
    data: PointData,
    k: int,
    at: SampleVelocities,
    left: SampleVelocities,
    samples: IndexArray,
    dof: int,
) -> Iterator[Kind]:
    """Yield directions with a wrong sign along an axis, and turned ones."""
    seen, noise, own = (
        data.velocity[samples, k],
        data.noise[samples, k],
        data.directions[samples, k],
    )
    for axis in range(3):
        flipped = own.copy()
        flipped[:, axis] *= -1
        if np.allclose(flipped, own):
            continue
        predicted, variance = at.predict(flipped)
        squares = left.squares + _misfit(seen, 1.0 + 0j, predicted, variance, noise)
        yield Explanation((k,), "direction", squares), 1.0, dof
    turned = own
    for _ in range(2):  # D turns by w x D: three real numbers for all points
        predicted, variance = at.predict(turned)
        root = 1 / np.sqrt(noise**2 + variance)
        columns = np.cross(turned, at.velocity.real) + 1j * np.cross(turned, at.velocity.imag)
        design = columns * root[:, None]
        right = (seen - predicted) * root
        w = np.linalg.lstsq(
            np.concatenate([design.real, design.imag]),
            np.concatenate([right.real, right.imag]),
            rcond=1e-6,
        )[0]
        turned = turned + np.cross(w, turned)
        turned = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    predicted, variance = at.predict(turned)
    squares = left.squares + _misfit(seen, 1.0 + 0j, predicted, variance, noise)
    yield Explanation((k,), "direction", squares, pose=(*map(float, w), 0.0, 0.0, 0.0)), 3.0, dof
