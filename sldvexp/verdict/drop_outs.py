"""Pixels that dropped out without a flag, and patches at rest where there is a hole.

Isolated drop-outs need no other view. A quadratic through a pixel's nearest neighbours, fitted
with Cauchy's weights, predicts it; ``d2 = sum |y - prediction|^2 / (s^2 (1 + h))`` over all
frequencies, h the leverage of the place, is a chi-square of a good pixel. A hole deceives its
neighbours, and all views agree on it; it shows as a patch that does not move while what surrounds
it does. What both leave is found by a robust fit of the smooth field to all views, after the views
have been tested: a wrong view must never be taken apart pixel by pixel.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sldvexp.field import View
from sldvexp.image.interpolation.standing_in import AROUND, quadratic
from sldvexp.lazy import scipy
from sldvexp.typing import Array, BoolArray, IndexArray
from sldvexp.verdict.beams import MeasuredSurface, PixelBeams
from sldvexp.verdict.joint_fit import JointFit, PixelDesign
from sldvexp.verdict.pixel_data import PixelData, local_std
from sldvexp.verdict.smooth_field import SmoothField

#: Neighbours that predict a pixel, and reweightings of their fit.
NEIGHBOURS, PASSES = 24, 6
#: How often what is left is judged, without the pixels that were found.
AGAIN = 4
#: Pixels whose neighbours are in memory together.
TOGETHER = 4096
#: Probability of flagging any good pixel of an image.
ANY = 0.01
#: How far, over their r.m.s. distance, the middle of the neighbours may be from a pixel: at a rim
#: they lie on one side, and a quadratic that leaves the field there tells nothing.
ONE_SIDED = 0.25
#: Misfit over the median velocity that a smooth image may have at its rim.
HARMLESS = 0.3
#: Pixels between the knots of a smooth image, and most knots along a side.
PIXELS_A_KNOT, MOST_KNOTS = 5.0, 8
#: Residual, in standard errors, of which Cauchy's weight is one half.
HALF = 2.5
#: Probability above which a pixel may be at rest. Of 16 sessions of a panel, four to six views, 21
#: to 41 pixels a side, one to four lines, no good pixel of 42,527 was taken for one at rest and all
#: of a hole of 40 x 40 mm were.
AT_REST = 1e-4
#: How much stronger than a pixel at rest the rim of a hole moves.
RIM = 10.0
#: Pixels around one, itself among them, that are at rest together.
PATCH = 9
#: Pixels beyond the surface from which its rim is interpolated: a corner of a cell, its neighbour,
#: and what stands in for that if it dropped out.
REACH = 2 + AROUND
#: Misfit over the median velocity of pixels that are alike.
SLIGHT = 0.1
#: Pixels alike around one beside the surface; a corner of a wall or a plate has no more.
ALIKE = 2
#: Probability below which pixels beyond `FAR` standard errors are more than chance gives.
CHANCE = 1e-4
FAR = 5.0
#: Pixels of all views whose median misfit is the scale of the one in their middle.
AROUND_ONE = 49
#: Reweightings of the robust fit by Huber's and by Tukey's function.
HUBER, TUKEY = 3, 4


def used_pixels(view: View, surface: MeasuredSurface) -> IndexArray:
    """Find the usable pixels that samples of the volume may be interpolated from.

    They are those whose beams meet the lowest or the highest layer, and those around.
    """
    usable = np.flatnonzero(view.usable)
    ends = np.unique(surface.prisms.depth[[0, -1]])
    met = [PixelBeams.trace(view, surface.raised(depth), usable).pixel for depth in ends]
    inside = np.isin(usable, np.concatenate(met))
    if not inside.any() or len(usable) <= PATCH:
        return usable[inside]
    near = scipy.spatial.cKDTree(view.dac[usable]).query(view.dac[usable], PATCH)[1]
    for _ in range(REACH):
        inside |= inside[near].any(axis=1)
    return usable[inside]


def drop_outs(view: View, among: IndexArray, met: IndexArray | None = None) -> BoolArray:
    """Find pixels that their neighbours do not predict, shape (pixel,).

    Those that are found judge no others: the rest is judged again without them.

    Parameters
    ----------
    among : ndarray of int
        Usable pixels that are judged; no other judges.
    met : ndarray of int, optional
        Those of them whose beams meet the surface. Others may be beside the structure, where the
        image is not smooth: they are kept if pixels around them are alike.
    """
    found = np.zeros(len(view.dac), bool)
    on_it = np.ones(len(view.dac), bool) if met is None else np.isin(np.arange(len(found)), met)
    among = np.sort(among)
    for _ in range(AGAIN):
        left = among[~found[among]]
        unlike = left[_unlike(view, left)]
        alike = _alike(view, left, unlike[~on_it[unlike]])
        unlike = np.setdiff1d(unlike, alike)
        if not len(unlike):
            break
        found[unlike] = True
    return found


def _unlike(view: View, among: IndexArray) -> BoolArray:
    """Find which of some pixels the others do not predict, shape (among,)."""
    values, std = _channels(view, among)
    dac = view.dac[among]
    if len(among) <= 2 * NEIGHBOURS or not std.all() or not np.ptp(dac, axis=0).all():
        return np.zeros(len(among), bool)
    _, near = scipy.spatial.cKDTree(dac).query(dac, NEIGHBOURS + 1)
    channels = values.shape[1]
    off = np.concatenate(
        [
            _off_neighbours(dac, values, std, some, near[some, 1:])
            for some in (slice(k, k + TOGETHER) for k in range(0, len(dac), TOGETHER))
        ]
    )
    sided = np.isnan(off)
    squares = np.where(sided, _off_spline(dac, values / std, sided), off)
    # Where pixels around are not predicted either, the prediction is to blame.
    around = np.median(squares[near[:, 1:PATCH]], axis=1) / scipy.special.chdtri(channels, 0.5)
    limit = scipy.special.chdtri(channels, ANY / len(among))
    return np.asarray(squares > limit * np.maximum(1.0, around))


def _alike(view: View, among: IndexArray, some: IndexArray) -> IndexArray:
    """Find which of some pixels are as several around them, or between two opposite ones.

    At a rim an image has a kink, on either side of which a pixel may be: it has any share of both.
    Of 360 spoiled pixels beside a plate that moves seven times as fast 282 are found, for 295 of
    the mean alone; of those as fast as the plate all but one.
    """
    if not len(some):
        return some
    values, std = _channels(view, among)
    dac, place = view.dac[among], np.searchsorted(among, some)
    near = scipy.spatial.cKDTree(dac).query(dac[place], PATCH)[1][:, 1:]
    away, noise = dac[near] - dac[place, None], std[place, None]
    limit = scipy.special.chdtri(values.shape[1], ANY / len(among))
    limit = max(limit, SLIGHT**2 * float(np.median(np.sum((values / std) ** 2, axis=1))))
    one, other = np.triu_indices(near.shape[1], 1)
    middle = np.linalg.norm(away[:, one] + away[:, other], axis=2)
    opposite = middle < 0.5 * np.linalg.norm(away[:, one] - away[:, other], axis=2)
    own, around = values[place, None], values[near]
    as_one = np.sum(((own - around) / noise) ** 2, axis=2) / 2.0 < limit
    first, second = (own - around[:, one]) / noise, (around[:, other] - around[:, one]) / noise
    length = np.maximum(np.sum(second**2, axis=2), np.finfo(float).tiny)
    share = np.clip(np.sum(first * second, axis=2) / length, 0.0, 1.0)[..., None]
    variance = 1.0 + (1.0 - share[..., 0]) ** 2 + share[..., 0] ** 2
    as_two = np.sum((first - share * second) ** 2, axis=2) / variance < limit
    return some[(as_one.sum(axis=1) >= ALIKE) | (as_two & opposite).any(axis=1)]


def _channels(view: View, pixels: IndexArray) -> tuple[Array, Array]:
    """Collect velocities of some pixels, real then imaginary, with their standard errors."""
    values, std = view.velocity[pixels], local_std(view, pixels)
    return np.concatenate([values.real, values.imag], axis=1), np.concatenate([std, std], axis=1)


def _off_neighbours(dac: Array, values: Array, std: Array, some: slice, near: IndexArray) -> Array:
    """Compare some pixels with the robust quadratic through their neighbours: d2.

    Velocities are compared as they are and misfits divided by their noise afterwards: the noise
    that is stated of a pixel is an estimate, and changes from one to the next. Where neighbours
    do not follow their quadratic either, all misfits are divided by theirs; one-sided neighbours
    tell nothing, which is NaN.
    """
    noise = std[some, None]
    away = dac[near] - dac[some, None]
    size = np.sqrt(np.mean(away**2, axis=(1, 2), keepdims=True))
    design = quadratic(away / np.maximum(size, np.finfo(float).tiny))
    weight, seen = np.ones(near.shape), values[near]
    for _ in range(PASSES):
        weighted = weight[..., None] * design
        normal = np.swapaxes(weighted, 1, 2) @ design
        normal += 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] * np.eye(6)
        fitted = np.linalg.solve(normal, np.swapaxes(weighted, 1, 2) @ seen)
        left = np.mean(((seen - design @ fitted) / noise) ** 2, axis=2)
        typical = np.maximum(np.median(left, axis=1, keepdims=True), 1.0)
        weight = 1.0 / (1.0 + left / (HALF**2 * typical))
    # Of the neighbours' own noise, by which the prediction at the pixel varies.
    first = np.linalg.solve(normal, np.eye(6)[:, :1])
    leverage = np.sum((weighted @ first)[..., 0] ** 2, axis=1)
    off = np.sum(((values[some] - fitted[:, 0]) / noise[:, 0]) ** 2, axis=1) / (1.0 + leverage)
    sided = np.linalg.norm(away.mean(axis=1), axis=1) > ONE_SIDED * size[:, 0, 0] * np.sqrt(2)
    return np.asarray(np.where(sided, np.nan, off / typical[:, 0]))


def _off_spline(dac: Array, white: Array, rim: BoolArray) -> Array:
    """Compare every pixel with a robust smooth image of its view alone: d2.

    Misfits are divided by those of the rim, where the smooth image is least sure, if it fits there
    worse than the noise; misfits that are small beside the velocities are the smooth image's own.
    """
    place = np.concatenate([dac, np.zeros((len(dac), 1))], axis=1)
    intervals = int(np.clip(np.sqrt(len(dac)) / PIXELS_A_KNOT, 2, MOST_KNOTS))
    design = SmoothField.on(place, intervals).values(place)
    channels, weight = white.shape[1], np.ones(len(dac))
    median = scipy.special.chdtri(channels, 0.5)
    for turn in range(HUBER + TUKEY):
        weighted = weight[:, None] * design
        normal = weighted.T @ design
        normal += 1e-9 * np.trace(normal) / len(normal) * np.eye(len(normal))
        inverse = np.linalg.inv(normal)
        left = white - design @ (inverse @ (weighted.T @ white))
        leverage = np.clip(weight * np.sum((design @ inverse) * design, axis=1), 0.0, 0.9)
        squares = np.sum(left**2, axis=1) / (1.0 - leverage)
        typical = max(np.median(squares), np.median(squares[rim]) if rim.any() else 0.0)
        scale = max(1.0, float(np.sqrt(typical / median)))
        weight = _weights(np.sqrt(squares), scale, channels, turn)
    harmless = squares < HARMLESS**2 * np.median(np.sum(white**2, axis=1))
    return np.asarray(np.where(harmless, 0.0, squares / scale**2))


def _weights(distance: Array, scale: float, channels: int, turn: int) -> Array:
    """Weigh pixels by Huber's function in the first turns, by Tukey's in the others."""
    soft = scale * np.sqrt(scipy.special.chdtri(channels, 0.05))
    hard = scale * np.sqrt(scipy.special.chdtri(channels, 1e-5))
    if turn < HUBER:
        return np.asarray(np.minimum(1.0, soft / np.maximum(distance, np.finfo(float).tiny)))
    return np.asarray(np.maximum(0.0, 1 - (distance / hard) ** 2) ** 2)


def resting(view: View, among: IndexArray) -> BoolArray:
    """Find patches that do not move while what surrounds them does, shape (pixel,).

    Parameters
    ----------
    among : ndarray of int
        Usable pixels whose beams meet the surface. What is beside it may be a wall at rest.
    """
    found = np.zeros(len(view.dac), bool)
    values, std = _channels(view, among)
    if len(among) <= 2 * NEIGHBOURS or not std.all():
        return found
    squares, channels = np.sum((values / std) ** 2, axis=1), values.shape[1]
    limit = scipy.special.chdtri(channels, AT_REST)
    tree = scipy.spatial.cKDTree(view.dac[among])
    _, near = tree.query(view.dac[among], NEIGHBOURS + 1)
    still = squares < limit
    core = still[near[:, :PATCH]].all(axis=1)
    patch = core[near[:, :PATCH]].any(axis=1) & still  # opened: thin nodal lines are no patches
    grown = patch[near[:, :PATCH]].any(axis=1)
    for one in _connected(grown, near[:, :PATCH]):
        rim = np.setdiff1d(near[one].ravel(), one)
        if _should_move(view.dac[among], values / std, one, rim, RIM * limit):
            found[among[one[still[one]]]] = True  # the rim moves: it is no part of the hole
    return found


def _should_move(
    dac: Array, white: Array, patch: IndexArray, rim: IndexArray, limit: float
) -> bool:
    """Tell whether what surrounds a patch, continued into it, moves there.

    That tells a hole from a nodal line, where a quadratic through the rim is at rest as well. A
    patch that is not surrounded is none: nothing is continued to one side.
    """
    if len(rim) < NEIGHBOURS:
        return False
    middle, size = dac[rim].mean(axis=0), np.sqrt(np.mean(np.ptp(dac[rim], axis=0) ** 2)) / 2
    if np.linalg.norm(dac[patch].mean(axis=0) - middle) > ONE_SIDED * size:
        return False
    design, into = (quadratic((dac[of] - middle) / size) for of in (rim, patch))
    continued = into @ np.linalg.lstsq(design, white[rim], rcond=None)[0]
    return bool(np.median(np.sum(continued**2, axis=1)) > limit)


def _connected(marked: BoolArray, near: IndexArray) -> list[IndexArray]:
    """Take marked pixels apart into patches of neighbours."""
    at = np.flatnonzero(marked)
    if not len(at):
        return []
    place = np.full(len(marked), -1)
    place[at] = np.arange(len(at))
    row = np.repeat(np.arange(len(at)), near.shape[1])
    column = place[near[at]].ravel()
    kept = column >= 0
    graph = scipy.sparse.csr_array(
        (np.ones(kept.sum()), (row[kept], column[kept])), shape=(len(at), len(at))
    )
    count, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    return [at[label == i] for i in range(count)]


def disagreeing(fit: JointFit, pointing: Sequence[float]) -> list[BoolArray]:
    """Find pixels that the field of all views does not fit, for each view's present ones.

    Weights by Huber's function, then by Tukey's; errors of the poses are taken out before. A pixel
    that ends without weight is not fitted.

    Parameters
    ----------
    pointing : sequence of float, rad
        Standard deviation of every view's mirrors beside where they were sent.
    """
    away, weights = _misfits(fit, fit, pointing), []
    for turn in range(HUBER + TUKEY):
        weights = [_weights(d, 1.0, fit.channels, turn) for d in away]
        away = _misfits(_weighted(fit, weights), fit, pointing)
    return [w == 0 for w in weights]


def disagree(fit: JointFit, pointing: Sequence[float]) -> bool:
    """Tell whether more pixels than chance gives are far off the field of all views."""
    away = np.concatenate(_misfits(fit, fit, pointing))
    chance = 2 * scipy.special.ndtr(-FAR)
    far = int(np.sum(away**2 > scipy.special.chdtri(fit.channels, chance)))
    return bool(scipy.special.pdtrc(far - 1, len(away) * chance) < CHANCE)


def _weighted(fit: JointFit, weights: Sequence[Array]) -> JointFit:
    """Fit again with weights of the pixels, at the same designs."""
    designs, data = [], []
    for design, of, weight in zip(fit.designs, fit.data, weights, strict=True):
        root = np.sqrt(weight)
        designs.append(replace_weight(design, root))
        velocity = of.velocity.copy()
        velocity[design.present] *= root[:, None]
        data.append(replace(of, velocity=velocity))
    return JointFit(data, designs, fit.prior, fit.standard, fit.views)


def replace_weight(design: PixelDesign, root: Array) -> PixelDesign:
    """Multiply the rows of a design."""
    return replace(design, field=design.field * root[:, None], weight=design.weight * root)


def _misfits(weighted: JointFit, fit: JointFit, pointing: Sequence[float]) -> list[Array]:
    """Compute how far every pixel is from a weighted fit, in standard errors, shape (present,).

    Where the mirrors point beside a pixel its velocity is off by as much as the image is steep,
    ``1 + s^2 (g_1 g_1' + g_2 g_2')`` in whitened numbers. What the smooth field does not follow
    pixels of all views around have as well: the scale is the noise, or the median of all, or that
    of those around on the surface, whichever is largest. A group of spoiled pixels is one view's.
    """
    found, median = [], np.sqrt(scipy.special.chdtri(fit.channels, 0.5))
    for k, design in enumerate(fit.designs):
        shift = weighted.shift[weighted.places(k)]
        columns = design.pose_columns(weighted.m)
        left = fit.velocity(k) - design.field @ weighted.m
        left -= np.einsum("nqc,q->nc", columns, shift)
        found.append(np.sqrt(_beside_pointing(left, pointing[k] * columns[:, :2])))
    away = np.concatenate(found)
    point = np.concatenate([design.beams.point for design in fit.designs])
    _, near = scipy.spatial.cKDTree(point).query(point, min(AROUND_ONE, len(point)))
    around = np.maximum(np.median(away[near], axis=1), np.median(away)) / median
    ends = np.cumsum([len(of) for of in found])[:-1]
    return np.split(away / np.maximum(1.0, around), ends)


def _beside_pointing(left: Array, turns: Array) -> Array:
    """Square misfits over their variance, ``|r|^2 - (U r)' (1 + U U')^-1 (U r)``, shape (pixel,).

    Parameters
    ----------
    left : ndarray, shape (pixel, channel)
        Whitened.
    turns : ndarray, shape (pixel, mirror, channel)
        U: changes by a standard deviation of each mirror.
    """
    along = np.einsum("pic,pc->pi", turns, left)
    inverse = np.linalg.inv(np.eye(2) + turns @ np.swapaxes(turns, 1, 2))
    return np.asarray(np.sum(left**2, axis=1) - np.einsum("pi,pij,pj->p", along, inverse, along))


def outliers(data: PixelData, design: PixelDesign, bad: BoolArray) -> IndexArray:
    """Give the image's numbers of pixels that were found among those present."""
    return data.pixel[np.flatnonzero(design.present)[bad]]
