"""`sldvexp handbook site=<folder>`: the whole handbook as pages for a browser, offline.

Sphinx builds it from the pages that the terminal shows, the reference that `reference` makes, and a
gallery of experiments that are run for it. A warning is an error.
"""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import version
from io import StringIO
from pathlib import Path

from sldvexp.cli import handbook, in_process, reference
from sldvexp.config import docs
from sldvexp.config.paths import HANDBOOK, conf_dir
from sldvexp.errors import UserError
from sldvexp.plot import figures_of, save

SPHINX = {
    "project": "sldvexp",
    "version": version("sldvexp"),
    "release": version("sldvexp"),
    "extensions": ["myst_parser"],
    "html_theme": "pydata_sphinx_theme",
    "html_title": f"sldvexp {version('sldvexp')}",
    "html_copy_source": False,
    "html_show_sourcelink": False,
    "html_sidebars": {"gallery": []},
    "html_theme_options": {
        "navbar_align": "left",
        "show_toc_level": 2,
        "navigation_depth": 2,
        "footer_start": [],
        "footer_end": [],
        "secondary_sidebar_items": ["page-toc"],
    },
    "myst_heading_anchors": 3,
}


@dataclass(frozen=True)
class Shown:
    """One experiment of the gallery.

    Parameters
    ----------
    experiment : str
    figures : tuple of str
    """

    experiment: str
    figures: tuple[str, ...]


INTRODUCTION = (
    "3-D vibration velocity fields, with bounds, from one scanning laser Doppler vibrometer."
)

GALLERY = (
    Shown("plate_strain", ("field", "strain", "hot_spots")),
    Shown("tutorial", ("surface", "images")),
    Shown("dissertation/registration", ("pose_residuals",)),
    Shown("dissertation/point_measured", ("point",)),
)


def build(folder: Path, gallery: Iterable[Shown] = GALLERY) -> Path:
    """Build the site; its first page.

    Raises
    ------
    UserError
        If Sphinx is not installed, or has something to say about a page.
    """
    try:
        from sphinx.application import Sphinx
        from sphinx.errors import SphinxError
    except ImportError:
        raise UserError("handbook: a site needs sphinx: pip install 'sldvexp[docs]'") from None
    with tempfile.TemporaryDirectory() as work:
        source, warnings = Path(work) / "source", StringIO()
        write_sources(source, gallery)
        try:
            app = Sphinx(
                str(source),
                None,
                str(folder.absolute()),
                str(Path(work) / "doctrees"),
                "html",
                confoverrides=dict(SPHINX),
                status=None,
                warning=warnings,
                warningiserror=True,
            )
            app.build()
        except SphinxError as error:
            raise UserError(f"handbook: {error}") from error
        if told := re.sub(r"\x1b\[[\d;]*m", "", warnings.getvalue()).strip():
            raise UserError(f"handbook: {told}")
    return folder / "index.html"


def write_sources(source: Path, gallery: Iterable[Shown]) -> None:
    """Write the pages as Sphinx takes them."""
    source.mkdir(parents=True)
    for name, page in handbook.pages().items():
        (source / f"{name}.md").write_text(
            for_sphinx(page.read_text(encoding="utf-8")), encoding="utf-8"
        )
    if (HANDBOOK / "pictures").is_dir():
        shutil.copytree(HANDBOOK / "pictures", source / "pictures")
    write_reference(source)
    write_gallery(source, gallery)
    write_chapters(source)


def write_reference(source: Path) -> None:
    """Write the pages that are made of the program, of settings and functions one for each part."""
    (source / "commands.md").write_text(reference.commands(), encoding="utf-8")
    parts = {"settings": reference.GROUPS, "functions": reference.rooms()}
    for kind, names in parts.items():
        files = [f"{kind}_{name.replace('.', '_')}" for name in names]
        for name, file in zip(names, files, strict=True):
            title, told, text = getattr(reference, kind)((name,)).split("\n\n", 2)
            text = re.sub(r"^#(#+ )", r"\1", text, flags=re.MULTILINE)  # a part is a page here
            (source / f"{file}.md").write_text(text, encoding="utf-8")
        links = "\n".join(f"- [{n}]({file}.md)" for n, file in zip(names, files, strict=True))
        (source / f"{kind}.md").write_text(
            f"{title}\n\n{told}\n\n{links}\n\n{_contents(files)}\n", encoding="utf-8"
        )


def for_sphinx(text: str) -> str:
    """Turn names of pages into links, and names of files into captions."""
    known = "|".join([*handbook.pages(), *reference.PAGES])
    link = rf"`sldvexp handbook ({known})`"
    text = re.sub(link, r"[](\1.md)", text)
    text = re.sub(r"^```(\w+)( long)?$", r"```\1", text, flags=re.MULTILINE)
    return (
        re.sub(r"^```(\w+) (\S+)$", r"```{code-block} \1\n:caption: \2\n", text, flags=re.MULTILINE)
        .replace("```{code-block} csv", "```{code-block} text")
        .replace("```csv", "```text")
    )


def write_chapters(source: Path) -> None:
    """Write the first page and one for each chapter, which lists its pages with a sentence each."""
    told = {name: handbook.first_sentence(page) for name, page in handbook.pages().items()}
    told |= {**handbook.MADE, "gallery": "Experiments and figures of what they find"}
    chapters = {**handbook.chapters(), "Reference": [*reference.PAGES, "gallery"]}
    first = ["# sldvexp", INTRODUCTION]
    for title, names in chapters.items():
        lines = "\n".join(f"- []({name}.md): {told[name]}." for name in names)
        first += [f"## {title}", lines]
        text = f"# {title}\n\n{lines}\n\n{_contents(names)}\n"
        (source / f"{_chapter(title)}.md").write_text(text, encoding="utf-8")
    first.append(_contents(map(_chapter, chapters)))
    (source / "index.md").write_text("\n\n".join(first) + "\n", encoding="utf-8")


def _chapter(title: str) -> str:
    """Name the file of a chapter."""
    return f"chapter_{title.lower().replace(' ', '_')}"


def _contents(names: Iterable[str]) -> str:
    """Write the part of a page that makes others its parts, without showing them."""
    return "```{toctree}\n:maxdepth: 1\n:hidden:\n\n" + "\n".join(names) + "\n```"


def write_gallery(source: Path, gallery: Iterable[Shown]) -> None:
    """Run the experiments of the gallery and write its page."""
    parts = [
        "# Gallery",
        "Experiments of the program with figures of what they find; each is run "
        "anew for this page.",
    ]
    for shown in gallery:
        choice, run = f"experiment={shown.experiment}", source / "runs" / shown.experiment
        in_process.run(choice, "report=none", f"hydra.run.dir={run}", quiet=True)
        told = docs.of_file(conf_dir() / f"experiment/{shown.experiment}.yaml")
        parts += [f"## {shown.experiment}", f"{told}.", f"```console\n$ sldvexp {choice}\n```"]
        figures = figures_of(run / "run.nc")
        for name in shown.figures:
            file = source / "pictures" / f"{shown.experiment.replace('/', '_')}_{name}"
            save(figures[name](), file)
            parts.append(f"![{name}](pictures/{file.name}.png)")
    shutil.rmtree(source / "runs", ignore_errors=True)
    (source / "gallery.md").write_text("\n\n".join(parts) + "\n", encoding="utf-8")
