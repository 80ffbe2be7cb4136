"""The person at the terminal, who is asked when something must be done by hand."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from sldvexp import instrument
from sldvexp.errors import UserError
from sldvexp.session.keyboard import Keyboard, TerminalLostError
from sldvexp.session.watching import Watcher


class NobodyThereError(UserError):
    """Something must be done by hand, but there is nobody to ask."""


class Operator:
    """Asks at the terminal.

    Parameters
    ----------
    watcher : Watcher, optional
        Told of it, so that nothing else is drawn there.
    """

    def __init__(self, watcher: Watcher | None = None) -> None:
        self._watcher = watcher or Watcher()

    def ask(self, request: str) -> str:
        """Show a request and wait for a line, which is returned without spaces around it.

        Raises
        ------
        NobodyThereError
            If the input has ended.
        """
        with self._watcher.asking(request):
            try:
                return input(request).strip()
            except EOFError:
                what = request.strip().splitlines()[-1].rstrip(":")
                raise NobodyThereError(f"nobody is at the terminal to answer {what!r}") from None

    def wait_for(self, request: str) -> None:
        """Show a request, and wait until it is done, which Enter says.

        Raises
        ------
        NobodyThereError
            If the input has ended.
        """
        self.ask(request)

    def person(self, view: str) -> instrument.person.Person | None:
        """Give who has aimed in a view already, in the place of all others; None if nobody has."""
        return None

    @contextmanager
    def keyboard(self) -> Iterator[Keyboard | None]:
        """Give the keys of the terminal one by one; None if there is none to sit at.

        Raises
        ------
        NobodyThereError
            If the terminal is lost.
        """
        if not Keyboard.is_there():
            yield None
            return
        try:
            with self._watcher.asking(""), Keyboard() as keyboard:
                yield keyboard
        except TerminalLostError:
            raise NobodyThereError("nobody is at the terminal any more") from None
