"""A terminal of so many columns: what stands on its screen after what was written to it."""

from __future__ import annotations

import re

#: Text, a line break or return, and the sequences that the program's rows use.
TOKEN = re.compile(r"\x1b\[(\??[\d;]*)([A-Za-z])|([\r\n])|([^\x1b\r\n]+)")


class Screen:
    """A screen without an end at the bottom.

    Parameters
    ----------
    columns : int
    """

    def __init__(self, columns: int) -> None:
        self.columns = columns
        self.lines: list[list[str]] = [[]]
        self.row = self.column = 0
        self.cursor = True
        self.wrapped = False
        self.colours: set[str] = set()

    def feed(self, text: str) -> Screen:
        """Take what a program writes; a sequence that is not known is an error."""
        at = 0
        while at < len(text):
            found = TOKEN.match(text, at)
            assert found, repr(text[at : at + 20])
            at = found.end()
            number, code, move, words = found.groups()
            if words:
                self._write(words)
            elif move == "\r":
                self.column = 0
            elif move == "\n":
                self._to(self.row + 1)
            else:
                self._act(number, code)
        return self

    @property
    def text(self) -> list[str]:
        """Lines of the screen, without those that are empty at the end."""
        lines = ["".join(line).rstrip() for line in self.lines]
        while lines and not lines[-1]:
            lines.pop()
        return lines

    def _act(self, number: str, code: str) -> None:
        if code == "m":
            self.colours.update(number.split(";"))
        elif code == "A":
            self.row -= int(number or 1)
            assert self.row >= 0
        elif code == "K" and number == "2":
            self.lines[self.row] = []
        elif code in "hl" and number == "?25":
            self.cursor = code == "h"
        else:
            raise AssertionError((number, code))

    def _to(self, row: int) -> None:
        self.row = row
        while len(self.lines) <= row:
            self.lines.append([])

    def _write(self, words: str) -> None:
        for char in words:
            if self.column == self.columns:  # it goes on in the next line
                self.wrapped = True
                self._to(self.row + 1)
                self.column = 0
            line = self.lines[self.row]
            line.extend(" " * (self.column + 1 - len(line)))
            line[self.column] = char
            self.column += 1
