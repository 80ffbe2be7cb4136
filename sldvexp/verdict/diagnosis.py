"""Diagnosis of views that disagree: which view is wrong, and with what kind of mistake.

For every view and every kind of mistake the whole is fitted again, the poses' prior integrated, and
the fits are ranked by ``T/s2 + q ln n`` with q numbers that a kind adds (Schwarz' criterion). A
view's factor c is found from the field of the others: its velocities are turned by ``-arg c`` and
its *design* is scaled by ``|c|`` (scaling the velocities would scale their noise), then steps of
the score. From the quadratic form about c follow the fits with a sign, with r.m.s. instead of peak,
with a gain or a phase alone. A pose is freed by a prior so wide that it does not bind. Another
field, or another frequency, is a view that is left out for a smooth scalar of its own. A view that
is off in no pattern has a noise of its own, or pixels that are not where they are said to be.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from sldvexp.field import View
from sldvexp.lazy import scipy
from sldvexp.typing import Array, ComplexArray, IndexArray
from sldvexp.verdict.comparison import Bench
from sldvexp.verdict.explanation import CONJUGATES, NAMED, POSE, SMALLEST, UNEXPLAINED, Explanation
from sldvexp.verdict.joint_fit import JointFit
from sldvexp.verdict.pixel_data import compared_beams, pixel_data

#: Standard deviations of a freed pose, rotation (rad) and origin (m): of small and of large moves
#: that explain as much the small one is taken.
FREE = np.repeat([0.02, 0.02], 3)
#: Numbers of a pose that are freed when its origin is believed.
ROTATION = np.arange(3)
STEPS = 3
#: Least noise of a view, over the one that it states, that is told from none.
LEAST_NOISE = 0.1
#: Misfit, over that of the stated noise, below which what is left is rounding.
NOISELESS = 1e-9
#: Misfit after an exchange, over that of the other views, above which it explains nothing.
EXCHANGED = 4.0


def diagnose(bench: Bench, fit: JointFit) -> list[Explanation]:
    """Rank explanations of a disagreement, the best first.

    Parameters
    ----------
    fit : JointFit
        Of all views, relinearised.
    """
    found = [Tried(Explanation((), "clean", fit.squares), 0.0, fit.count)]
    others = [bench.without(k) for k in range(len(bench.data))]
    for k, left in enumerate(others):
        found += _of_view(bench, k, left)
    best = min(found, key=lambda t: t.explanation.criterion / t.pixels)
    left_over = best.explanation.criterion / (best.pixels * fit.dof / fit.count)
    if best.explanation.kind in ("pose", "other_field") or left_over > UNEXPLAINED:
        found += _exchanges(bench)
    # No kind that fits leaves more than the noise, whatever noise was stated.
    scale = min(t.explanation.criterion / t.pixels for t in found) * fit.count / fit.dof
    ranked = [t.ranked(bench, fit.channels, max(1.0, scale)) for t in found]
    misfit = scale if bench.stated else 1.0
    ranked = [replace(h, misfit=misfit) for h in ranked]
    least = min(h.criterion for h in ranked)
    for k, left in enumerate(others):
        ranked += _own_noise(k, fit, left, scale, least)
    return sorted(ranked, key=lambda h: h.criterion)


def _own_noise(
    k: int, fit: JointFit, others: JointFit, scale: float, least: float
) -> Iterator[Explanation]:
    """Yield a noise of its own of one view, which no other kind of mistake leaves.

    By ``-2 log L``: the n numbers of a view have the variance v_k and all N - n others v, in place
    of one variance of all, which is what the best other kind leaves. What the view adds to the
    misfit tells v_k: it leaves out what the poses of the others have wrong in common, few numbers
    that a sum of squares over pixels would have for noise. Of its n numbers the view determines q
    of the field by itself, and these have the variance v that the fit counts on:
    ``T - T_-k = q v + (n - q) v_k``.

    Parameters
    ----------
    fit, others : JointFit
        Of all views, and without this one.
    scale, least : float
        That variance, and the criterion of that kind.
    """
    freedom = fit.dof - others.dof
    free = freedom - fit.determined_by(k)
    if free <= 0 or others.dof <= 0:
        return
    even = others.squares / others.dof
    if min(scale, even) <= NOISELESS:
        return
    added = (fit.squares - others.squares) / (freedom * even)
    gained = fit.dof * np.log(scale / even) - freedom * np.log(max(added, LEAST_NOISE**2))
    noise = float(np.sqrt(max(1 + (added - 1) * freedom / free, LEAST_NOISE**2)))
    criterion = float(least - gained + np.log(fit.dof))
    yield Explanation((k,), "own_noise", criterion, noise=noise, misfit=even)


class Tried(NamedTuple):
    """An explanation whose criterion is the sum of squares that it leaves.

    Attributes
    ----------
    numbers : float
        That it adds to the model.
    pixels : int
        That it was fitted to: those whose beams meet the surface.
    """

    explanation: Explanation
    numbers: float
    pixels: int

    def ranked(self, bench: Bench, channels: int, scale: float) -> Explanation:
        """Give the criterion; pixels that left the surface count as those that stayed do."""
        pixels = sum(len(d.pixel) for d in bench.data)
        squares = self.explanation.criterion / scale * pixels / max(self.pixels, 1)
        penalty = self.numbers * np.log(channels * pixels)
        return replace(self.explanation, criterion=float(squares + penalty))


def _of_view(bench: Bench, k: int, others: JointFit) -> Iterator[Tried]:
    """Yield all kinds of mistakes of one view, with the fit of the others."""
    yield _free_pose(bench, k, others, ROTATION)
    yield _free_pose(bench, k, others, np.arange(POSE))
    squares, numbers = _own_scalar(bench, k, others)
    count = others.count + int(others.designs[k].present.sum())
    yield Tried(Explanation((k,), "other_field", others.squares + squares), numbers, count)
    yield _offset(bench, k, others)
    velocity = bench.data[k].velocity
    yield from _factors(bench, k, others, np.conj(velocity), CONJUGATES)
    yield from _factors(bench, k, others, velocity, NAMED)


def _factors(
    bench: Bench, k: int, others: JointFit, values: ComplexArray, named: Mapping[str, float]
) -> Iterator[Tried]:
    """Yield named factors of one view; of velocities as they are, a gain, a phase and both too."""
    squares, c, information = _free_factor(bench, k, others, values)
    std = np.sqrt(np.diag(np.linalg.pinv(information)))
    count = others.count + int(others.designs[k].present.sum())
    found = Explanation((k,), "factor", squares, c, (float(std[0]), float(std[1])))
    for kind, factor in named.items():
        off = np.array([np.log(abs(factor) / abs(c)), np.angle(factor / c)])
        # Of a field without phase a conjugate is nothing: both at once must not tie with a sign.
        numbers = 2 if kind == "conjugate_sign" else 1
        left = squares + float(off @ information @ off)
        yield Tried(replace(found, kind=kind, criterion=left), numbers, count)
    if named is NAMED:
        gain, phase = _alone(information)
        left = squares + phase * np.angle(c) ** 2
        yield Tried(replace(found, kind="gain", criterion=left), 2, count)
        left = squares + gain * np.log(abs(c)) ** 2
        yield Tried(replace(found, kind="phase", criterion=left), 2, count)
        yield Tried(found, 3, count)


def _alone(information: Array) -> tuple[float, float]:
    """Find how much it costs to fix one of two numbers, the other left free (Schur)."""
    a, b, c = information[0, 0], information[0, 1], information[1, 1]
    tiny = np.finfo(float).tiny
    return float(a - b * b / max(c, tiny)), float(c - b * b / max(a, tiny))


def _free_factor(
    bench: Bench, k: int, others: JointFit, values: ComplexArray
) -> tuple[float, complex, Array]:
    """Fit with a complex factor of one view: squares, the factor, its information."""
    design = others.designs[k]
    predicted = _complex(others.predicted(k))
    seen = values[design.present]
    energy = float(np.vdot(predicted, predicted).real)
    c = complex(np.vdot(predicted, seen)) / max(energy, np.finfo(float).tiny)
    if not abs(c) > SMALLEST:
        c = complex(SMALLEST)
    for _ in range(STEPS):
        turned = {k: values * np.exp(-1j * np.angle(c))}
        fit = JointFit(
            bench.data,
            others.designs,
            bench.prior,
            others.standard,
            factor={k: float(abs(c))},
            velocity=turned,
        )
        score = fit.score(k, fit.factor_columns(k))
        step = np.clip(score.estimate, -0.5, 0.5)
        c *= complex((1 + step[0]) * np.exp(1j * step[1]))
    return fit.squares - score.statistic, c, score.information


def _complex(channels: Array) -> ComplexArray:
    """Join real and imaginary channels."""
    real, imaginary = np.split(channels, 2, axis=-1)
    return np.asarray(real + 1j * imaginary)


def _free_pose(bench: Bench, k: int, others: JointFit, free: IndexArray) -> Tried:
    """Fit with some free numbers of a view's pose, the designs taken again at every step.

    The others keep their prior: with its origin known, a turned view is known far better.
    """
    wide, own = widened(bench, k, free), slice(POSE * k, POSE * (k + 1))
    pixels = len(bench.data[k].pixel)
    best = Tried(Explanation((k,), "pose", np.inf, pose=POSE * (0.0,)), 1.0, pixels)
    # Of the others' field and of the fit of all, whichever start leaves less.
    for start in (_first_step(bench, k, others, free), np.zeros(len(free))):
        standard = np.concatenate([others.standard, start / FREE[free]])
        for _ in range(STEPS + 1):
            designs = [*others.designs]
            designs[k] = wide.design(k, wide.prior @ standard)
            if 2 * int(designs[k].present.sum()) < pixels:
                break
            fit = JointFit(wide.data, designs, wide.prior, standard)
            pose = fit.poses[own]
            standard = np.concatenate([others.standard, (standard + fit.step)[-len(free) :]])
            if fit.squares / fit.count < best.explanation.criterion / best.pixels:
                covariance = fit.covariance[own, own]
                known = np.trace(
                    covariance[np.ix_(free, free)] / np.outer(FREE, FREE)[free][:, free]
                )
                numbers = 1 + len(free) - float(known)
                moves = tuple(map(float, pose))
                told = replace(best.explanation, criterion=fit.squares, pose=moves)
                told = replace(told, free=tuple(map(int, free)), covariance=covariance)
                best = Tried(told, numbers, fit.count)
    return best


def _first_step(bench: Bench, k: int, others: JointFit, free: IndexArray) -> Array:
    """Fit some numbers of a view's pose to the field of the others."""
    design = others.designs[k]
    values = bench.data[k].velocity[design.present]
    left = np.concatenate([values.real, values.imag], axis=1) - others.predicted(k)
    columns = design.pose_columns(others.m)[:, free] * FREE[None, free, None]
    flat = columns.transpose(0, 2, 1).reshape(-1, len(free))
    return np.linalg.lstsq(flat, left.ravel(), rcond=1e-3)[0] * FREE[free]


