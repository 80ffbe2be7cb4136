"""`sldvexp handbook [topic]`: pages that explain the program, in the terminal."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.markdown import Markdown

from sldvexp.cli.list import WIDTH
from sldvexp.config import docs
from sldvexp.config.paths import HANDBOOK
from sldvexp.errors import UserError, nearest


def run(words: list[str], config_dir: str | None) -> int:
    """Print the topics with one line each, or the page of one.

    A terminal gets the page with headings and tables set; a file or a pipe gets the text as it is.

    Raises
    ------
    UserError
        If the words are not one topic.
    """
    pages = {page.stem: page for page in sorted(HANDBOOK.glob("*.md"))}
    if len(words) > 1:
        raise UserError(f"command line: handbook takes one topic or none, not {' '.join(words)}")
    if not words:
        width = max(map(len, pages))
        for topic, page in pages.items():
            print(f"  {topic:{width}}  {docs.shortened(first_sentence(page), WIDTH)}")
        print("\nsldvexp handbook topic shows one of them.")
        return 0
    if words[0] not in pages:
        raise UserError(f"command line: there is no topic {words[0]}; {nearest(words[0], pages)}")
    text = pages[words[0]].read_text(encoding="utf-8")
    console = Console()
    if console.is_terminal:
        console.print(Markdown(text))
    else:
        print(text, end="")
    return 0


def first_sentence(page: Path) -> str:
    """Find the first sentence below a page's title."""
    _, paragraph, *_ = page.read_text(encoding="utf-8").split("\n\n", 2)
    return docs.sentence(" ".join(paragraph.split()))
