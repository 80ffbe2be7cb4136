"""Lines that fit the terminal: names in a column, texts wrapped beside them, nothing cut."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Iterator, Sequence

#: Columns where no terminal says how many it has, and the least and most that text is wrapped to.
USUAL, LEAST, MOST = 100, 40, 140
#: Columns that text beside a name should have at least; with less it stands below the name.
BESIDE = 38


def width() -> int:
    """Tell how many columns a line of text may take here."""
    return min(max(shutil.get_terminal_size((USUAL, 24)).columns, LEAST), MOST)


def wrapped(text: str, indent: int = 0, hanging: int | None = None) -> list[str]:
    """Wrap a text to the terminal; later lines hang by more if `hanging` says so.

    Examples
    --------
    >>> wrapped("two words", indent=2)
    ['  two words']
    """
    later = indent if hanging is None else hanging
    return textwrap.wrap(
        text,
        width(),
        initial_indent=" " * indent,
        subsequent_indent=" " * later,
        break_on_hyphens=False,
        break_long_words=False,  # a path stays one word, which can be copied
    )


def columns(rows: Sequence[tuple[str, str]], indent: int = 2) -> Iterator[str]:
    """Yield names in a column with their texts beside them, or below where that is too narrow.

    Examples
    --------
    >>> list(columns([("edge", "from edges"), ("bitangent", "from points")]))
    ['  edge       from edges', '  bitangent  from points']
    """
    column = indent + max((len(name) for name, _ in rows), default=0) + 2
    beside = width() - column >= BESIDE
    for name, text in rows:
        if beside:
            first, *others = wrapped(text, column) or [""]
            yield f"{' ' * indent}{name}".ljust(column) + first[column:]
            yield from others
        else:
            yield f"{' ' * indent}{name}"
            yield from wrapped(text, indent + 4)