def widened(bench: Bench, k: int, free: IndexArray) -> Bench:
    """Free numbers of a view's pose: their prior no longer binds, nor ties them to others."""
    rows = POSE * k + free
    prior = bench.prior.copy()
    prior[rows] = 0.0
    columns = np.zeros((len(prior), len(rows)))
    columns[rows, np.arange(len(rows))] = FREE[free]
    return replace(bench, prior=np.concatenate([prior, columns], axis=1))


def _own_scalar(bench: Bench, k: int, others: JointFit) -> tuple[float, int]:
    """Fit one view by a smooth scalar alone: squares, and how many numbers that takes."""
    design = others.designs[k]
    basis = design.basis * design.weight[:, None]
    values = bench.data[k].velocity[design.present]
    values = np.concatenate([values.real, values.imag], axis=1)
    normal = basis.T @ basis
    # No pixel may be left, if poses were dragged far off by a view that is wrong.
    normal += (1e-9 * np.trace(normal) / len(normal) or 1.0) * np.eye(len(normal))
    left = values - basis @ scipy.linalg.solve(normal, basis.T @ values, assume_a="pos")
    return float(np.vdot(left, left)), len(normal) * values.shape[1]


def _offset(bench: Bench, k: int, others: JointFit) -> Tried:
    """Fit with a velocity of one view's own that is the same at all its pixels."""
    fit = JointFit(bench.data, others.designs, bench.prior, others.standard)
    weight = others.designs[k].weight
    columns = weight[:, None, None] * np.eye(fit.channels)
    squares = fit.squares - fit.score(k, columns).statistic
    return Tried(Explanation((k,), "offset", squares), fit.channels + 1.0, fit.count)


