"""A console without a browser, and what tests need of one."""

from __future__ import annotations

import json
import queue
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect

from sldvexp.console.board import NoticeBoard
from sldvexp.console.server import Server
from sldvexp.virtual_lab.console import experiment

PATIENCE = 90.0

#: A plate and a calibration object in the virtual lab, which nobody has aimed at.
BENCH = """# @package _global_
defaults:
  - _self_
  - override /target: dissertation
  - override /scene: plate
  - override /scan: session
  - override /instrument: simulated
  - override /signal: sine_fit
  - override /pose: edge
  - override /volume: grid
scan:
  calibration:
    coarse: {lines: 3, pixels: 150}
    fine: {lines: 16}
    sampling: {samples: 128}
  structure:
    pixels: [15, 17]
    sampling: {frequency: [197.0], samples: 256}
volume: {size: [0.26, 0.21], shape: [9, 7], thickness: 0.024, margin: 0.016}
"""


class Heard:
    """A browser that is none: it says what it wishes and keeps what it is told."""

    def __init__(self, coming: ClientConnection) -> None:
        self.coming, self.line = coming, coming.__enter__()
        self.topics: dict[str, Any] = {}
        self.pictures: list[bytes] = []
        self.refused: list[str] = []
        self.role = ""

    def wish(self, what: str, **more: Any) -> None:
        self.line.send(json.dumps({"do": what, **more}))

    def leave(self) -> None:
        with suppress(Exception):
            self.coming.__exit__(None, None, None)

    def until(self, condition: Callable[[], object]) -> None:
        """Listen until a condition holds."""
        while not condition():
            told = self.line.recv(timeout=PATIENCE)
            if isinstance(told, bytes):
                self.pictures.append(told)
                continue
            word = json.loads(told)
            self.role = word.get("role", self.role)
            if "refused" in word:
                self.refused.append(word["refused"])
            elif "topic" in word:
                self.topics[word["topic"]] = word["word"]


@pytest.fixture
def wishes() -> queue.Queue[dict[str, Any]]:
    return queue.Queue()


@pytest.fixture
def board() -> NoticeBoard:
    return NoticeBoard()


@pytest.fixture
def server(board, wishes) -> Iterator[Server]:
    with Server(board, wishes, lambda: None) as made:
        yield made


@pytest.fixture
def join(server) -> Iterator[Callable[..., Heard]]:
    """Come as a browser; what differs from the page's own is said."""
    with ExitStack() as come:

        def joined(token: str | None = None, origin: str | None = "own", host: str = ""):
            line = socket.create_connection(("127.0.0.1", server.port))
            come.callback(line.close)
            host = host or f"127.0.0.1:{server.port}"
            wanted = f"http://{host}" if origin == "own" else origin
            address = f"ws://{host}/{token or server.token}/talk"
            made = connect(address, sock=line, origin=wanted, close_timeout=1, proxy=None)
            heard = Heard(made)
            come.callback(heard.leave)
            return heard

        yield joined


@pytest.fixture(scope="session")
def lab_experiment():
    """The plate of the virtual lab, with its circles, as an experiment that was made."""
    return experiment(["experiment=plate", "scan.structure.pixels=[9,11]"])
