"""Virtual lab as a TCP server on this machine: one client at a time, one command a line.

The virtual lab's own commands, in the manner of SCPI; a profile teaches them to the program.
"""

from __future__ import annotations

import socket
import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version

import numpy as np

from sldvexp.errors import UserError
from sldvexp.instrument import Acquisition, InstrumentError, RawSamples
from sldvexp.signal import Excitation, ExcitationKind, LineChoice
from sldvexp.virtual_lab.lab import VirtualLab

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
        """Stop listening, from within the server's own thread, which `__exit__` would wait for.

        No new client is taken and `serve` ends; the client that is connected is left alone.
        """
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


#: SCPI's codes of errors.
UNKNOWN_HEADER, DATA_TYPE, REFUSED, SETTINGS_CONFLICT = -113, -104, -222, -221

#: Names of what the generator plays instead of tones.
FUNCTIONS = {
    "MSIN": ExcitationKind.multisine,
    "CHIR": ExcitationKind.chirp,
    "PRAN": ExcitationKind.pseudo_random,
    "BRAN": ExcitationKind.burst_random,
    "NOIS": ExcitationKind.random,
    "HAMM": ExcitationKind.hammer,
}

#: Sampling until it is set.
DEFAULT = Acquisition(rate=10000.0, samples=256, excitation=())


