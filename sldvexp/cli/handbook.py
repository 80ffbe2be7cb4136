"""`sldvexp handbook [page or word]`: pages that explain the program, in the terminal."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console
from rich.markdown import Markdown

from sldvexp.cli.layout import columns, wrapped
from sldvexp.config import docs
from sldvexp.config.paths import HANDBOOK
from sldvexp.errors import UserError, nearest


def run(words: list[str], config_dir: str | None) -> int:
    """Print the pages with one line each, or one page, or where a word is found.

    A terminal gets the page with headings and tables set; a file or a pipe gets the text as it is.

    Raises
    ------
    UserError
        If there is more than one word, or it is in no page.
    """
    pages = {page.stem: page for page in sorted(HANDBOOK.glob("*.md"))}
    if len(words) > 1:
        raise UserError(f"command line: handbook takes one page or word, not {' '.join(words)}")
    if not words:
        print("\n".join(columns([(name, first_sentence(page)) for name, page in pages.items()])))
        print("\nsldvexp handbook page shows one of them, sldvexp handbook word finds a word.")
        return 0
    alike = [name for name in pages if words[0] == name] or [
        name for name in pages if len(words[0]) > 2 and words[0] in name
    ]
    if len(alike) == 1:
        _show(pages[alike[0]].read_text(encoding="utf-8"))
        return 0
    found = list(_places_of(words[0], pages))
    if not found:
        told = nearest(words[0], pages)
        raise UserError(f"command line: there is no page {words[0]}, and none has the word; {told}")
    print("\n".join([*wrapped(f"{words[0]} is in"), *columns(found)]))
    return 0


def _show(text: str) -> None:
    console = Console()
    if console.is_terminal:
        console.print(Markdown(text))
    else:
        print(text, end="")


def _places_of(word: str, pages: dict[str, Path]) -> Iterator[tuple[str, str]]:
    """Yield pages that have a word, with the headings of the sections that have it."""
    for name, page in pages.items():
        text = re.sub(
            r"^```.*?^```$", _indented, page.read_text(encoding="utf-8"), flags=re.M | re.S
        )
        _, *parts = re.split(r"^#+ (.*)$", text, flags=re.MULTILINE)
        sections = zip(parts[::2], parts[1::2], strict=True)
        titles = [
            title for title, told in sections if word.casefold() in f"{title} {told}".casefold()
        ]
        if titles:
            yield name, "; ".join(title.replace("`", "") for title in titles)


def _indented(block: re.Match[str]) -> str:
    """Indent a code block, whose comments are no headings."""
    return block[0].replace("\n", "\n ")


def first_sentence(page: Path) -> str:
    """Find the first sentence below a page's title."""
    _, paragraph, *_ = page.read_text(encoding="utf-8").split("\n\n", 2)
    return docs.sentence(" ".join(paragraph.split()))
