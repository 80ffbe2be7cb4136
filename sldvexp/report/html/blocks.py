"""What a section of a page consists of; `page.html` has a macro for each kind."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from rich.table import Table as TerminalTable
from rich.text import Text as Marked


@dataclass(frozen=True)
class Text:
    """A paragraph.

    Parameters
    ----------
    tone : str
        ``plain``, ``good``, ``warning`` or ``small``; ``verdict good`` and ``verdict warning`` for
        the first line of a page.
    """

    kind: ClassVar[str] = "text"
    text: str
    tone: str = "plain"


@dataclass(frozen=True)
class Listing:
    """Several short sentences.

    Parameters
    ----------
    tone : str
        As of `Text`.
    """

    kind: ClassVar[str] = "listing"
    items: Sequence[str]
    tone: str = "plain"


@dataclass(frozen=True)
class Link:
    """A cell of a table that leads to another file.

    Parameters
    ----------
    address : str
        From the page's folder.
    """

    text: str
    address: str


@dataclass(frozen=True)
class HtmlTable:
    """Rows of cells.

    Parameters
    ----------
    wide : sequence of int
        Columns whose text may be broken into lines.
    """

    kind: ClassVar[str] = "table"
    columns: Sequence[str]
    rows: Sequence[Sequence[str | Link]]
    caption: str = ""
    wide: Sequence[int] = ()

    @classmethod
    def from_table(cls, shown: TerminalTable, wide: Sequence[int] = ()) -> HtmlTable:
        """Take over a table that the terminal shows."""
        columns = [[Marked.from_markup(str(c)).plain for c in of.cells] for of in shown.columns]
        headers = [Marked.from_markup(str(of.header)).plain for of in shown.columns]
        rows = list(zip(*columns, strict=True))
        title = Marked.from_markup(str(shown.title or "")).plain
        return cls(headers, rows, title, wide)


@dataclass(frozen=True)
class Facts:
    """Names with what they stand for."""

    kind: ClassVar[str] = "facts"
    pairs: Sequence[tuple[str, str]]


@dataclass(frozen=True)
class Figure:
    """A picture, in the page itself.

    Parameters
    ----------
    source : str
        A ``data:`` address, which has none of the characters ``<>&"``.
    only_print : bool
        Whether it stands in for what moves on a screen.
    """

    kind: ClassVar[str] = "figure"
    source: str
    caption: str
    only_print: bool = False


@dataclass(frozen=True)
class Shape:
    """The deflection shape that turns and moves, see `sldvexp.report.html.shape`.

    Parameters
    ----------
    data : dict
        What its script draws.
    name : str
        With which the names of its controls begin.
    """

    kind: ClassVar[str] = "shape"
    data: dict[str, Any]
    name: str = "shape"


@dataclass(frozen=True)
class Code:
    """Text as it is typed."""

    kind: ClassVar[str] = "code"
    text: str


@dataclass(frozen=True)
class More:
    """What is only shown when asked for."""

    kind: ClassVar[str] = "more"
    summary: str
    blocks: Sequence[Any]


@dataclass(frozen=True)
class Beside:
    """Columns with a title each."""

    kind: ClassVar[str] = "beside"
    titles: Sequence[str]
    columns: Sequence[Sequence[Any]]


@dataclass(frozen=True)
class Alternatives:
    """Columns of which one is shown, the first until another is chosen.

    Parameters
    ----------
    name : str
        Of the control.
    label : str
        What is chosen.
    titles : sequence of str
        Of the columns.
    """

    kind: ClassVar[str] = "choice"
    name: str
    label: str
    titles: Sequence[str]
    columns: Sequence[Sequence[Any]]


@dataclass(frozen=True)
class Lead:
    """The first screen: words and numbers, and beside them what is looked at."""

    kind: ClassVar[str] = "lead"
    told: Sequence[Any]
    shown: Sequence[Any]

    @property
    def blocks(self) -> list[Any]:
        """All of its blocks."""
        return [*self.told, *self.shown]


@dataclass(frozen=True)
class Section:
    """A part of a page with a heading.

    Parameters
    ----------
    title : str
    blocks : sequence of blocks
    unseen : bool
        Whether only a screen reader has the heading.
    """

    title: str
    blocks: Sequence[Any] = field(default_factory=tuple)
    unseen: bool = False

    @property
    def anchor(self) -> str:
        """What a link to it is called."""
        return self.title.lower().replace(" ", "-")


def having(*blocks: Any) -> list[Any]:
    """Keep the blocks that there are, in order; lists of blocks are joined."""
    found: list[Any] = []
    for block in blocks:
        if isinstance(block, Iterable):
            found += having(*block)
        elif block is not None:
            found.append(block)
    return found