def _exchanges(bench: Bench) -> Iterator[Tried]:
    """Yield pairs of views whose images are exchanged: each was taken from the other's place.

    All views then agree as well as those do that are not exchanged. One that is wrong in a way
    that no kind explains would else seem exchanged where few of its beams meet the surface.
    """
    for i in range(len(bench.data)):
        for j in range(i):
            rest = [k for k in range(len(bench.data)) if k not in (i, j)]
            others = JointFit(bench.data, bench.as_stated, bench.prior, views=rest)
            views = [d.view for d in bench.data]
            views[i], views[j] = _image_of(views[i], views[j]), _image_of(views[j], views[i])
            beams = [d.beams for d in bench.data]
            beams[i], beams[j] = (compared_beams(views[k], bench.surface) for k in (i, j))
            data, _ = pixel_data(views, beams)
            found = replace(bench, data=data).fit()
            agrees = found.squares * others.dof < EXCHANGED * others.squares * found.dof
            if agrees and 2 * found.count > sum(len(d.pixel) for d in bench.data):
                yield Tried(Explanation((j, i), "exchanged", found.squares), 1.0, found.count)


def _image_of(place: View, other: View) -> View:
    """Give a place the image that another view took."""
    image = {n: getattr(other, n) for n in ("dac", "velocity", "std", "flags", "shape")}
    return replace(place, **image)
