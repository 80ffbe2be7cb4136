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
from sldvexp.field.visibility.rest import is_lattice, rest_sums
from sldvexp.field.visibility.view import View
from sldvexp.image.interpolation.methods import mesh_of
from sldvexp.laser import TwoMirror, rays
from sldvexp.lazy import scipy
from sldvexp.signal import Flag
from sldvexp.typing import BoolArray
from sldvexp.volume import Prisms

#: How much stronger than a pixel at rest half of the surface's pixels must move.
MOVES = 10.0
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
    usable = view.usable
    if not usable.any():
        return nothing
    sums = view.rest or rest_sums(view.velocity, view.std, usable, view.shape)
    if np.isnan(sums.size[usable]).any():
        return nothing
    inside = _on_surface(view, laser, prisms)
    own = sums.size[inside & usable]
    if not len(own) or np.median(own) < MOVES * sums.limit:
        return nothing
    rests = ~inside & (~usable | (sums.size < sums.limit))
    return np.asarray(_in_blocks(view, rests, sums.breaks_off) & usable)


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


def _in_blocks(view: View, rests: BoolArray, breaks_off: BoolArray) -> BoolArray:
    """Keep pixels that rest together."""
    if is_lattice(view.shape):
        block = np.ones((2, 2), bool)
        together = scipy.ndimage.binary_opening(rests.reshape(view.shape), block)
        # The outermost line rests together with what would be beyond it.
        beyond = np.pad(rests.reshape(view.shape), 1, mode="edge")
        line = scipy.ndimage.binary_opening(beyond, block)[1:-1, 1:-1]
        off = breaks_off.reshape(view.shape)
        near = scipy.ndimage.binary_dilation(off, np.ones((3, 3), bool))
        return np.asarray((together | (line & near)).ravel(), bool)
    if len(rests) < TOGETHER:
        return np.zeros(len(rests), bool)
    near = scipy.spatial.cKDTree(view.dac).query(view.dac, TOGETHER)[1]
    core = rests[near].all(axis=1)
    return np.asarray(rests & core[near].any(axis=1))


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
