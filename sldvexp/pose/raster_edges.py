"""Edges of a part's outline in a velocity image whose pixels are rows and columns.

Rows and columns are scan lines: the magnitude rises where a line comes onto the part and falls
where it leaves it. A spot smaller than the pixels' distance says between which two pixels the edge
lies and no more, and says the same on neighbouring lines while the edge runs along them: such a run
of n edges errs together, and each has the standard error ``sqrt(n) pixel / sqrt(12)``, so that all
are worth one. A quick raster thus gives a pose to a part of a pixel, and lines across the outline
(``scan=outline``) a far better one with fewer pixels.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.image import ScanLineEdges, ScanLines, gradient_edges
from sldvexp.lazy import xarray as xr
from sldvexp.session.circles import edges_to_dataset
from sldvexp.session.outline import LEAST

#: Of the median filter along rows and columns, pixels.
WINDOW = 3
#: Pixels by which edges of one run move on at most from line to line.
RUN = 0.5
#: Pixels that a row and a column need.
LEAST_PIXELS = 20


def raster_edges(view: str, image: xr.Dataset) -> xr.Dataset:
    """Find the edges in an image; a group as ``edge/<view>``, directions out of the part.

    Parameters
    ----------
    image : xarray.Dataset
        The group ``image/<view>``; its first frequency is looked at.

    Raises
    ------
    UserError
        If the pixels are no grid, or the image does not show an outline.
    """
    shape = tuple(int(n) for n in np.atleast_1d(image.attrs.get("shape", ())))
    if len(shape) != 2 or min(shape) < LEAST_PIXELS:
        raise UserError(
            f"view {view}: its image is no raster of {LEAST_PIXELS} rows and columns or more, in "
            "which an outline would show; scan it with scan=rectangle, or use scan=outline"
        )
    velocity = image["velocity"].values.reshape(*shape, -1)[..., 0]
    std = image["velocity_std"].values.reshape(*shape, -1)[..., 0]
    dac, flag = image["dac"].values.reshape(*shape, 2), image["flags"].values.reshape(shape) != 0
    scanned = [
        ScanLines(np.abs(v), s, d.astype(float), f, f"the {name} of view {view}")
        for name, v, s, d, f in (
            ("rows", velocity, std, dac, flag),
            ("columns", velocity.T, std.T, dac.swapaxes(0, 1), flag.T),
        )
    ]
    found = [_outward(gradient_edges(lines, 2, WINDOW), lines) for lines in scanned]
    if sum(len(edges.std) for edges in found) < LEAST:
        raise UserError(
            f"view {view}: the raster shows no outline of a part that moves before something that "
            f"rests: {found[0].summary()} along rows, {found[1].summary()} along columns"
        )
    return edges_to_dataset(found)


def _outward(edges: ScanLineEdges, lines: ScanLines) -> ScanLineEdges:
    """Turn the directions of edges where a line comes onto the part, and let runs err together."""
    away = edges.position - lines.origin[edges.line]
    pixel = np.sum(away * lines.direction[edges.line], axis=1) / lines.pitch[edges.line]
    std = lines.pitch[edges.line] / np.sqrt(12.0)
    for sense in (True, False):
        own = np.flatnonzero(edges.rising == sense)
        # A new run begins where the edge has moved on by more than half a pixel, or lines lack.
        starts = (np.abs(np.diff(pixel[own])) > RUN) | (np.diff(edges.line[own]) > 1)
        run = np.concatenate([[0], np.cumsum(starts)]).astype(int)[: len(own)]
        std[own] *= np.sqrt(np.bincount(run, minlength=1)[run])
    direction = np.where(edges.rising[:, None], -1, 1) * edges.direction
    return replace(edges, direction=direction, std=np.maximum(std, edges.std))
