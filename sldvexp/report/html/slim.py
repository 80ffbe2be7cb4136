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

from PIL import Image, features

#: Families that have about the widths that text was laid out with, without quotes.
FAMILIES = "DejaVu Sans, Verdana, sans-serif"
#: The same, as matplotlib lists them.
LISTED = "'DejaVu Sans', 'Verdana', sans-serif"
#: Pictures of fewer base64 characters stay as they are.
FEW = 3_000
#: Of WebP, of 100: gradients that no eye tells from the true ones.
QUALITY = 90

UNSEEN = re.compile(
    r'<metadata>.*?</metadata>|<!--.*?-->|\n\s*(?=<)| id="[A-Za-z][\w.]*_\d+"', re.S
)
UPRIGHT = re.compile(r' transform="rotate\(-?0 [^"]*"')
PLACES = re.compile(r' (?:d|x|y|transform)="[^"]+"')
FINER = re.compile(r"(\.\d\d)\d+")
ALONE = re.compile(r"<g>(<(?:path|use) [^>]*/>)</g>")
ALIKE = re.compile(r'<use [^>]*? style="([^"]*)"/>(?:<use [^>]*? style="\1"/>)+')
PICTURE = re.compile(r'data:image/png;base64,\s*([^"]+)')
#: Text in which quotation marks are meant; all others an address may change to single ones.
QUOTED = re.compile(r'>[^<"]*"[^<]*')


def slim(svg: str) -> str:
    """Write an SVG of matplotlib in fewer characters that look the same.

    Examples
    --------
    >>> slim('<?xml?><svg><g id="patch_1"><path d="M 0.123456 2 "/></g></svg>')
    '<svg><path d="M 0.12 2 "/></svg>'
    """
    svg = UNSEEN.sub("", svg[svg.index("<svg") :])
    svg = QUOTED.sub(lambda text: text[0].replace('"', "&quot;"), svg)
    svg = PLACES.sub(_rounded, UPRIGHT.sub("", svg)).replace("<g></g>", "").replace("<g/>", "")
    svg = ALIKE.sub(_said_once, ALONE.sub(r"\1", svg))
    return PICTURE.sub(_picture, svg.replace(LISTED, FAMILIES).replace("'DejaVu Sans'", FAMILIES))


def _rounded(places: re.Match[str]) -> str:
    return FINER.sub(r"\1", places[0]).replace("\n", " ").replace("  ", " ")


def _said_once(markers: re.Match[str]) -> str:
    look = f' style="{markers[1]}"'
    return f"<g{look}>{markers[0].replace(look, '')}</g>"


def _picture(png: re.Match[str]) -> str:
    """Write a picture as WebP if that is smaller."""
    if len(png[1]) < FEW or not features.check("webp"):
        return png[0]
    written = io.BytesIO()
    with Image.open(io.BytesIO(base64.b64decode(png[1]))) as picture:
        picture.save(written, format="webp", quality=QUALITY)
    text = base64.b64encode(written.getvalue()).decode()
    return f"data:image/webp;base64,{text}" if len(text) < len(png[1]) else png[0]
