"""The person at the terminal: asked when something must be done by hand."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

from sldvexp.errors import UserError


class NobodyThereError(UserError):
    """Something must be done by hand, but there is nobody to ask."""


class Operator:
    """Asks at the terminal.

    Parameters
    ----------
    screen : callable, optional
        Makes a context in which nothing else is drawn there.
    """

    def __init__(self, screen: Callable[[], AbstractContextManager[object]] = nullcontext) -> None:
        self._screen = screen

    def ask(self, request: str) -> str:
        """Show a request and wait for a line, which is returned without spaces around it.

        Raises
        ------
        NobodyThereError
            If the input has ended.
        """
        with self._screen():
            try:
                return input(request).strip()
            except EOFError:
                what = request.strip().splitlines()[-1].rstrip(":")
                raise NobodyThereError(f"nobody is at the terminal to answer {what!r}") from None
