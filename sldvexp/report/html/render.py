"""Sections to one self-contained page."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from sldvexp.lazy import jinja2, markupsafe
from sldvexp.report.html.blocks import Alternatives, Beside, Lead, Link, More, Section, Shape
from sldvexp.writing import whole_or_nothing

#: What draws the moving shape; each uses those before it.
SCRIPTS = (
    *("numbers.js", "mesh.js", "camera.js", "axes.js", "viewer.js", "graph.js", "picture.js"),
    *("shape.js", "pair.js", "choice.js"),
)


def write(path: Path, title: str, subtitle: str, sections: Sequence[Section]) -> Path:
    """Write a page, whole or not at all.

    Returns
    -------
    Path
        `path`.
    """
    page = render(title, subtitle, sections)
    with whole_or_nothing(path) as beside:
        beside.write_text(page, encoding="utf-8")
    return path


def render(title: str, subtitle: str, sections: Sequence[Section]) -> str:
    """Write the text of a page; all that comes from a run is escaped."""
    moves = any(isinstance(block, Shape) for block in _flat(sections))
    return _template().render(
        title=title,
        subtitle=subtitle,
        sections=sections,
        style=markupsafe.Markup(_own("page.css")),
        script=markupsafe.Markup("".join(map(_own, SCRIPTS))) if moves else "",
        heading=markupsafe.Markup(_css_text(title)),
        as_json=lambda data: markupsafe.Markup(_json(data)),
    )


@cache
def _template() -> jinja2.Template:
    """Compile the page's template, once for all pages of a process."""
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["number_like"] = number_like
    return environment.from_string(_own("page.html"))


def number_like(cell: str | Link) -> bool:
    """Tell whether a cell of a table is a number, with or without a bound or a unit."""
    if isinstance(cell, Link):
        return False
    return bool(cell) and (cell[0].isdigit() or (cell[0] in "-−+." and cell[1:2].isdigit()))


def _css_text(text: str) -> str:
    """Write a text of a style sheet: nothing in it can end the text, or the sheet."""
    plain = (c if c.isalnum() or c in " .,:-" else f"\\{ord(c):x} " for c in text)
    return '"' + "".join(plain) + '"'


def _json(data: Any) -> str:
    """Write data for a script: no text in it can end the script."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _own(name: str) -> str:
    """Read a file of this folder."""
    return (files(__package__) / name).read_text(encoding="utf-8")


def _flat(sections: Sequence[Section]) -> Iterator[Any]:
    for section in sections:
        yield from _within(section.blocks)


def _within(blocks: Sequence[Any]) -> Iterator[Any]:
    for block in blocks:
        yield block
        if isinstance(block, More | Lead):
            yield from _within(block.blocks)
        if isinstance(block, Beside | Alternatives):
            for column in block.columns:
                yield from _within(column)
