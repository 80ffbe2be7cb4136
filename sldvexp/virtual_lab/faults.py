"""What can go wrong with an instrument, on purpose: for tests of whoever talks to the server."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sldvexp.virtual_lab.server import LabServer

Send = Callable[[bytes], None]


@dataclass
class Fault(ABC):
    """A fault that strikes at a command.

    Parameters
    ----------
    command : str
        Beginning of the lines at which it strikes.
    times : int
        How often it strikes.
    after : int
        At how many such lines it does not strike before.
    """

    command: str
    times: int = 1
    after: int = 0

    def strikes(self, line: str) -> bool:
        """Whether it strikes now; that time is used up."""
        if not line.startswith(self.command):
            return False
        if self.after > 0:
            self.after -= 1
            return False
        self.times -= 1
        return self.times >= 0

    @abstractmethod
    def spoil(self, answer: bytes, send: Send, server: LabServer) -> None:
        """Do something else than to send the answer (empty for a command)."""


@dataclass
class Silence(Fault):
    """No answer."""

    def spoil(self, answer: bytes, send: Send, server: LabServer) -> None:
        """Send nothing."""


@dataclass
class Slow(Fault):
    """The answer comes late, or in small parts.

    Parameters
    ----------
    delay : float, s
        Before each part.
    parts : int
    """

    delay: float = 0.1
    parts: int = 1

    def spoil(self, answer: bytes, send: Send, server: LabServer) -> None:
        """Send it part by part."""
        size = -(-len(answer) // self.parts)
        for begin in range(0, len(answer), max(size, 1)):
            server.stopping.wait(self.delay)
            send(answer[begin : begin + size])


@dataclass
class Garbage(Fault):
    """Random bytes in place of the answer, as many.

    Parameters
    ----------
    seed : int
    """

    seed: int = 0

    def spoil(self, answer: bytes, send: Send, server: LabServer) -> None:
        """Send them, with the end of a line."""
        send(np.random.default_rng(self.seed).bytes(max(len(answer) - 1, 1)) + b"\n")


@dataclass
class Instead(Fault):
    """A text in place of the answer, such as ``nan``.

    Parameters
    ----------
    text : str
    """

    text: str = "nan"

    def spoil(self, answer: bytes, send: Send, server: LabServer) -> None:
        """Send the text."""
        send(self.text.encode() + b"\n")


@dataclass
class Cut(Fault):
    """Bytes are missing at the end of the answer.

    Parameters
    ----------
    missing : int
    """

    missing: int = 100

    def spoil(self, answer: bytes, send: Send, server: LabServer) -> None:
        """Send the others."""
        send(answer[: -self.missing])


@dataclass
class ShortBlock(Fault):
    """A block in good order that holds too little.

    Parameters
    ----------
    missing : int
        Bytes.
    """

    missing: int = 100

    def spoil(self, answer: bytes, send: Send, server: LabServer) -> None:
        """Send a shorter block."""
        begin = 2 + int(answer[1:2])
        content = answer[begin : -1 - self.missing]
        length = str(len(content)).encode()
        send(b"#" + str(len(length)).encode() + length + content + b"\n")


@dataclass
class Disconnect(Fault):
    """The connection ends within the answer.

    Parameters
    ----------
    sent : int
        Bytes that still arrive.
    """

    sent: int = 0

    def spoil(self, answer: bytes, send: Send, server: LabServer) -> None:
        """Send these and hang up."""
        send(answer[: self.sent])
        raise ConnectionAbortedError


@dataclass
class Refusal(Fault):
    """An entry in the queue of errors.

    Parameters
    ----------
    code : int
    text : str
    """

    code: int = -240
    text: str = "Hardware error"

    def spoil(self, answer: bytes, send: Send, server: LabServer) -> None:
        """Put the entry there, and answer."""
        server.dialect.report(self.code, self.text)
        send(answer)


@dataclass
class GeneratorDies(Fault):
    """The generator's output goes off."""

    def spoil(self, answer: bytes, send: Send, server: LabServer) -> None:
        """Turn it off, and answer."""
        server.dialect.stop_generator()
        send(answer)


@dataclass
class ShutterCloses(Fault):
    """The laser's shutter closes."""

    def spoil(self, answer: bytes, send: Send, server: LabServer) -> None:
        """Close it, and answer."""
        server.dialect.lab.shutter_open = False
        send(answer)


@dataclass
class Surplus(Fault):
    """A byte too many before the end of the answer."""

    def spoil(self, answer: bytes, send: Send, server: LabServer) -> None:
        """Send it with one byte more."""
        send(answer[:-1] + b"x" + answer[-1:])
