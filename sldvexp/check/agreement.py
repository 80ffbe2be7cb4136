"""How well the views agree with one another at every depth of a volume."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.check.base import Examined
from sldvexp.errors import UserError
from sldvexp.field.looks import Looks
from sldvexp.field.run import looks_of

Array = NDArray[np.float64]

#: Sampled depths on each side of the smallest misfit that the parabola goes through.
NEIGHBOURS = 2


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


def agreement(run: Examined, parts: int) -> Agreement:
    """The misfit at every sampled depth.

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
    count = len(looks.prisms.triangles)
    blocks = np.array_split(np.arange(count), min(parts, count))
    depth, place = np.unique(np.round(sampled_depth(looks), 12), return_inverse=True)
    misfit, freedom = np.zeros((2, len(blocks), len(depth)))
    for part, triangles in enumerate(blocks):
        for total, values in zip((misfit, freedom), _misfit(looks, triangles), strict=True):
            np.add.at(total[part], place, values)
    return Agreement(depth, misfit, freedom)


def field_looks(run: Examined) -> Looks:
    """What the views of a run see of its volume; UserError if it has none."""
    e = run.experiment
    if e is None or e.volume is None or "pose" not in run.tree:
        raise UserError("views can only be compared over a volume: choose volume=grid and images")
    return looks_of(run.tree, e.laser, e.volume)


def sampled_depth(looks: Looks) -> Array:
    """Depth of every gap's sample points, gap by gap."""
    zeta = looks.rule.parameter[:, 3]
    low, high = looks.prisms.depth[:-1, None], looks.prisms.depth[1:, None]
    return np.ravel((low + high) / 2 + zeta * (high - low) / 2)


def _misfit(looks: Looks, triangles: NDArray[np.intp]) -> tuple[Array, Array]:
    """Misfit and degrees of freedom at each gap's sample points, of some triangles."""
    look = looks.at(triangles)
    shape = (looks.prisms.gaps, len(triangles), looks.rule.points)
    valid = look.valid.all(axis=1).reshape(shape)
    everywhere = np.broadcast_to(valid.all(axis=(0, 2))[None, :, None], shape).ravel()
    pairs = list(zip(look.seen, looks.views, strict=True))
    velocity = np.stack([seen.velocity(view) for seen, view in pairs], axis=1)
    std = np.stack([seen.std(view) for seen, view in pairs], axis=1)
    squares = np.zeros(len(everywhere))
    weight = 1 / std[everywhere][..., None]
    design = look.directions[everywhere] * weight
    data = velocity[everywhere] * weight
    left = data - design @ (np.linalg.pinv(design) @ data)
    squares[everywhere] = np.sum(np.abs(left) ** 2, axis=(1, 2))
    each = 2 * (len(looks.views) - 3) * velocity.shape[2]
    by_point = squares.reshape(shape).sum(axis=1).ravel()
    return by_point, each * everywhere.reshape(shape).sum(axis=1).ravel().astype(float)


def best_depth(found: Agreement) -> tuple[float, float, float]:
    """Depth of the smallest misfit, its standard error and the latter's degrees of freedom.

    The standard error is the jackknife's: how the minimum moves when a part is left out.

    Raises
    ------
    UserError
        If the smallest misfit lies at the first or last depth: the surface is not in the volume.
    """
    seen = found.freedom.sum(axis=1) > 0
    if seen.sum() < 4:
        raise UserError("too little of the surface is seen by all views at all depths")
    misfit = found.misfit[seen]
    parts = len(misfit)
    total = misfit.sum(axis=0)
    depth = _minimum(found.depth, total)
    without = np.array([_minimum(found.depth, total - part) for part in misfit])
    variance = (parts - 1) / parts * np.sum((without - without.mean()) ** 2)
    return depth, float(np.sqrt(variance)), float(parts - 1)


def _minimum(depth: Array, misfit: Array) -> float:
    """Where the parabola through the depths around the smallest misfit has its minimum."""
    middle = int(misfit.argmin())
    if middle in (0, len(depth) - 1):
        raise UserError(
            f"the views agree best at the edge of the volume ({depth[middle]:.4g} m): the surface "
            "seems to lie outside of it; move the volume with volume.offset"
        )
    some = slice(max(0, middle - NEIGHBOURS), middle + NEIGHBOURS + 1)
    scale = np.ptp(depth[some])
    offset = (depth[some] - depth[middle]) / scale
    curve = np.polynomial.polynomial.polyfit(offset, misfit[some], 2)
    return float(depth[middle] - scale * curve[1] / (2 * curve[2]))
