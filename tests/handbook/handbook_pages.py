"""Pages of the handbook by name, and their parts."""

from __future__ import annotations

import re

from sldvexp.config.paths import HANDBOOK

PAGES = {page.stem: page.read_text(encoding="utf-8") for page in sorted(HANDBOOK.glob("*.md"))}
FENCE = re.compile(r"^```(\w*)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def sections(topic: str) -> dict[str, str]:
    """Texts of a page by the headings above them."""
    parts = re.split(r"^#+ (.*)$", FENCE.sub("", PAGES[topic]), flags=re.MULTILINE)
    return dict(zip((t.replace("`", "") for t in parts[1::2]), parts[2::2], strict=True))


def group_of(name: str) -> str:
    """The group of `VARIABLES` that a page's name of a group stands for."""
    return re.sub(r"/<\w+>$", "", name)
