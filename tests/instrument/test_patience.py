"""A device that says nothing, or too little, is waited for as long as was asked for."""

from __future__ import annotations

import socket
import time

import pytest

from sldvexp.instrument import DisturbanceError
from sldvexp.instrument.connection import VisaLine

PATIENCE = 0.2


@pytest.fixture
def device():
    """A device that says nothing by itself, and its name."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener, f"TCPIP::127.0.0.1::{listener.getsockname()[1]}::SOCKET"


def test_an_answer_that_does_not_begin(device):
    line = VisaLine(device[1], "@py", timeout=60.0)
    begin = time.monotonic()
    with pytest.raises(DisturbanceError, match=r"^there was no answer within 0\.2 s$"):
        line.receive_line(b"\n", PATIENCE)
    assert time.monotonic() - begin >= PATIENCE
    line.close()


def test_an_answer_that_breaks_off(device):
    listener, resource = device
    line = VisaLine(resource, "@py", timeout=PATIENCE)
    with listener.accept()[0] as there:
        there.sendall(b"#1")
        begin = time.monotonic()
        with pytest.raises(DisturbanceError, match=r"^the answer broke off \(nothing for 0\.2 s\)"):
            line.receive(3, patience=60.0)
        assert time.monotonic() - begin >= PATIENCE
    line.close()
