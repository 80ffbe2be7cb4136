"""How well the views agree with one another at every depth of a volume.

At one place ``v = D V`` has three unknowns, so that four views or more can disagree. The misfit is
``sum |v - D V|^2 / variance``, with ``2 (views - 3)`` degrees of freedom a frequency. Away from the
real surface it grows with the fourth power of the depth, see `best_depth`. Samples are taken as
independent, though neighbours share pixels; the standard error is therefore a jackknife's.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.check.base import Examination
from sldvexp.errors import UserError
from sldvexp.field import VolumeVisibility
from sldvexp.field.estimate import volume_visibility
from sldvexp.typing import Array, BoolArray, IndexArray

#: Depths that are tried for the smallest misfit; between them a parabola is used.
TRIED = 401
#: Fewest parts of the surface that a standard error can rest on.
FEWEST_PARTS = 4


@dataclass(frozen=True, eq=False)
class Agreement:
    """Misfit of single samples, summed over parts of the surface.

    Attributes
    ----------
    depth : ndarray, shape (depth,), m
        Sampled depths along the normals, ascending.
    misfit : ndarray, shape (part, depth)
        Squared residuals of ``v = D V`` over the velocities' variances, real and imaginary part
        and all frequencies added up.
    freedom : ndarray, shape (part, depth)
        Their degrees of freedom.
    """

    depth: Array
    misfit: Array
    freedom: Array


def agreement(run: Examination, parts: int) -> Agreement:
    """Compute the misfit at every sampled depth.

    Only places of the surface that all views see at all depths count, so that depths are compared
    on the same places.

    Raises
    ------
    UserError
        If the run has no volume or no images, or there are fewer than four views.
    """
    looks = field_looks(run)
    if len(looks.views) < 4:
        raise UserError(
            f"views can only disagree if there are at least 4, but there are {len(looks.views)}"
        )
    parts = min(parts, len(looks.triangles))
    blocks = np.array_split(looks.triangles, parts)
    part = np.repeat(np.arange(parts), [len(block) for block in blocks])
    depth, place = np.unique(np.round(sampled_depth(looks), 12), return_inverse=True)
    misfit, freedom = np.zeros((2, parts, len(depth)))
    for triangles in [looks.triangles] if looks.fits_in_cache else blocks:
        where = part[triangles], place[:, None]
        for total, values in zip((misfit, freedom), _misfit(looks, triangles), strict=True):
            np.add.at(total, where, values)
    return Agreement(depth, misfit, freedom)


def field_looks(run: Examination) -> VolumeVisibility:
    """Find what the views of a run see of its volume; UserError if it has none."""
    e = run.experiment
    if e is None or e.volume is None or "pose" not in run.groups:
        raise UserError("views can only be compared over a volume: choose volume=grid and images")
    return volume_visibility(run.groups, e.laser, e.volume)


def sampled_depth(looks: VolumeVisibility) -> Array:
    """Compute the depth of every gap's sample points, gap by gap."""
    zeta = looks.rule.parameter[:, 3]
    low, high = looks.prisms.depth[:-1, None], looks.prisms.depth[1:, None]
    return np.ravel((low + high) / 2 + zeta * (high - low) / 2)


def _misfit(looks: VolumeVisibility, triangles: IndexArray) -> tuple[Array, Array]:
    """Compute misfit and degrees of freedom of triangles at each gap's sample points.

    Both of shape (point, triangle).
    """
    look = looks.at(triangles)
    shape = (looks.prisms.gaps, len(triangles), looks.rule.points)
    valid: BoolArray = np.all(look.valid, axis=1).reshape(shape)
    everywhere = np.broadcast_to(np.all(valid, axis=(0, 2), keepdims=True), shape).ravel()
    pairs = list(zip(look.by_view, looks.views, strict=True))
    velocity = np.stack([seen.velocity(view) for seen, view in pairs], axis=1)
    std = np.stack([seen.std(view) for seen, view in pairs], axis=1)
    squares = np.zeros(len(everywhere))
    weight = 1 / std[everywhere][..., None]
    design = look.directions[everywhere] * weight
    data = velocity[everywhere] * weight
    across = design.swapaxes(1, 2)  # of three columns, which takes half the time
    left = data - design @ (np.linalg.pinv(across @ design, hermitian=True) @ (across @ data))
    squares[everywhere] = np.sum(np.abs(left) ** 2, axis=(1, 2))
    each = 2 * (len(looks.views) - 3) * velocity.shape[2]
    each_sample = squares, each * everywhere.astype(float)
    by_point = [np.moveaxis(v.reshape(shape), 1, 2).reshape(-1, shape[1]) for v in each_sample]
    return by_point[0], by_point[1]


def best_depth(found: Agreement) -> tuple[float, float]:
    """Find depth of the smallest misfit and its standard error, m.

    Away from the surface the views disagree by ``z^2`` times the curvature of what vibrates: what
    goes with z itself looks like a tangential velocity, with which they do agree. So the misfit is
    ``a + c (z - z_0)^4``. The standard error is the jackknife's: how the minimum moves when a part
    of the surface is left out.

    Raises
    ------
    UserError
        If all views together see too little of the surface.
    """
    seen = found.freedom.sum(axis=1) > 0
    if seen.sum() < FEWEST_PARTS:
        raise UserError("too little of the surface is seen by all views at all depths")
    misfit = found.misfit[seen]
    total = misfit.sum(axis=0)
    without = np.array([_minimum(found.depth, total - part) for part in misfit])
    return _minimum(found.depth, total), jackknife(without)


def jackknife(without: Array) -> float:
    """Compute a number's standard error from its values when each part of the data is left out."""
    parts = len(without)
    return float(np.sqrt((parts - 1) / parts * np.sum((without - without.mean()) ** 2)))


def _minimum(depth: Array, misfit: Array) -> float:
    """Fit z_0 of the curve ``a + c (z - z_0)^4`` that is nearest, within the sampled depths."""
    middle, half = (depth[0] + depth[-1]) / 2, np.ptp(depth) / 2
    tried = np.linspace(-1, 1, TRIED)
    power = ((depth - middle) / half - tried[:, None]) ** 4
    power -= power.mean(axis=1, keepdims=True)
    centred = misfit - misfit.mean()
    along = power @ centred
    gain = np.where(along > 0, along, 0.0) ** 2 / np.einsum("td,td->t", power, power)
    best = int(np.clip(gain.argmax(), 1, TRIED - 2))
    low, top, high = gain[best - 1 : best + 2]
    bend = low - 2 * top + high
    shift = (low - high) / (2 * bend) if bend < 0 else 0.0
    return float(middle + half * (tried[best] + np.clip(shift, -1, 1) * (tried[1] - tried[0])))
