"""`sldvexp handbook [page or word]`: pages that explain the program, in the terminal."""

from __future__ import annotations

import functools
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.markdown import Markdown

from sldvexp import cli
from sldvexp.cli.layout import columns, wrapped
from sldvexp.config import docs
from sldvexp.config.paths import HANDBOOK
from sldvexp.errors import UserError, nearest

#: Pages in the order in which they are read.
CHAPTERS = {
    "Begin": (
        "first_hour",
        "own_plate",
        "own_files",
        "other_instruments",
        "first_instrument",
        "aiming",
        "console",
    ),
    "Work": (
        *("own_experiments", "planning", "sweeps", "figures", "motion", "formats", "python"),
        "how_to",
    ),
    "Methods": (
        "choosing_a_method",
        "poses",
        "velocity_images",
        "response_functions",
        "fields",
        "shell",
        "modes",
        "models",
        "theory",
        "virtual_lab",
    ),
    "Results": ("reading_a_result", "viewer", "verdict", "reproduced", "printed"),
    "Look up": ("conventions", "glossary", "extending", "threats"),
}

#: Pages that `reference` makes of the program itself.
MADE = {
    "commands": "Every command with examples, as sldvexp <command> --help has it",
    "settings": "Every setting with its value, type, unit and meaning; long",
    "functions": "Every public function and class with its example; long",
}

SITE = "site="
#: Endings with which a word is the same.
ENDINGS = "e?s|'s|e?d|ing"
#: Times that a word counts in a heading, and where it is explained.
HEADED, EXPLAINED = 20, 10


def run(words: list[str], config_dir: str | None) -> int:
    """Print the pages with one line each, or one page, or where a word is found, or make a site.

    A terminal gets the page with headings and tables set; a file or a pipe gets the text as it is.

    Raises
    ------
    UserError
        If there is more than one word, or it is in no page.
    """
    if len(words) > 1:
        raise UserError(f"command line: handbook takes one page or word, not {' '.join(words)}")
    if not words:
        print("\n".join(_list()))
    elif words[0].startswith(SITE):
        print(cli.site.build(Path(words[0].removeprefix(SITE) or "site")))
    elif words[0] in MADE:
        _show(cli.reference.PAGES[words[0]]())
    elif page := _page_of(words[0]):
        _show(page.read_text(encoding="utf-8"))
    else:
        found = places_of(words[0])
        if not found:
            told, shown = nearest(words[0], [*pages(), *MADE]), words[0].strip() or "without a name"
            raise UserError(
                f"command line: there is no page {shown}, and none has the word; {told}"
            )
        print("\n".join([*wrapped(f"{words[0]} is in"), *columns(found)]))
    return 0


def pages() -> dict[str, Path]:
    """Find the pages by name."""
    return {page.stem: page for page in sorted(HANDBOOK.glob("*.md"))}


def chapters() -> dict[str, list[str]]:
    """List the pages of each chapter in their order; a page of no chapter is one to look up."""
    found = pages()
    named = {title: [n for n in names if n in found] for title, names in CHAPTERS.items()}
    known = {name for names in named.values() for name in names}
    *_, last = named
    named[last] += [name for name in found if name not in known]
    return named


def _list() -> Iterator[str]:
    """Yield the chapters with a line for each page."""
    files = pages()
    for title, names in chapters().items():
        yield title
        yield from columns([(name, first_sentence(files[name])) for name in names])
        yield ""
    yield "Made of the program"
    yield from columns(list(MADE.items()))
    yield ""
    yield "sldvexp handbook page shows one of them, sldvexp handbook word finds a word."


def _page_of(word: str) -> Path | None:
    """Find the page of a name, or of a part of one name only."""
    files = pages()
    if word in files:
        return files[word]
    alike = [name for name in files if len(word) > 2 and word in name]
    return files[alike[0]] if len(alike) == 1 else None


def _show(text: str) -> None:
    """Show a page: set on a terminal, screen by screen if somebody sits there, else as it is."""
    console = Console()
    if not console.is_terminal:
        print(text, end="")
    elif sys.stdin.isatty() and sys.stdout.isatty():
        os.environ.setdefault("LESS", "-RFX")  # colours; no waiting for a page that fits
        with console.pager(styles=True):
            console.print(Markdown(text))
    else:
        console.print(Markdown(text))


def places_of(word: str) -> list[tuple[str, str]]:
    """List pages that tell of a word, with the headings of the sections that do, best first.

    A word counts whole or with an ending, and with or without hyphens: "dropout" is in "drop-outs".
    Only a word that is nowhere so is looked for within others.

    Examples
    --------
    >>> [page for page, _ in places_of("leakage")]
    ['glossary', 'response_functions']
    """
    letters = [re.escape(letter) for letter in re.sub(r"[\s_-]", "", word)]
    if not letters:
        return []
    spelt = r"[\s_-]?".join(letters)
    for pattern in (rf"(?<![^\W_]){spelt}(?:{ENDINGS})?(?![^\W_])", spelt):
        found = {name: _sections_of(page, pattern) for name, page in pages().items()}
        # A page that has a section on it goes before one that has the word here and there.
        weight = {name: max(own.values(), default=0.0) for name, own in found.items()}
        best = sorted((n for n in found if found[n]), key=lambda name: -weight[name])
        if best:
            return [(name, "; ".join(found[name])) for name in best]
    return []


def _sections_of(page: Path, pattern: str) -> dict[str, float]:
    """Find headings of sections that have a pattern, with how much they tell of it."""
    text = re.sub(r"^```.*?^```$", _indented, page.read_text(encoding="utf-8"), flags=re.M | re.S)
    _, *parts = re.split(r"^#+ (.*)$", text, flags=re.MULTILINE)
    found = {}
    for title, told in zip(parts[::2], parts[1::2], strict=True):
        has = functools.partial(re.findall, flags=re.IGNORECASE | re.MULTILINE)
        # What a row of a table, a term of a list or a paragraph begins with is explained there.
        explained = len(has(rf"^(?:\| |- |)[`*]+{pattern}|^\| {pattern}", told))
        weight = len(has(pattern, told)) + EXPLAINED * explained
        weight += HEADED * len(has(pattern, title))
        if weight:
            found[title.replace("`", "")] = float(weight)
    return found


def _indented(block: re.Match[str]) -> str:
    """Indent a code block, whose comments are no headings."""
    return block[0].replace("\n", "\n ")


def first_sentence(page: Path) -> str:
    """Find the first sentence below a page's title."""
    _, paragraph, *_ = page.read_text(encoding="utf-8").split("\n\n", 2)
    return docs.sentence(" ".join(paragraph.split()))
