"""Pixels beside the structure: at rest, and no part of the field that samples are taken from.

Samples near the rim of a surface lie in cells whose outer pixels may be beside the structure. Seen
under a flat angle these are far away, and what does not move there bends the image between them to
rest. Pixels around a structure that moves are taken to be beside it where

    sum_f |v_f|^2 / std_f^2 < chi2(2 F),

for blocks of 2 x 2 pixels, or six pixels next to one another, none of them on the surface: a nodal
line that crosses the rim is thinner. At the border of a lattice a single line is enough where the
image breaks off at it, which it does not at a nodal line. Assumed: the background rests within
its noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sldvexp.dataset import Finding, Severity
from sldvexp.field.visibility.projection import Occlusion, sight, to_laser
from sldvexp.field.visibility.view import View
from sldvexp.image.interpolation.methods import mesh_of
from sldvexp.laser import TwoMirror, rays
from sldvexp.lazy import scipy
from sldvexp.signal import Flag
from sldvexp.typing import BoolArray
from sldvexp.volume import Prisms

#: Probability that a pixel at rest moves more than this by its noise.
AT_REST = 1e-4
#: How much stronger than a pixel at rest half of the surface's pixels must move.
MOVES = 10.0
#: Pixels of a row that tell how it goes on, and how much more than what they miss of one another a
#: pixel must be off that.
CONTINUED, BREAK = 6, 2.0
#: Pixels next to one another that rest together, where they are not in rows and columns.
TOGETHER = 6


def without_background(views: Sequence[View], laser: TwoMirror, prisms: Prisms) -> list[View]:
    """Flag pixels beside the structure as resting.

    Parameters
    ----------
    laser : TwoMirror
        As configured; see `View.laser`.
    """
    return [_without(view, beside(view, laser, prisms)) for view in views]


def beside(view: View, laser: TwoMirror, prisms: Prisms) -> BoolArray:
    """Find pixels of a view that rest beside a surface that moves, shape (pixel,)."""
    nothing = np.zeros(len(view.dac), bool)
    square = np.square(view.std).reshape(len(view.std), -1)
    usable = view.usable
    if not usable.any() or not (square[usable] > 0).all():
        return nothing
    size = np.full(len(view.dac), np.inf)
    size[usable] = np.sum(np.abs(view.velocity[usable]) ** 2 / square[usable], axis=1)
    limit = _of_rest(view)
    inside = _on_surface(view, laser, prisms)
    own = size[inside & usable]
    if not len(own) or np.median(own) < MOVES * limit:
        return nothing
    rests = ~inside & (~usable | (size < limit))
    return np.asarray(_in_blocks(view, rests) & usable)


def background_findings(views: Sequence[View], laser: TwoMirror, prisms: Prisms) -> list[Finding]:
    """Name the views that lose places of the surface next to their background.

    Parameters
    ----------
    views : sequence of View
        From `without_background`.
    """
    found = []
    for view in views:
        rests = (view.flags == int(Flag.resting)) & ~_on_surface(view, laser, prisms)
        lost = _lost(view, rests, laser, prisms)
        if lost:
            found.append(_finding(view, lost, prisms.surface_nodes))
    return found


def _without(view: View, pixels: BoolArray) -> View:
    flags = np.asarray(view.flags, np.uint8)
    return replace(view, flags=np.where(pixels, flags | np.uint8(Flag.resting), flags))


def _on_surface(view: View, laser: TwoMirror, prisms: Prisms) -> BoolArray:
    """Find pixels whose beams meet the surface, shape (pixel,)."""
    before = to_laser(view, prisms.surface)[prisms.triangles, 2] > 0
    if not before.all(axis=1).any():
        return np.zeros(len(view.dac), bool)
    own = view.laser(laser)
    begin, way = rays(own.angle_from_dac(view.dac), own.mirror_offset)
    far = 2 * np.linalg.norm(prisms.surface - view.origin, axis=1).max()
    end = view.origin + (begin + far * way) @ view.rotation
    return Occlusion.prepare(view, own, prisms.surface, prisms.triangles, 0.0).hides(end)


def _of_rest(view: View) -> float:
    """Give the sum of squares over variances that a pixel at rest exceeds at `AT_REST`.

    Lines have a real and an imaginary part; combinations of a streamed run's lines are real.
    """
    parts = 2 if np.imag(view.velocity[view.usable]).any() else 1
    return float(scipy.special.chdtri(parts * view.velocity.shape[1], AT_REST))


def _in_blocks(view: View, rests: BoolArray) -> BoolArray:
    """Keep pixels that rest together."""
    if view.shape is not None and min(view.shape) >= 2:
        block = np.ones((2, 2), bool)
        together = scipy.ndimage.binary_opening(rests.reshape(view.shape), block)
        # The outermost line rests together with what would be beyond it.
        beyond = np.pad(rests.reshape(view.shape), 1, mode="edge")
        line = scipy.ndimage.binary_opening(beyond, block)[1:-1, 1:-1]
        near = scipy.ndimage.binary_dilation(_breaks_off(view), np.ones((3, 3), bool))
        return np.asarray((together | (line & near)).ravel(), bool)
    if len(rests) < TOGETHER:
        return np.zeros(len(rests), bool)
    near = scipy.spatial.cKDTree(view.dac).query(view.dac, TOGETHER)[1]
    core = rests[near].all(axis=1)
    return np.asarray(rests & core[near].any(axis=1))


def _breaks_off(view: View) -> BoolArray:
    """Find pixels at the border of a lattice that do not go on as the image does, its shape.

    The four pixels before go on as ``4 v_1 - 6 v_2 + 4 v_3 - v_4``, at a nodal line along the
    border to rest. That misses the fourth power of the pixels' distance, as it does one pixel
    further inside. Where one of these pixels has no velocity nothing is told.
    """
    assert view.shape is not None
    image = np.where(view.usable[:, None], view.velocity, 0.0).reshape(*view.shape, -1)
    usable = view.usable.reshape(view.shape)
    square = np.square(view.std).reshape(len(view.std), -1)
    square = np.broadcast_to(square, view.velocity.shape).reshape(image.shape)
    found = np.zeros(view.shape, bool)
    limit = _of_rest(view)
    for turn in range(4):
        v, s2, known, border = (  # the last a view
            np.rot90(of, turn) for of in (image, square, usable, found)
        )
        if len(v) < CONTINUED:
            continue
        off = v[0] - (4 * v[1] - 6 * v[2] + 4 * v[3] - v[4])
        missed = v[1] - (4 * v[2] - 6 * v[3] + 4 * v[4] - v[5])
        noise = s2[0] + 16 * s2[1] + 36 * s2[2] + 16 * s2[3] + s2[4]
        white = np.sum(np.abs(off) ** 2 / np.where(noise > 0, noise, np.inf), axis=1)
        far = np.sum(np.abs(off) ** 2, axis=1) > BREAK**2 * np.sum(np.abs(missed) ** 2, axis=1)
        border[0] |= (white > limit) & far & known[:CONTINUED].all(axis=0)
    return found


def _lost(view: View, rests: BoolArray, laser: TwoMirror, prisms: Prisms) -> int:
    """Count the nodes of the surface that have no velocity for lack of some pixels."""
    if not rests.any():
        return 0
    before = replace(view, flags=np.where(rests, 0, view.flags))
    dac = sight(view, laser, prisms.surface).dac
    dac = dac[np.isfinite(dac).all(axis=1)]
    return len(mesh_of(before).locate(dac).place) - len(mesh_of(view).locate(dac).place)


def _finding(view: View, lost: int, nodes: int) -> Finding:
    return Finding(
        "background",
        f"view {view.name}",
        f"{lost} of {nodes} places of the surface lie between pixels of view {view.name} on the "
        "structure and pixels beside it, which are at rest; this view has no part there: more "
        "pixels, or a steeper look at this rim, give it one",
        Severity.note,
        size=lost / nodes,
        views=(view.name,),
    )
