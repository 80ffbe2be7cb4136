"""A line to one device, through VISA."""

from __future__ import annotations

import os
import re
import select
import socket
import time
from typing import Any, Protocol

from sldvexp.instrument.protocol import InstrumentError
from sldvexp.lazy import pyvisa

#: Bytes read at once; each such part may take as long as a whole answer.
CHUNK = 2**16

#: Bytes of the longest line that an instrument may send.
LONGEST_LINE = 2**20
#: Pauses of the time-out that an answer may take as a whole.
PAUSES = 5
#: Bytes a second that a block of samples must come with at least.
SLOWEST = 2000.0


class DisturbanceError(InstrumentError):
    """Failure that may be gone at the next try: no answer, a lost connection, garbage."""


class BrokenOffError(DisturbanceError):
    """Beginning of an answer came, and then nothing."""


class Line(Protocol):
    """Messages to a device and bytes from it."""

    def send(self, message: bytes) -> None:
        """Send all bytes."""

    def receive_line(self, end: bytes, patience: float) -> bytes:
        """Receive the bytes up to `end`, which is left away.

        The first is waited for `patience` s.
        """

    def receive(self, count: int, patience: float) -> bytes:
        """Receive so many bytes."""

    def close(self) -> None:
        """Hang up."""


class VisaLine:
    """A VISA session as a `Line`.

    Parameters
    ----------
    resource : str
        As in ``TCPIP::127.0.0.1::5025::SOCKET`` or ``GPIB0::9::INSTR``.
    backend : str
        PyVISA's, ``@py`` or ``@ivi``.
    timeout : float, s
        Longest pause inside an answer.

    Raises
    ------
    InstrumentError
        If there can be no such session.
    DisturbanceError
        If nobody answers there.
    """

    def __init__(self, resource: str, backend: str, timeout: float) -> None:
        self._timeout = timeout
        milliseconds = max(1, round(1000 * timeout))
        try:
            manager = pyvisa.ResourceManager(backend)
            opened: Any = manager.open_resource(resource, open_timeout=milliseconds)
        except (pyvisa.VisaIOError, OSError) as error:
            raise DisturbanceError(f"{resource} cannot be reached: {_first_line(error)}") from error
        except Exception as error:  # backends raise what they like for what they do not know
            raise InstrumentError(f"{resource} cannot be opened: {_first_line(error)}") from error
        self._session: pyvisa.resources.MessageBasedResource = opened
        self._session.timeout = milliseconds
        self._errors = (pyvisa.VisaIOError, OSError)
        self._link = getattr(opened.visalib, "sessions", {}).get(opened.session)
        self._socket = _socket_of(self._link)
        if self._socket is not None:
            if refused := self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
                self.close()
                raise DisturbanceError(f"{resource} cannot be reached: {os.strerror(refused)}")
            # Without this a question that follows a command waits 40 ms for an acknowledgement.
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, message: bytes) -> None:
        """See `Line`."""
        try:
            self._session.write_raw(message)
        except self._errors as error:
            raise DisturbanceError(f"the connection was lost ({_first_line(error)})") from error

    def receive_line(self, end: bytes, patience: float) -> bytes:
        """See `Line`."""
        shown = f"the end {end.decode('latin-1')!r} of a line, its answer_end in the profile,"
        if self._socket is not None and hasattr(self._link, "_pending_buffer"):
            return self._line_of(self._socket, end, patience, shown)
        self._session.read_termination = end.decode("latin-1")
        try:
            line = self._received(
                lambda: self._session.read_bytes(LONGEST_LINE, CHUNK, break_on_termchar=True),
                patience,
            )
        except BrokenOffError as error:
            raise DisturbanceError(f"{shown} did not come ({error})") from error
        if not line.endswith(end):
            raise DisturbanceError(f"{shown} did not come within {len(line)} bytes")
        return line.removesuffix(end)

    def _line_of(self, link: socket.socket, end: bytes, patience: float, shown: str) -> bytes:
        """Read a line of a socket."""
        read = self._begun(link, patience)
        longest = patience + PAUSES * self._timeout
        until = time.monotonic() + longest
        while end not in read:
            if len(read) > LONGEST_LINE:
                raise DisturbanceError(f"{shown} did not come within {LONGEST_LINE} bytes")
            if time.monotonic() > until:
                raise DisturbanceError(f"{shown} did not come within {longest:.3g} s")
            try:
                read += self._part(link)
            except BrokenOffError as error:
                raise DisturbanceError(f"{shown} did not come ({error})") from error
        line, _, rest = bytes(read).partition(end)
        read[:] = rest
        return line

    def _block_of(self, link: socket.socket, count: int, patience: float) -> bytes:
        """Read so many bytes of a socket."""
        read = self._begun(link, patience)
        longest = patience + PAUSES * self._timeout + count / SLOWEST
        until = time.monotonic() + longest
        while len(read) < count:
            if time.monotonic() > until:
                told = f"the answer broke off ({len(read)} of {count} bytes in {longest:.3g} s)"
                raise BrokenOffError(told)
            read += self._part(link)
        block = bytes(read[:count])
        del read[:count]
        return block

    def _begun(self, link: socket.socket, patience: float) -> bytearray:
        """Wait for an answer to begin; what PyVISA-py has read of it, to which more is added.

        PyVISA-py itself waits for ever for an answer whose bytes come one by one.
        """
        assert self._link is not None
        read: bytearray = self._link._pending_buffer
        if not read:
            self._wait(link, patience)
        return read

    def _part(self, link: socket.socket) -> bytes:
        """Wait for more of an answer."""
        ready, _, _ = select.select([link], [], [], self._timeout)
        if not ready:
            raise BrokenOffError(f"the answer broke off (nothing for {self._timeout:.3g} s)")
        try:
            part = link.recv(CHUNK)
        except OSError as error:
            raise DisturbanceError(f"the connection was lost ({error})") from error
        if not part:
            raise DisturbanceError("the connection was lost in the middle of the answer")
        return part

    def receive(self, count: int, patience: float) -> bytes:
        """See `Line`."""
        if self._socket is not None and hasattr(self._link, "_pending_buffer"):
            return self._block_of(self._socket, count, patience)
        self._session.read_termination = None  # a byte of data may look like the end of a line
        return self._received(lambda: self._session.read_bytes(count, CHUNK), patience)

    def close(self) -> None:
        """See `Line`."""
        self._session.close()

    def _received(self, read: Any, patience: float) -> bytes:
        """Return what a reading function returns, or what came in its way."""
        if self._socket is None:
            self._session.timeout = max(1, round(1000 * max(patience, self._timeout)))
        elif not getattr(self._link, "_pending_buffer", b""):  # or PyVISA-py read it already
            self._wait(self._socket, patience)
        try:
            return bytes(read())
        except self._errors as error:
            if self._socket is not None and _closed(self._socket):
                raise DisturbanceError(
                    "the connection was lost in the middle of the answer"
                ) from error
            raise BrokenOffError(f"the answer broke off ({_first_line(error)})") from error

    def _wait(self, link: socket.socket, patience: float) -> None:
        """Wait for an answer to begin; PyVISA itself does not notice a connection that ends."""
        ready, _, _ = select.select([link], [], [], patience)
        if not ready:
            raise DisturbanceError(f"there was no answer within {patience:.3g} s")
        if _closed(link):
            raise DisturbanceError("the connection was lost")


