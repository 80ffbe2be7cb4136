"""SVG as small as it looks the same: text stays text, curves stay curves.

matplotlib writes a name for every part, six digits of every place, the look of every single
marker, and surfaces as PNG. A hundredth of a point is finer than any printer, so that two digits
are enough; equal looks of markers in a row are said once; a picture within is written as WebP,
which writes gradients in a tenth of the bytes.
"""

from __future__ import annotations

import base64
import io
import re
from functools import lru_cache
from typing import Any, cast

import numpy as np
from matplotlib.backend_bases import RendererBase
from matplotlib.backends.backend_mixed import MixedModeRenderer
from matplotlib.backends.backend_svg import FigureCanvasSVG, RendererSVG
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties, findfont, get_font
from matplotlib.textpath import text_to_path
from numpy.typing import NDArray
from PIL import Image, features

#: Families that have about the widths that text was laid out with, without quotes.
FAMILIES = "DejaVu Sans, Verdana, sans-serif"
#: The same, as matplotlib lists them.
LISTED = "'DejaVu Sans', 'Verdana', sans-serif"
#: Pictures of fewer values stay PNG, which is as small.
FEW = 3_000
#: Of WebP, of 100: gradients that no eye tells from the true ones; and how long it looks for less.
QUALITY, EFFORT = 90, 2
#: Characters a value that WebP takes of what is smooth; of dots and edges PNG may take less.
SMOOTH = 0.03

UNSEEN = re.compile(
    r'<metadata>.*?</metadata>|<!--.*?-->|\n\s*(?=<)| id="(?:[A-Za-z][\w.]*_\d+|image\w+)"', re.S
)
UPRIGHT = re.compile(r' transform="rotate\(-?0 [^"]*"')
PLACES = re.compile(r' (?:d|x|y|transform)="[^"]+"')
FINER = re.compile(r"(\.\d\d)\d+")
ALONE = re.compile(r"<g>(<(?:path|use) [^>]*/>)</g>")
ALIKE = re.compile(r'<use [^>]*? style="([^"]*)"/>(?:<use [^>]*? style="\1"/>)+')
PICTURE = re.compile(r'(?<=href=")data:image/png;base64,[^"]+')
#: Text in which quotation marks are meant; all others an address may change to single ones.
QUOTED = re.compile(r'>[^<"]*"[^<]*')


class _Renderer(RendererSVG):
    """A renderer that puts pictures aside, in whose place it writes empty ones, which are quick."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.pictures: list[NDArray] = []

    def draw_image(self, gc: Any, x: float, y: float, im: Any, transform: Any = None) -> None:
        if im.size:
            # a part of the renderer's own picture is not kept with all of that
            self.pictures.append(im if im.base is None else np.array(im))
        super().draw_image(gc, x, y, np.zeros(np.shape(im)[:2], bool), transform)

    def get_text_width_height_descent(self, s: str, prop: Any, ismath: Any) -> Any:
        # figures of a page have many words in common
        return _measured(s, prop, ismath)

    def _get_font_height_metrics(self, prop: Any) -> Any:
        return _heights(prop.copy())  # a key that nobody changes


@lru_cache(maxsize=4096)
def _measured(text: str, font: FontProperties, ismath: Any) -> Any:
    return text_to_path.get_text_width_height_descent(text, font, ismath)


@lru_cache(maxsize=64)
def _heights(font: FontProperties) -> tuple[float | None, float | None, float | None]:
    """Read how far a font reaches above and below a line, and its gap, pt; None: find it out."""
    size, read = font.get_size_in_points(), get_font(findfont(font)).get_sfnt_table
    head, own = read("head"), read("OS/2")
    if head is None or own is None:
        return None, None, None
    unit = size / head["unitsPerEm"]
    return unit * own["sTypoAscender"], -unit * own["sTypoDescender"], unit * own["sTypoLineGap"]


def slim(drawn: Figure) -> str:
    """Write a figure as SVG.

    Examples
    --------
    >>> slim(Figure(figsize=(1, 1)))[:43]
    '<svg xmlns:xlink="http://www.w3.org/1999/xl'
    """
    FigureCanvasSVG(drawn)  # by which the figure finds room for its text
    written = io.StringIO()
    dpi, wide, high = drawn.dpi, *(72 * drawn.get_size_inches())
    drawn.dpi = 72
    renderer = _Renderer(wide, high, written, image_dpi=dpi, metadata={"Date": None})
    mixed = MixedModeRenderer(drawn, wide / 72, high / 72, dpi, renderer)
    drawn.draw(cast(RendererBase, mixed))
    mixed.finalize()
    pictures = map(_picture, renderer.pictures)
    return PICTURE.sub(lambda _: next(pictures), shortened(written.getvalue()))


def shortened(svg: str) -> str:
    """Write an SVG of matplotlib in fewer characters that look the same.

    Examples
    --------
    >>> shortened('<?xml?><svg><g id="patch_1"><path d="M 0.123456 2 "/></g></svg>')
    '<svg><path d="M 0.12 2 "/></svg>'
    """
    svg = UNSEEN.sub("", svg[svg.index("<svg") :])
    svg = QUOTED.sub(lambda text: text[0].replace('"', "&quot;"), svg)
    svg = PLACES.sub(_rounded, UPRIGHT.sub("", svg)).replace("<g></g>", "").replace("<g/>", "")
    svg = ALIKE.sub(_said_once, ALONE.sub(r"\1", svg))
    return svg.replace(LISTED, FAMILIES).replace("'DejaVu Sans'", FAMILIES)


def _rounded(places: re.Match[str]) -> str:
    return FINER.sub(r"\1", places[0]).replace("\n", " ").replace("  ", " ")


def _said_once(markers: re.Match[str]) -> str:
    look = f' style="{markers[1]}"'
    return f"<g{look}>{markers[0].replace(look, '')}</g>"


def _picture(values: NDArray) -> str:
    """Write red, green, blue and opacity as an address, the shorter of two."""
    known = features.check("webp") and values.size >= FEW
    webp = _encoded(values, "webp", quality=QUALITY, method=EFFORT) if known else None
    if webp and len(webp) < SMOOTH * values.size:
        return webp
    return min(filter(None, (webp, _encoded(values, "png"))), key=len)


def _encoded(values: NDArray, kind: str, **how: int) -> str:
    written = io.BytesIO()
    Image.fromarray(values).save(written, format=kind, **how)
    return f"data:image/{kind};base64,{base64.b64encode(written.getvalue()).decode()}"
