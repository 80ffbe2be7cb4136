"""Which figures there are, and which of them a run can show."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure

from sldvexp.dataset.run_data import Shown, Source, shown
from sldvexp.plot import (
    circle_edges,
    field_maps,
    image_points,
    line_scans,
    nodal_values,
    point_spectra,
    shape,
    sweep_comparison,
    velocity_images,
    view_residuals,
    volume_views,
)


class Entry(NamedTuple):
    """A figure: what draws it, and what says why it cannot be drawn of a run."""

    draw: Callable[..., Figure]
    missing: Callable[[Shown], str]


#: Every figure by its name, in the order in which data flows.
FIGURES: dict[str, Entry] = {
    "scan_lines": Entry(line_scans.scan_lines, line_scans.missing),
    "edges": Entry(circle_edges.edges, circle_edges.missing),
    "conics": Entry(circle_edges.conics, circle_edges.missing),
    "conic_residuals": Entry(circle_edges.conic_residuals, circle_edges.missing),
    "bitangents": Entry(image_points.bitangents, image_points.missing),
    "pose_residuals": Entry(image_points.pose_residuals, image_points.missing_residuals),
    "repeatability": Entry(image_points.repeatability, image_points.missing_repeats),
    "phase_correction": Entry(velocity_images.phase_correction, velocity_images.missing_raw),
    "images": Entry(velocity_images.images, velocity_images.missing),
    "point": Entry(point_spectra.point, point_spectra.missing),
    "volume": Entry(volume_views.volume, volume_views.missing),
    "field": Entry(field_maps.field, field_maps.missing),
    "surface": Entry(shape.surface, shape.missing),
    "nodal": Entry(nodal_values.nodal, nodal_values.missing),
    "spectrum": Entry(point_spectra.spectrum, point_spectra.missing_spectrum),
    "residuals": Entry(view_residuals.residuals, view_residuals.missing),
    "sweep": Entry(sweep_comparison.sweep, sweep_comparison.missing),
}


def figures_of(
    source: Source | Shown, folder: str | Path | None = None
) -> dict[str, Callable[..., Figure]]:
    """The figures that a run can show, each ready to be drawn.

    Parameters
    ----------
    source : DataTree or others
        See `sldvexp.dataset.run_data.shown`.
    folder : str or Path, optional
        Of the run, if `source` is not the file in it.

    Returns
    -------
    dict of str to callable
        In the order in which data flows. Called without arguments it returns the figure; it takes
        the figure's own options by name, such as ``view``.
    """
    run = shown(source, folder)
    return {
        name: functools.partial(entry.draw, run)
        for name, entry in FIGURES.items()
        if not entry.missing(run)
    }