#: Last parts of VISA's names.
CLASSES = ("INSTR", "SOCKET", "RAW", "INTFC")


def canonical_resource(name: str) -> str:
    """Write VISA's name of a device as VISA libraries expect it, whose keywords are capitals.

    Parameters
    ----------
    name : str
        As somebody wrote it.

    Raises
    ------
    ValueError
        If the name is of a kind that people often write for another; says which.

    Examples
    --------
    >>> canonical_resource("tcpip0::192.168.0.7::5025::socket ")
    'TCPIP0::192.168.0.7::5025::SOCKET'
    >>> canonical_resource("TCPIP::192.168.0.7::5025")
    Traceback (most recent call last):
        ...
    ValueError: names no socket: write TCPIP::192.168.0.7::5025::SOCKET
    """
    text = name.strip()
    if address := re.fullmatch(r"(?:tcp://)?([\w.-]+):(\d+)", text):
        raise ValueError(f"is no name of VISA's: write TCPIP::{address[1]}::{address[2]}::SOCKET")
    if serial := re.fullmatch(r"COM(\d+)", text, re.IGNORECASE):
        raise ValueError(f"is no name of VISA's: write ASRL{serial[1]}::INSTR")
    if text.startswith("/dev/"):
        raise ValueError(f"is no name of VISA's: write ASRL{text}::INSTR")
    first, *rest = text.split("::")
    keyword = re.match(r"(TCPIP|GPIB|USB|ASRL|VXI|PXI)(?=\d*$|/)", first, re.IGNORECASE)
    if keyword is None:
        return text
    first = keyword[0].upper() + first[keyword.end() :]
    if rest and rest[-1].upper() in CLASSES:
        rest[-1] = rest[-1].upper()
    if first.startswith("TCPIP") and len(rest) > 1 and rest[1].isdigit() and rest[2:] != ["SOCKET"]:
        raise ValueError(f"names no socket: write {first}::{rest[0]}::{rest[1]}::SOCKET")
    return "::".join([first, *rest])


def _socket_of(link: Any) -> socket.socket | None:
    """Find the socket of a session of PyVISA-py, None if it has none."""
    interface = getattr(link, "interface", None)
    return interface if isinstance(interface, socket.socket) else None


def _closed(link: socket.socket) -> bool:
    """Tell whether the other side has hung up, and nothing is left to read."""
    try:
        return link.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT) == b""
    except BlockingIOError:
        return False
    except OSError:
        return True


def _first_line(error: Exception) -> str:
    """Say what an error says, in one line."""
    return (str(error).strip() or type(error).__name__).splitlines()[0].rstrip(".")
