"""Solution at all points and frequencies, block by block.

Matrices are computed once a point and frequencies are right-hand sides, real and imaginary part two
of them. Blocks are as large as fits into the cache, and several run side by side.
"""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sldvexp.reconstruction.least_squares import PointFit
from sldvexp.reconstruction.observability import (
    blank,
    describe,
    determined_components,
    determined_intercept,
    observed_subspace,
)
from sldvexp.reconstruction.result import PointVelocity
from sldvexp.reconstruction.rows import RowSet
from sldvexp.reconstruction.system import (
    GIVEN,
    NOWHERE,
    ROWS,
    VIEWS,
    PointSystem,
    ReconstructionSettings,
)
from sldvexp.reconstruction.views import Views
from sldvexp.statistics import student_factor
from sldvexp.typing import Array, BoolArray

#: Systems whose matrices are computed at once.
SYSTEMS_PER_BLOCK = 8192
#: Real numbers that are multiplied at once: they, the product and the results stay in the cache.
NUMBERS_PER_STEP = 80_000
MOST_THREADS = 4
#: Components of a velocity.
AXES = 3


@dataclass
class _Results:
    """Arrays over all systems that the blocks fill; see `PointVelocity`.

    Standard errors that are the same at all frequencies are there once.
    """

    velocity: NDArray[np.inexact]
    std: Array
    confidence: Array
    squares: Array
    expected_squares: Array
    factor: Array
    dof: Array
    rank: NDArray[np.int_]
    observable: BoolArray
    intercept: NDArray[np.inexact] | None
    intercept_std: Array | None

    @classmethod
    def empty(cls, system: PointSystem, systems: int, frequencies: int) -> _Results:
        views, intercept = system.views, system.intercept
        dtype, errors = views.velocity.dtype, frequencies if views.std is None else 1
        real = np.empty(0, dtype).real.dtype
        return cls(
            velocity=np.empty((systems, 3, frequencies), dtype),
            std=np.empty((systems, 3, errors), real),
            confidence=np.empty((systems, 3, errors), real),
            squares=np.zeros((systems, frequencies), real),
            expected_squares=np.empty(systems),
            factor=np.empty(systems),
            dof=np.empty(systems),
            rank=np.empty(systems, int),
            observable=np.ones((systems, 3), bool),
            intercept=np.empty((systems, frequencies), dtype) if intercept else None,
            intercept_std=np.empty((systems, errors), real) if intercept else None,
        )


