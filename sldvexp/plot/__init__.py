"""Figures of a run: functions that take its dataset and return a matplotlib figure.

>>> import sldvexp.plot
>>> sldvexp.plot.field("outputs/2026-11-22/10-00-00/run.nc")  # doctest: +SKIP

Each takes an opened run.nc, its path, or the groups of a run by their path; the figure belongs to
no window. What is missing for a figure is said in one sentence.
"""

from sldvexp.plot.catalogue import FIGURES, figures_of
from sldvexp.plot.circle_edges import conic_residuals, conics, edges
from sldvexp.plot.field_maps import field
from sldvexp.plot.image_points import bitangents, pose_residuals, repeatability
from sldvexp.plot.line_scans import scan_lines
from sldvexp.plot.nodal_values import nodal
from sldvexp.plot.point_spectra import point, spectrum
from sldvexp.plot.saving import save
from sldvexp.plot.shape import surface
from sldvexp.plot.sweep_comparison import sweep
from sldvexp.plot.velocity_images import images, phase_correction
from sldvexp.plot.view_residuals import residuals
from sldvexp.plot.volume_views import volume

__all__ = [
    "FIGURES",
    "bitangents",
    "conic_residuals",
    "conics",
    "edges",
    "field",
    "figures_of",
    "images",
    "nodal",
    "phase_correction",
    "point",
    "pose_residuals",
    "repeatability",
    "residuals",
    "save",
    "scan_lines",
    "spectrum",
    "surface",
    "sweep",
    "volume",
]
