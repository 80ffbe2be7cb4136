"""Pages in the browser and the handbook's pages about them say the same words."""

from __future__ import annotations

import re
from html import unescape
from pathlib import Path

import pytest

import sldvexp

PACKAGE = Path(sldvexp.__file__).parent
#: Pages of the handbook with the pages in the browser, and where in these the controls stand.
PAGES = {
    "viewer": (PACKAGE / "report/html/page.html", r'aria-label="what is shown"[\s\S]*?(?=<nav)'),
    "console": (PACKAGE / "console/page/index.html", r"<main>[\s\S]*</main>"),
}
CONTROL = re.compile(r"<(?:button|option|label)[^>]*>(.*?)(?=<)")


def controls(name):
    """Words on the controls of a page."""
    file, where = PAGES[name]
    part = re.search(where, file.read_text(encoding="utf-8"))[0]
    found = (unescape(text) for text in CONTROL.findall(part))
    words = {re.sub(r"\(.\)$", "", re.sub(r"[▶▲◀▼]|{{.*", "", word)).strip() for word in found}
    return sorted(word for word in words if word)


@pytest.mark.parametrize("name", PAGES)
def test_every_control_is_explained_by_its_own_words(name):
    told = " ".join((PACKAGE / f"handbook/{name}.md").read_text(encoding="utf-8").split()).lower()
    assert len(controls(name)) > 20
    assert [word for word in controls(name) if word.lower() not in told] == []
