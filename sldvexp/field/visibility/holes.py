"""Nodes of a volume in the holes of a structure, where there is nothing that has a velocity.

Images have patches at rest there. A node is in a hole if half of the views that look at its place,
or more, have a pixel of such a patch at a corner of the cell that they see it in: the elements
would continue into the hole what moves around it, and no pixel could contradict them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sldvexp.field.visibility.projection import sight
from sldvexp.field.visibility.view import View
from sldvexp.image.interpolation.methods import mesh_of
from sldvexp.laser import TwoMirror
from sldvexp.lazy import scipy
from sldvexp.signal import Flag
from sldvexp.typing import BoolArray, IndexArray
from sldvexp.volume import Prisms


def nodes_in_holes(views: Sequence[View], laser: TwoMirror, prisms: Prisms) -> BoolArray:
    """Find the nodes in holes, shape (node,).

    Parameters
    ----------
    laser : TwoMirror
        As configured; see `View.laser`.
    """
    position = prisms.position.reshape(-1, 3)
    looking, resting = np.zeros((2, len(position)), int)
    patches = [view.flags.astype(int) & int(Flag.resting) != 0 for view in views]
    if not any(patch.any() for patch in patches):
        return np.zeros(len(position), bool)
    for view, patch in zip(views, patches, strict=True):
        dac = sight(view, laser, position).dac
        at = np.flatnonzero(np.isfinite(dac).all(axis=1))
        mesh = mesh_of(view)
        inside = at[~mesh.locate(dac[at]).outside]
        looking[inside] += 1
        resting[inside] += mesh.touches(dac[inside], patch)
    return (resting > 0) & (2 * resting >= looking)


def by_hole(marked: BoolArray, prisms: Prisms) -> list[IndexArray]:
    """Take nodes in holes apart: those of one hole hang together over the surface.

    Parameters
    ----------
    marked : ndarray of bool, shape (node,)
    """
    by_layer = marked.reshape(-1, prisms.surface_nodes)
    some = np.asarray(by_layer.any(axis=0))
    side = np.concatenate([prisms.triangles, np.roll(prisms.triangles, 1, axis=1)]).reshape(2, -1)
    first, second = side[:, np.asarray(some[side].all(axis=0))]
    count = len(some)
    graph = scipy.sparse.csr_array((np.ones(len(first)), (first, second)), shape=(count, count))
    label = scipy.sparse.csgraph.connected_components(graph, directed=False)[1]
    whole = np.broadcast_to(label, by_layer.shape)
    return [np.flatnonzero((by_layer & (whole == one)).ravel()) for one in np.unique(label[some])]