class Dialect:
    """Answers command lines with a virtual lab behind them.

    Parameters
    ----------
    lab : VirtualLab
    """

    def __init__(self, lab: VirtualLab) -> None:
        self.lab = lab
        self.errors: deque[tuple[int, str]] = deque()
        self.playing = False
        self._wanted = DEFAULT
        self._played: Excitation | None = None  # instead of tones
        self._samples: RawSamples | None = None
        self._configure()
        self._commands = {
            "*CLS": self._clear,
            "VIEW": self._view,
            "SAMP:RATE": self._rate,
            "SAMP:COUN": self._count,
            "GEN:FREQ": self._frequencies,
            "GEN:AMPL": self._amplitude,
            "GEN:FUNC": self._function,
            "GEN:BAND": self._band,
            "GEN:LINE": lambda name: self._play(lines=LineChoice[name]),
            "GEN:SEED": lambda number: self._play(seed=int(number)),
            "GEN:BURS": lambda share: self._play(burst=float(share)),
            "GEN:OUTP": self._output,
            "SAMP:REC": self._records,
            "MIRR:POS": self._move,
            "MIRR:HOME": self._home,
            "MEAS:STR": self._stream,
            "MEAS:PIX": self._pixel,
            "MEAS:LIST": self._list,
        }
        self._questions = {
            "*IDN?": lambda: f"sldvexp,virtual lab,0,{_version()}".encode(),
            "SYST:ERR?": self._oldest_error,
            "SAMP:RATE?": lambda: repr(float(self._wanted.rate)).encode(),
            "CHAN:SCAL?": lambda: ",".join(map(repr, self.scale())).encode(),
            "GEN:OUTP?": lambda: b"1" if self.playing else b"0",
            "LAS:SHUT?": lambda: b"OPEN" if self.lab.shutter_open else b"CLOSED",
            "LAS:LEV?": lambda: repr(self.lab.light_level()).encode(),
            "CAM:PICT?": lambda: block(self.lab.picture().data),
            "MIRR:POS?": lambda: ",".join(map(str, self.lab.position)).encode(),
            "DATA?": lambda: block(self._last().counts.astype("<i2", copy=False).data),
            "STAT?": lambda: block(self._last().status.data),
        }

    def answer(self, line: str) -> bytes | None:
        """Answer a line, with its end; None if it is a command, or is refused."""
        word, _, argument = line.strip().partition(" ")
        try:
            if word in self._questions:
                return self._questions[word]() + b"\n"
            if word in self._commands:
                self._commands[word](argument.strip())
            elif word:
                self.report(UNKNOWN_HEADER, f"Undefined header; {word[:40]}")
        except (ValueError, KeyError) as error:
            self.report(DATA_TYPE, f"Data type error; {word}: {error}")
        except (InstrumentError, UserError) as error:
            self.report(REFUSED, f"Data out of range; {error}")
        return None

    @property
    def samples(self) -> int:
        """Samples of each pixel and channel."""
        return self._wanted.samples

    def report(self, code: int, text: str) -> None:
        """Put an error into the queue."""
        self.errors.append((code, text))

    def stop_generator(self) -> None:
        """Switch the generator off."""
        self.playing = False
        self._configure()

    def _configure(self, **changes: object) -> None:
        """Change the sampling, unless the lab refuses."""
        wanted = replace(self._wanted, **changes)  # type: ignore[arg-type]
        self.lab.configure(wanted)
        if not self.playing:
            self.lab.configure(wanted.silent)
        self._wanted = wanted

    def _clear(self, argument: str) -> None:
        self.errors.clear()

    def _oldest_error(self) -> bytes:
        code, text = self.errors.popleft() if self.errors else (0, "No error")
        printable = text.encode("ascii", errors="replace").decode().replace('"', "'")
        return f'{code},"{printable}"'.encode()

    def _view(self, argument: str) -> None:
        self.lab.use_view(argument)

    def _rate(self, argument: str) -> None:
        self._configure(rate=float(argument))

    def _count(self, argument: str) -> None:
        self._configure(samples=int(argument))

    def _frequencies(self, argument: str) -> None:
        self._played = None
        self._configure(excitation=tuple(float(f) for f in argument.split(",")), drive=None)

    def _function(self, argument: str) -> None:
        self._play(kind=FUNCTIONS[argument])

    def _band(self, argument: str) -> None:
        self._play(band=[float(f) for f in argument.split(",")])

    def _play(self, **changes: object) -> None:
        """Change what is played instead of tones when the output is switched on again."""
        self._played = replace(self._played or Excitation(), **changes)  # type: ignore[arg-type]

    def _records(self, argument: str) -> None:
        records, lead, trigger = argument.split(",")
        self._configure(records=int(records), lead=int(lead), triggered=trigger == "generator")

    def _amplitude(self, argument: str) -> None:
        self._configure(amplitude=float(argument))

    def _output(self, argument: str) -> None:
        self.playing = bool(int(argument))
        if self.playing and self._played is not None:
            wanted = self._wanted
            played = replace(self._played, amplitude=wanted.amplitude)
            design = played.design(wanted.rate, wanted.samples)
            self._configure(drive=design, excitation=())
        else:
            self._configure()

    def _move(self, argument: str) -> None:
        self.lab.move([int(step) for step in argument.split(",")])

    def _home(self, argument: str) -> None:
        self.lab.move((0, 0))

    def _stream(self, argument: str) -> None:
        self.lab.start_stream(int(argument))

    def _pixel(self, argument: str) -> None:
        self._samples = None
        self._samples = self.lab.acquire()

    def _list(self, argument: str) -> None:
        self._samples = None
        steps = np.array([int(step) for step in argument.split(",")], np.int64)
        if len(steps) % 2:
            raise ValueError("positions come in pairs")
        self._samples = self.lab.scan(steps.reshape(-1, 2))

    def _last(self) -> RawSamples:
        if self._samples is None:
            self.report(SETTINGS_CONFLICT, "Settings conflict; nothing was measured")
            return RawSamples(np.zeros((0, 2, 0), np.int16), np.zeros(2), 0.0)
        return self._samples

    def scale(self) -> list[float]:
        """Return volts per count of each channel."""
        digitizer = self.lab.scene.digitizer
        return [digitizer.velocity_range / 2**15, digitizer.reference_range / 2**15]


def block(content: memoryview) -> bytes:
    """Make an IEEE 488.2 definite length block."""
    length = str(content.nbytes)
    return b"#" + str(len(length)).encode() + length.encode() + content.tobytes()


def _version() -> str:
    try:
        return version("sldvexp")
    except PackageNotFoundError:
        return "0"


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
        """Tell whether it strikes now; that time is used up."""
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
