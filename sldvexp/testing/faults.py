"""Faults of an instrument, on purpose: for tests of whoever talks to the server."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp.virtual_lab import LabServer
from sldvexp.virtual_lab.server import Fault, Send, block


@dataclass
class Silence(Fault):
    """No answer."""

    def spoil(self, answer: bytes, send: Send, server: LabServer) -> None:
        """Send nothing."""


@dataclass
class Slow(Fault):
    """Answer comes late, or in small parts.

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
    """Connection ends within the answer.

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
class ServerDies(Fault):
    """Server goes down within the answer, and nobody listens there any more.

    Parameters
    ----------
    sent : int
        Bytes that still arrive.
    """

    sent: int = 0

    def spoil(self, answer: bytes, send: Send, server: LabServer) -> None:
        """Send these and go down."""
        send(answer[: self.sent])
        server.go_down()
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
    """Generator's output goes off."""

    def spoil(self, answer: bytes, send: Send, server: LabServer) -> None:
        """Turn it off, and answer."""
        server.dialect.stop_generator()
        send(answer)


@dataclass
class ShutterCloses(Fault):
    """Laser's shutter closes."""

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


@dataclass
class Backwards(Fault):
    """A digitiser that sends the last sample of each pixel first."""

    def spoil(self, answer: bytes, send: Send, server: LabServer) -> None:
        """Turn the samples round."""
        head, counts = _parts(answer)
        samples = server.dialect.samples
        send(head + counts.reshape(-1, samples)[:, ::-1].tobytes() + b"\n")


@dataclass
class Volts(Fault):
    """A digitiser that sends volts (float32) instead of counts.

    Parameters
    ----------
    spoilt : int
        At which block the first sample is not a number; 0 for none.
    """

    spoilt: int = 0

    def spoil(self, answer: bytes, send: Send, server: LabServer) -> None:
        """Send the volts."""
        _, counts = _parts(answer)
        scale = np.array(server.dialect.scale())[:, None]
        volts = counts.reshape(-1, len(scale), server.dialect.samples) * scale
        self.spoilt -= 1
        if self.spoilt == 0:
            volts[0, 0, 0] = np.nan
        send(block(volts.astype("<f4").data) + b"\n")


def _parts(answer: bytes) -> tuple[bytes, NDArray[np.int16]]:
    """Name header and counts of a block."""
    begin = 2 + int(answer[1:2])
    return answer[:begin], np.frombuffer(answer[begin:-1], "<i2")
