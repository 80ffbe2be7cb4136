"""Tables for a terminal of any width: columns are left out before a number or a name is cut."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence

from rich.cells import cell_len
from rich.markup import escape
from rich.table import Column, Table
from rich.text import Text

#: Where text may go on in the next line: at spaces, and between the parts of a name.
PLACES = re.compile(r"(?<=\s)(?=\S)|(?<=[./@:])(?=[^\W\d]\w)|(?<=.)(?=\[)")
#: Characters of a table beside those of a column, and beside those of all.
BESIDE, RIM = 3, 1


def fitted(table: Table, width: int, keep: Collection[str] = (), rest: str = "") -> Table:
    """A table that is not wider than `width`.

    Parameters
    ----------
    table : Table
        Of columns with ``no_wrap``, cells stay in one line; other cells and all headers go on in
        the next line at spaces and between the parts of a name.
    width : int
        Characters of a line.
    keep : collection of str
        Headers of columns that stay; of the others those at the right are left out as needed.
    rest : str
        Where the columns that are left out can be read.
    """
    columns, left_out = list(table.columns), []
    for column in reversed(table.columns):
        if _width([_narrowest(c) for c in columns]) <= width:
            break
        if str(column.header) not in keep:
            columns = [c for c in columns if c is not column]
            left_out.append(_plain(column.header))
    widths = _shared(columns, width)
    caption = ""
    if left_out:
        which = f"{len(left_out)} more column{'s' * (len(left_out) > 1)}"
        caption = f"{which} in {rest}: {'; '.join(reversed(left_out))}"
    made = Table(title=table.title, title_justify="left", caption=caption, caption_justify="left")
    for column, own in zip(columns, widths, strict=True):
        # a last resort: what is kept and still too wide ends in dots
        header, whole = _broken(str(column.header), own), column.no_wrap
        made.add_column(header, no_wrap=whole, overflow="ellipsis" if whole else "fold")
    cells = [
        [str(c) if column.no_wrap else _broken(str(c), own) for c in column.cells]
        for column, own in zip(columns, widths, strict=True)
    ]
    for row in zip(*cells, strict=True):
        made.add_row(*row)
    return made


def _width(columns: Sequence[int]) -> int:
    """Of a table whose columns have these widths."""
    return sum(columns) + BESIDE * len(columns) + RIM


def _narrowest(column: Column) -> int:
    """Width that a column needs at least."""
    pieces = PLACES.split(_plain(column.header))
    for cell in map(_plain, column.cells):
        pieces += [cell] if column.no_wrap else PLACES.split(cell)
    return max(cell_len(piece.rstrip()) for piece in pieces)


def _shared(columns: Sequence[Column], width: int) -> list[int]:
    """Widths of the columns: as they are, or headers and then the widest cells in more lines."""
    least = [_narrowest(c) for c in columns]
    widths = [max(cell_len(_plain(t)) for t in (c.header, *c.cells)) for c in columns]
    while _width(widths) > width and widths != least:
        able = [i for i, (w, n) in enumerate(zip(widths, least, strict=True)) if w > n]
        headers = [i for i in able if columns[i].no_wrap]
        widths[max(headers or able, key=lambda i: widths[i])] -= 1
    return widths


def _broken(marked: str, width: int) -> str:
    """A cell with its text in lines of at most so many characters, if its parts are that short."""
    text = _plain(marked)
    if cell_len(text) <= width:
        return marked
    lines = [""]
    for piece in PLACES.split(text):
        if lines[-1] and cell_len(lines[-1] + piece.rstrip()) > width:
            lines.append("")
        lines[-1] += piece
    return escape("\n".join(line.rstrip() for line in lines))


def _plain(marked: object) -> str:
    """A cell's text without its markup."""
    return Text.from_markup(str(marked)).plain