def solve(views: Views, rows: RowSet, settings: ReconstructionSettings) -> PointVelocity:
    """Reconstruct the velocity at every point and frequency.

    Matrices are computed once a point, unless std that change with frequency make them differ;
    frequencies are right-hand sides, real and imaginary parts two of them.

    Parameters
    ----------
    settings : ReconstructionSettings
        Which model is fitted, and how.
    """
    system = PointSystem(views, rows, settings)
    points, frequencies = views.velocity.shape[1:]
    each = frequencies if views.std_by_frequency else 1  # systems at a point
    results = _Results.empty(system, points * each, frequencies // each)
    step = max(1, SYSTEMS_PER_BLOCK // each)

    def block(start: int) -> None:
        span = slice(start, min(start + step, points))
        _solve_block(system, span, slice(span.start * each, span.stop * each), results)

    starts = range(0, points, step)
    threads = min(MOST_THREADS, os.cpu_count() or 1, len(starts))
    if threads == 1:
        for start in starts:
            block(start)
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(block, starts))
    return _collect(system, results, each)


def _solve_block(system: PointSystem, points: slice, span: slice, results: _Results) -> None:
    """Fill the results of some points; `span` are their systems."""
    fit = system.fit(points)
    known = system.views.std is not None
    components = system.views.real_components
    dof = components * fit.dof
    results.dof[span], results.rank[span] = dof, fit.rank
    results.expected_squares[span] = components * fit.redundancy
    results.factor[span] = student_factor(
        system.settings.confidence, np.full(len(dof), np.inf) if known else dof
    )
    _apply(fit, system.views, points, span, results)
    if fit.null is None:
        return
    observable = results.observable[span] = determined_components(fit.null)
    for array in (results.velocity, results.std, results.confidence):
        blank(array[span], ~observable)
    if results.intercept is not None and results.intercept_std is not None:
        lost = ~determined_intercept(fit.null)
        blank(results.intercept[span], lost)
        blank(results.intercept_std[span], lost)


def _apply(fit: PointFit, views: Views, points: slice, span: slice, results: _Results) -> None:
    """Compute ``theta = H v`` and ``s = |K v| / sqrt(redundancy)``, a few points at a time."""
    data = views.samples(points)
    real = results.std.dtype
    matrix = np.concatenate([fit.solution, fit.residual], axis=1).astype(real)
    parameters, components = fit.solution.shape[1], views.real_components
    root, factor = fit.root.astype(real), results.factor[span].astype(real)
    expected = results.expected_squares[span]
    per_square = 1 / np.where(expected > 0, expected, np.nan).astype(real)
    step = max(1, NUMBERS_PER_STEP // max(1, data[:, 0].size * components))
    alone = matrix.shape[1] == AXES  # neither residuals nor intercepts: velocities straight away
    product = np.empty((min(step, len(root)), matrix.shape[1], components * data.shape[2]), real)
    for first in range(0, len(root), step):
        part = slice(first, min(first + step, len(root)))
        here = slice(span.start + part.start, span.start + part.stop)
        velocity = _as_real(results.velocity[here])
        whole = product[: part.stop - part.start]
        done = velocity if alone else whole
        with np.errstate(invalid="ignore"):  # looked at next
            np.matmul(matrix[part], np.swapaxes(_as_real(data[:, part]), 0, 1), out=done)
        if not np.all(np.isfinite(done)):
            views.require_finite(points)
        squares = results.squares[here]
        if not alone:
            velocity[...] = whole[:, :AXES]
            squares = _sum_of_squares(whole[:, parameters:], components, out=squares)
        size = 1 if fit.std is not None else np.sqrt(squares * per_square[part, None])[:, None]
        std = np.multiply(root[part, :3, None], size, out=results.std[here])
        np.multiply(std, factor[part, None, None], out=results.confidence[here])
        if results.intercept is not None and results.intercept_std is not None:
            _as_real(results.intercept[here])[...] = done[:, 3]
            results.intercept_std[here] = (root[part, 3:, None] * size)[:, 0]


def _sum_of_squares(left: Array, components: int, out: Array) -> Array:
    """Sum ``|left|^2`` over rows and the real numbers of a sample, shape (system, frequency)."""
    squares = np.einsum("prf,prf->pf", left, left)
    if components == 1:
        out[...] = squares
        return out
    return np.add(squares[:, ::2], squares[:, 1::2], out=out)


def _as_real(data: NDArray[np.inexact]) -> NDArray[np.floating]:
    """View complex numbers as pairs of real ones along the last dimension."""
    return data.view(data.real.dtype)


def _collect(system: PointSystem, results: _Results, each: int) -> PointVelocity:
    """Bring systems back to points, and say in words what could not be determined."""
    fold, frequencies = system.views.fold, system.views.velocity.shape[2]

    def spread(array: Array) -> Array:
        folded = fold(array)
        return np.broadcast_to(folded, (*folded.shape[:-1], frequencies))

    known = system.views.std is not None
    dof = results.dof[::each]
    velocity = PointVelocity(
        velocity=fold(results.velocity),
        std=spread(results.std),
        confidence=spread(results.confidence),
        intercept=None if results.intercept is None else fold(results.intercept),
        intercept_std=None if results.intercept_std is None else spread(results.intercept_std),
        squares=fold(results.squares),
        expected_squares=results.expected_squares[::each],
        dof=dof,
        factor=results.factor[::each],
        observable=results.observable[::each],
        bounded=known | (dof > 0),
        noise_from=_noise_from(system, dof),
        along=None,
        messages=(),
        system=system,
    )
    return _with_flags(velocity, np.flatnonzero(results.rank[::each] < system.parameters))


def _noise_from(system: PointSystem, dof: Array) -> str:
    if system.views.std is not None:
        return GIVEN
    if not np.any(dof > 0):
        return NOWHERE
    return ROWS if system.residual_of_rows else VIEWS


def _with_flags(result: PointVelocity, deficient: NDArray[np.int_]) -> PointVelocity:
    """Add what is determined at deficient points, and the sentences about all flags."""
    system, along = result.system, None
    messages = [result.rows.note] if result.rows.note else []
    if len(deficient):
        noise = result.noise(deficient)
        along = observed_subspace(system, deficient, noise, result.factor[deficient])
        messages.append(describe(along, system))
    unbounded = np.sum(~result.bounded)
    if unbounded:
        count = len(system.views.names)
        leave = f"{count} views leave" if count > 1 else "1 view leaves"
        messages.append(
            f"{leave} no residual at {unbounded} of {len(result.bounded)} points: "
            "no bounds without std or another view"
        )
    return replace(result, along=along, messages=tuple(messages))
