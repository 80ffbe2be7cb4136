"""The list of figures, which of them a run can show, and figures as files.

Another figure is a function that takes a run, one that says why a run cannot show it, and their
line in `FIGURES`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from sldvexp.dataset import RunData, Source, is_void
from sldvexp.errors import UserError, nearest
from sldvexp.plot import (
    circle_edges,
    criteria_maps,
    field_maps,
    image_points,
    line_scans,
    model_pixels,
    nodal_values,
    point_spectra,
    shape,
    stabilisation_diagram,
    strain_maps,
    sweep_comparison,
    velocity_images,
    view_residuals,
    volume_views,
)
from sldvexp.plot.layer import field_unavailable_because
from sldvexp.plot.paper import settings_kept
from sldvexp.plot.style import settings_of
from sldvexp.writing import whole_or_nothing


class FigureEntry(NamedTuple):
    """A figure: what draws it, and what says why it cannot be drawn of a run."""

    draw: Callable[..., Figure]
    unavailable_because: Callable[[RunData], str]


#: Every figure by its name, in the order in which data flows.
FIGURES: dict[str, FigureEntry] = {
    "scan_lines": FigureEntry(line_scans.scan_lines, line_scans.unavailable_because),
    "edges": FigureEntry(circle_edges.edges, circle_edges.unavailable_because),
    "conics": FigureEntry(circle_edges.conics, circle_edges.unavailable_because),
    "conic_residuals": FigureEntry(circle_edges.conic_residuals, circle_edges.unavailable_because),
    "bitangents": FigureEntry(image_points.bitangents, image_points.unavailable_because),
    "pose_residuals": FigureEntry(
        image_points.pose_residuals, image_points.residuals_unavailable_because
    ),
    "repeatability": FigureEntry(
        image_points.repeatability, image_points.repeats_unavailable_because
    ),
    "phase_correction": FigureEntry(
        velocity_images.phase_correction, velocity_images.raw_unavailable_because
    ),
    "images": FigureEntry(velocity_images.images, velocity_images.unavailable_because),
    "point": FigureEntry(point_spectra.point, point_spectra.unavailable_because),
    "stabilisation": FigureEntry(
        stabilisation_diagram.stabilisation, stabilisation_diagram.unavailable_because
    ),
    "volume": FigureEntry(volume_views.volume, volume_views.unavailable_because),
    "stands": FigureEntry(volume_views.stands, volume_views.stands_unavailable_because),
    "field": FigureEntry(field_maps.field, field_unavailable_because),
    "surface": FigureEntry(shape.surface, shape.unavailable_because),
    "nodal": FigureEntry(nodal_values.nodal, field_unavailable_because),
    "strain": FigureEntry(strain_maps.strain, strain_maps.unavailable_because),
    "hot_spots": FigureEntry(strain_maps.hot_spots, strain_maps.unavailable_because),
    "model_shapes": FigureEntry(model_pixels.model_shapes, model_pixels.unavailable_because),
    "model_criteria": FigureEntry(criteria_maps.model_criteria, criteria_maps.unavailable_because),
    "spectrum": FigureEntry(point_spectra.spectrum, point_spectra.spectrum_unavailable_because),
    "residuals": FigureEntry(view_residuals.residuals, view_residuals.unavailable_because),
    "sweep": FigureEntry(sweep_comparison.sweep, sweep_comparison.unavailable_because),
}


def figures_of(
    source: Source | RunData, folder: str | Path | None = None
) -> dict[str, Callable[..., Figure]]:
    """Find the figures that a run can show, each ready to be drawn.

    Parameters
    ----------
    folder : str or Path, optional
        Of the run, if `source` is not the file in it.

    Returns
    -------
    dict of str to callable
        In the order in which data flows. Called without arguments it returns the figure; it takes
        the figure's own options by name, such as ``view``.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> found = group("point", {}, velocity=[0.01, 0.002j, 0.02], velocity_std=[1e-4] * 3)
    >>> list(figures_of({"point": found}))
    ['point']
    """
    run = RunData.from_source(source, folder)
    void = is_void(run.groups)
    return {
        name: functools.partial(_marked_void, entry.draw, run)
        if void and name in OF_VELOCITIES
        else functools.partial(entry.draw, run)
        for name, entry in FIGURES.items()
        if not entry.unavailable_because(run)
    }


#: Figures of the velocities, and of what follows from them, with their bounds.
OF_VELOCITIES = ("point", "field", "surface", "nodal", "strain", "hot_spots", "spectrum")
VOID = "void: the bounds cannot be believed"


def _marked_void(draw: Callable[..., Figure], run: RunData, **options: Any) -> Figure:
    """Draw a figure and say on it that its bounds cannot be believed."""
    figure = draw(run, **options)
    figure.suptitle("; ".join(filter(None, (figure.get_suptitle(), VOID))), color="tab:red")
    return figure


#: Formats with what each would say of the moment and the program, which is left out.
FORMATS: dict[str, dict[str, None]] = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}
#: Those that a figure is written in unless others are asked for.
USUAL = ("png", "svg")


def save(
    figure: Figure,
    path: str | Path,
    title: str = "",
    formats: Sequence[str] = USUAL,
    dpi: float | None = None,
) -> list[Path]:
    """Write a figure as files of several formats beside each other.

    Letters stay letters in SVG and PDF, which can be searched and edited.

    Parameters
    ----------
    path : str or Path
        Without suffix; its folder is made.
    title : str
        What the files say of themselves; without it the file's name.
    formats : sequence of str
        Of ``png``, ``svg`` and ``pdf``.
    dpi : float, optional
        Dots per inch of a PNG and of what is painted in the others; without it 300.

    Returns
    -------
    list of Path
        The files, in the order of the formats.

    Raises
    ------
    UserError
        If they cannot be written.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     [file.name for file in save(Figure(), f"{folder}/empty")]
    ['empty.png', 'empty.svg']
    """
    path = Path(path)
    for suffix in formats:
        if suffix not in FORMATS:
            raise UserError(f"plot: there is no format {suffix}; {nearest(suffix, FORMATS)}")
    files = [path.with_name(f"{path.name}.{suffix}") for suffix in formats]
    look = settings_of(figure)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with settings_kept(look), _laid_out(figure):
            for file, suffix in zip(files, formats, strict=True):
                about = {**FORMATS[suffix], "Title": title or path.name}
                with whole_or_nothing(file) as beside:
                    figure.savefig(
                        beside, format=suffix, metadata=about, dpi=dpi or look["savefig.dpi"]
                    )
    except OSError as error:
        raise UserError(f"{path}: cannot be written: {error.strerror or error}") from None
    return files


@contextmanager
def _laid_out(figure: Figure) -> Iterator[None]:
    """Lay the figure out once instead of anew for each file."""
    engine = figure.get_layout_engine()
    figure.draw_without_rendering()
    figure.set_layout_engine("none")
    try:
        yield
    finally:
        figure.set_layout_engine(engine)
