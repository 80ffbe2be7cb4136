"""Pictures of a dataset in a page: as SVG, or as PNG where that would be too long."""

from __future__ import annotations

import base64
import functools
import io
from collections.abc import Callable, Iterator
from typing import Any

from matplotlib.figure import Figure as Drawn
from matplotlib.ticker import AutoLocator

from sldvexp.dataset import RunData
from sldvexp.plot import figures_of
from sldvexp.plot.paper import SETTINGS, settings_kept
from sldvexp.report.html.blocks import Figure, Text
from sldvexp.report.html.slim import slim

#: Which figures stand in which part of a page, with what they show. A page is made in seconds, so
#: that it has none of scan lines, single views and single edges; `sldvexp plot` has those.
PARTS: dict[str, dict[str, str]] = {
    "first": {"point": "Velocity of the point, or of that which moves most, with bounds."},
    "stands": {
        "volume": "The volume among the instrument's places, and what every view sees of it.",
        "stands": "Where the instrument stood, and the way it looked.",
    },
    "stand": {"stands": "Where the instrument stood, and the way it looked."},
    "circles": {
        "edges": "Edge points of the calibration object's circles, as seen from the instrument.",
        "bitangents": "Bitangent points: where the tangents of two ellipses touch them.",
    },
    "pose": {
        "pose_residuals": "Residuals of the pose: observed minus predicted mirror readings.",
        "repeatability": "Image points of repeated scans.",
    },
    "image": {"images": "Velocity along the line of sight, as seen from the instrument."},
    "modes": {
        "stabilisation": "Poles of all orders and the modes that they made; below, the root mean "
        "square over all pixels of what was measured, what the modes make of it and what is left.",
    },
    "shape": {"surface": "The velocity drawn as a deflection, at the moment of its largest value."},
    "field": {
        "field": "The field with its bounds on the given surface, a shell's on its middle surface "
        "unless it was said to be the face; components have one scale, and what is not above its "
        "bound is pale.",
        "spectrum": "Velocity at the node of the largest motion, by frequency, with bounds.",
        "nodal": "Velocity with bounds along the line of nodes through its largest value.",
        "residuals": "Residuals by view.",
    },
    "model": {
        "model_shapes": "Lines of equal motion of the model with the measured pixels of all views "
        "over them, mode by mode; below, what the model leaves of these.",
        "model_criteria": "What CoMAC and FRAC of the pixels, and CSAC of the lines, are short of "
        "one, beside what noise alone makes them short of: 1 where nothing else is left.",
    },
    "strain": {
        "hot_spots": "The largest extension of a cycle with its direction where it is known, von "
        "Mises stress with its hot spots, and their bounds.",
        "strain": "Components of the strain with their bounds.",
    },
}
SWEEP_CAPTION = "The runs by what was varied."
#: Of one figure as SVG, with text as text.
MOST_BYTES = 300_000
#: Settings of the style that a figure does not keep, and that decide its bytes.
OF_FILES = ("svg.hashsalt", "svg.fonttype")
#: Characters of an SVG that are spelt in an address.
SPELT = {"%": "%25", "#": "%23", "&": "%26", "<": "%3C", ">": "%3E", "\n": " ", '"': "'"}
#: Parts of a page that stand beside words on its first screen, and the width of their figures, m.
FIRST, BESIDE = ("first", "stand"), 0.105
#: Intervals between ticks of an axis that has no others.
FEW_TICKS = 5
#: Dots per inch of a PNG.
FINE = 150


def figures(run: RunData, part: str) -> Iterator[Figure | Text]:
    """Find the figures of one part of the page that a run can show."""
    known = drawable(run)
    for name, caption in PARTS[part].items():
        if name in known:
            draw = functools.partial(known[name], width=BESIDE) if part in FIRST else known[name]
            yield _figure(name, draw, caption, only_print=part == "shape")


@functools.lru_cache(maxsize=1)
def drawable(run: RunData) -> dict[str, Callable[..., Drawn]]:
    """Find the figures that can be drawn of a run, once for all parts of its page."""
    return figures_of(run)


def sweep_figures(table: Any) -> Iterator[Figure | Text]:
    """Find the figure of a sweep, if it can be drawn."""
    for name, draw in figures_of(table).items():
        if name == "sweep":
            yield _figure(name, draw, SWEEP_CAPTION)


def _figure(
    name: str, draw: Callable[[], Drawn], caption: str, only_print: bool = False
) -> Figure | Text:
    """Draw a figure, or say why there is none; the rest of the page is made all the same."""
    try:
        return Figure(_address(draw()), caption, only_print)
    except Exception as error:
        told = " ".join(str(error).split())
        return Text(f"The figure {name} could not be drawn: {told}", "small")


def _address(drawn: Drawn) -> str:
    """Write a picture as a ``data:`` address, the same from the same data."""
    _with_few_ticks(drawn)
    settings: dict[Any, Any] = {name: SETTINGS[name] for name in OF_FILES}
    with settings_kept(settings):
        svg = slim(drawn)
        if len(svg) <= MOST_BYTES:
            return f"data:image/svg+xml,{_as_address(svg)}"
        content = io.BytesIO()
        drawn.savefig(content, format="png", dpi=FINE, metadata={"Software": None})
    return f"data:image/png;base64,{base64.b64encode(content.getvalue()).decode()}"


def _with_few_ticks(drawn: Drawn) -> None:
    """Draw few ticks, which take long, and none where neither numbers nor lines belong to them."""
    for axes in drawn.axes:
        for axis, sides in ((axes.xaxis, ("bottom", "top")), (axes.yaxis, ("left", "right"))):
            told = axis.get_tick_params()
            numbers = any(told.get(f"label{side}", False) for side in sides)
            if not (numbers or told.get("gridOn", False) or axis.get_label_text()):
                axis.set_visible(False)
            if type(located := axis.get_major_locator()) is AutoLocator:
                located.set_params(nbins=FEW_TICKS)


def _as_address(svg: str) -> str:
    """Spell what an address or an attribute cannot have as it is; a third less than base64.

    Of quotation marks only the single one is left, the other is escaped wherever it is meant.
    """
    for mark, instead in SPELT.items():
        svg = svg.replace(mark, instead)
    return svg
