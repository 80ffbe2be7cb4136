"""The virtual lab as a TCP server on this machine: one client at a time, one command a line."""

from __future__ import annotations

import socket
import threading
from collections.abc import Sequence
from contextlib import suppress
from typing import TYPE_CHECKING

from sldvexp.virtual_lab.dialect import Dialect
from sldvexp.virtual_lab.lab import VirtualLab

if TYPE_CHECKING:
    from sldvexp.testing.faults import Fault

#: How soon the server notices that it shall stop, s.
POLL = 0.02

RECEIVED = 2**16


class LabServer:
    """A virtual lab that listens on a socket.

    As a context manager it serves in a thread of its own.

    Parameters
    ----------
    lab : VirtualLab
    host : str
    port : int
        0 takes a free one.
    faults : sequence of Fault
        What shall go wrong.
    """

    def __init__(
        self,
        lab: VirtualLab,
        host: str = "127.0.0.1",
        port: int = 0,
        faults: Sequence[Fault] = (),
    ) -> None:
        self.dialect = Dialect(lab)
        self.faults = list(faults)
        self.stopping = threading.Event()
        self._listener = socket.create_server((host, port), backlog=5)
        self._listener.settimeout(POLL)
        self._address = self._listener.getsockname()
        self._client: socket.socket | None = None
        self._thread = threading.Thread(target=self.serve, daemon=True)

    @property
    def resource(self) -> str:
        """VISA's name of this server."""
        host, port = self._address
        return f"TCPIP::{host}::{port}::SOCKET"

    def __enter__(self) -> LabServer:
        self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self.stopping.set()
        if self._client is not None:
            with suppress(OSError):
                self._client.shutdown(socket.SHUT_RDWR)  # wakes a thread that sends to nobody
        self._thread.join()
        self._listener.close()

    def go_down(self) -> None:
        """Stop listening, from within the server's own thread."""
        self._listener.close()
        self.stopping.set()

    def serve(self) -> None:
        """Serve one client after the other until `stopping` is set."""
        while not self.stopping.is_set():
            with suppress(TimeoutError):
                client, _ = self._listener.accept()
                self._client = client
                with client, suppress(ConnectionError):
                    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._serve_client(client)

    def _serve_client(self, client: socket.socket) -> None:
        """Answer every line until the client goes."""
        pending = b""
        while True:
            *lines, pending = (pending + self._received(client)).split(b"\n")
            for line in lines:
                self._answer(line.decode("ascii", errors="replace"), client)

    def _received(self, client: socket.socket) -> bytes:
        client.settimeout(POLL)
        while not self.stopping.is_set():
            with suppress(TimeoutError):
                received = client.recv(RECEIVED)
                if not received:
                    raise ConnectionAbortedError
                client.settimeout(None)
                return received
        raise ConnectionAbortedError

    def _answer(self, line: str, client: socket.socket) -> None:
        answer = self.dialect.answer(line)
        fault = next((f for f in self.faults if f.strikes(line)), None)
        if fault is not None:
            fault.spoil(answer or b"", client.sendall, self)
        elif answer is not None:
            client.sendall(answer)
