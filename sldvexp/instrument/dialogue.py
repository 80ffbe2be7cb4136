"""Commands, questions and blocks of samples, as a profile says, over lines to its devices.

`Dialogue` speaks; `Persistence` repeats a step over a new connection when something disturbs it;
`decoded` turns a block of bytes into samples.
"""

from __future__ import annotations

import logging
import math
import re
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from sldvexp.instrument.connection import DisturbanceError, Line
from sldvexp.instrument.profile import (
    ChannelOrder,
    Commands,
    Data,
    Device,
    Header,
    Profile,
    SampleType,
)
from sldvexp.instrument.protocol import CHANNELS, InstrumentError, RawSamples, Status
from sldvexp.typing import Array

#: Errors that are read from a queue at most.
QUEUE = 20

#: Characters of a command or an answer that messages show.
SHOWN = 40


class Dialogue:
    """Lines to all devices of a profile.

    Parameters
    ----------
    profile : Profile
    connect : callable
        Opens the line to the device of that name.
    timeout : float, s
        How long an answer may take.

    Raises
    ------
    InstrumentError
        For every fault; as `DisturbanceError` if it may be gone at the next try.
    """

    def __init__(self, profile: Profile, connect: Callable[[str], Line], timeout: float) -> None:
        self.profile = profile
        self.timeout = timeout
        self._lines: dict[str, Line] = {}
        try:
            for name, device in profile.devices.items():
                self._lines[name] = _told(name, "", connect, name)
                self._greet(name, device)
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Hang up."""
        for line in self._lines.values():
            line.close()
        self._lines = {}

    def run(
        self, commands: Commands, values: Mapping[str, object] | None = None, patience: float = 0.0
    ) -> None:
        """Send a group of commands; afterwards every device it addressed is asked for errors.

        Parameters
        ----------
        values : mapping, optional
            Of the placeholders.
        patience : float, s
            How much longer than usual the devices may be busy with them.
        """
        for device, texts in commands.items():
            filled = [text.format(**(values or {})) for text in texts]
            for text in filled:
                self._send(device, text)
            if filled:
                self.require_no_error(device, "; ".join(filled), patience)

    def ask(self, device: str, question: str, patience: float = 0.0) -> str:
        """Ask a question; the line that answers it."""
        self._send(device, question)
        end = self._ends(device)[1]
        line = self._lines[device]
        answer = _told(device, question, line.receive_line, end, self.timeout + patience)
        return answer.decode("ascii", errors="replace").strip()

    def numbers(self, device: str, question: str, count: int) -> list[float]:
        """Ask a question; the finite numbers that answer it, separated by commas."""
        answer = self.ask(device, question)
        try:
            values = [float(text) for text in answer.split(",")]
        except ValueError:
            values = []
        if len(values) != count or not all(math.isfinite(v) for v in values):
            wanted = "a finite number" if count == 1 else f"{count} finite numbers"
            raise DisturbanceError(
                f"{device} answered {_short(answer)} to {question}, where {wanted} had to come"
            )
        return values

    def block(self, question: str, count: int, patience: float = 0.0) -> bytes:
        """Ask a question of the profile's data; the block of `count` bytes that answers it."""
        data = self.profile.data
        line, end = self._lines[data.device], data.end.encode("latin-1")

        def received(bytes_: int) -> bytes:
            return _told(data.device, question, line.receive, bytes_, self.timeout + patience)

        if question:
            self._send(data.device, question)
        if data.header is Header.ieee:
            self._read_header(received, question, count)
        block = received(count + len(end))
        if block[count:] != end:
            raise DisturbanceError(
                f"{data.device} sent more than the {count} bytes that answer {question}"
            )
        return block[:count]

    def require_no_error(self, device: str, after: str, patience: float = 0.0) -> None:
        """Empty a device's queue of errors, and complain about the oldest."""
        found = self._errors(device, patience)
        if found:
            more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
            raise InstrumentError(f"{device} reports {found[0]}{more} after {_short(after)}")

    def verify(self, playing: bool) -> None:
        """Ask what must be so for a measurement to be right."""
        for question in self.profile.verify:
            if playing or not question.while_playing:
                answer = self.ask(question.device, question.ask)
                if answer != question.answer:
                    raise InstrumentError(
                        f"{question.otherwise}: {question.device} answered {_short(answer)} to "
                        f"{question.ask}, not {question.answer}"
                    )

    def _greet(self, name: str, device: Device) -> None:
        """Ask a device who it is, and forget errors from before."""
        if device.identify:
            answer = self.ask(name, device.identify)
            if not re.match(device.identity, answer):
                # Whatever answers here may be the rest of an earlier answer.
                raise DisturbanceError(
                    f"{name} says that it is {_short(answer)}, which the profile does not expect "
                    f"({device.identity})"
                )
        self._errors(name)

    def _errors(self, device: str, patience: float = 0.0) -> list[str]:
        """Empty a device's queue of errors; all its entries, the oldest first."""
        queue = self.profile.devices[device].errors
        found = []
        for _ in range(QUEUE):
            answer = self.ask(device, queue.ask, patience)
            match = re.fullmatch(queue.answer, answer)
            if match is None:
                raise DisturbanceError(
                    f"{device} answered {_short(answer)} to {queue.ask}, which is no entry of its "
                    "queue of errors"
                )
            if match[1] == queue.none:
                break
            meaning = queue.meaning.get(match[1], "")
            found.append(f"{answer}: {meaning}" if meaning else answer)
        return found

    def _send(self, device: str, text: str) -> None:
        message = text.encode("latin-1") + self._ends(device)[0]
        _told(device, text, self._lines[device].send, message)

    def _ends(self, device: str) -> tuple[bytes, bytes]:
        known = self.profile.devices[device]
        return known.sent_end.encode("latin-1"), known.answer_end.encode("latin-1")

    def _read_header(self, received: Callable[[int], bytes], question: str, count: int) -> None:
        """Require that ``#<digits><bytes>`` announces the right number of bytes."""
        start = received(2)
        digits = received(int(start[1:])) if re.fullmatch(rb"#[1-9]", start) else b""
        if not digits.isdigit():
            raise DisturbanceError(
                f"{self.profile.data.device} answered {_short((start + digits).decode('latin-1'))} "
                f"to {question}, which is not the beginning of a block"
            )
        if int(digits) != count:
            raise DisturbanceError(
                f"{self.profile.data.device} announced {int(digits)} bytes to answer {question}, "
                f"where {count} had to come"
            )


def _told(device: str, command: str, action: Callable[..., Any], *arguments: Any) -> Any:
    """Return what `action` returns.

    Its complaints begin with the device and end with the command.
    """
    try:
        return action(*arguments)
    except InstrumentError as error:
        after = f" after {_short(command)}" if command else ""
        raise type(error)(f"{device}: {error}{after}") from error


def _short(text: str) -> str:
    """Shorten a text as messages show it."""
    shown = repr(text if len(text) <= SHOWN else f"{text[:SHOWN]}...")
    return shown


log = logging.getLogger(__name__)

#: Pause before the connection is made again, s; twice as long every further time.
PAUSE = 0.1

T = TypeVar("T")


class Persistence:
    """Does steps of a dialogue; one that was disturbed is repeated as a whole.

    Parameters
    ----------
    connect : callable
        Begins a dialogue.
    restore : callable
        Brings an instrument that was just connected to where the program believes it is.
    retries : int
        How often a step is repeated.
    """

    def __init__(
        self, connect: Callable[[], Dialogue], restore: Callable[[Dialogue], None], retries: int
    ) -> None:
        self._connect = connect
        self._restore = restore
        self._retries = retries
        self._dialogue: Dialogue | None = None

    def __call__(self, what: str, step: Callable[[Dialogue], T]) -> T:
        """Do a step.

        Parameters
        ----------
        what : str
            What is being done, for messages.

        Raises
        ------
        InstrumentError
            If the instrument refuses, or the step was disturbed every time.
        """
        for attempt in range(self._retries + 1):
            try:
                return self._once(step)
            except DisturbanceError as error:
                if attempt == self._retries:
                    tried = f"{attempt + 1} times" if attempt else "once"
                    raise InstrumentError(f"{what}: {error} (tried {tried})") from error
                log.warning("%s: %s; trying again", what, error)
                time.sleep(PAUSE * 2**attempt)
            except InstrumentError as error:
                raise InstrumentError(f"{what}: {error}") from error
        raise AssertionError

    def hang_up(self) -> None:
        """End the dialogue."""
        if self._dialogue is not None:
            self._dialogue.close()
            self._dialogue = None

    def _once(self, step: Callable[[Dialogue], T]) -> T:
        """Do a step, over a new connection if the last step left the old one in disorder."""
        known, self._dialogue = self._dialogue, None
        dialogue = known or self._connect()
        in_order = False
        try:
            if known is None:
                self._restore(dialogue)
            done = step(dialogue)
            in_order = True
            return done
        except DisturbanceError:
            raise
        except InstrumentError:
            # A refusal leaves nothing unread; whatever else may, also an operator's Ctrl-C.
            in_order = known is not None
            raise
        finally:
            if in_order:
                self._dialogue = dialogue
            else:
                dialogue.close()


#: Counts on each side of zero.
HALF_COUNTS = 2**15


def block_size(data: Data, pixels: int, samples: int) -> int:
    """Count bytes of a block of samples."""
    return pixels * len(CHANNELS) * samples * np.dtype(data.type.value).itemsize


def decoded(
    data: Data,
    block: bytes,
    status: bytes,
    shape: tuple[int, int],
    volts_per_count: Sequence[float],
    rate: float,
) -> RawSamples:
    """Decode samples of a block.

    Parameters
    ----------
    data : Data
        How the block is written.
    status : bytes
        One a pixel; empty if there is none.
    shape : tuple of int
        Pixels, and samples a pixel and channel.
    volts_per_count : sequence of float
        In the order of `CHANNELS`.
    rate : float, Hz

    Raises
    ------
    DisturbanceError
        If a sample is not a number.
    """
    pixels, samples = shape
    raw = np.frombuffer(block, np.dtype(data.order.value + data.type.value))
    if data.layout is ChannelOrder.interleaved:
        by_channel = raw.reshape(pixels, samples, len(CHANNELS)).transpose(0, 2, 1)
    else:
        by_channel = raw.reshape(pixels, len(CHANNELS), samples)
    ordered = by_channel[:, [data.channels.index(c) for c in CHANNELS]]
    flags = np.frombuffer(status, np.uint8) if status else np.zeros(pixels, np.uint8)
    scale = np.array(volts_per_count, float)
    if data.type is SampleType.float32:
        counts, over = _rounded(ordered, scale)
        flags = flags | over
    elif data.type is SampleType.uint16:
        counts = (ordered.astype(np.int32) - HALF_COUNTS).astype(np.int16)
    else:
        counts = ordered.astype(np.int16, copy=False)
    return RawSamples(counts, scale, rate, flags)


def _rounded(
    volts: NDArray[np.floating], scale: Array
) -> tuple[NDArray[np.int16], NDArray[np.uint8]]:
    """Round volts to counts, with the status of pixels whose volts are beyond them."""
    if not np.isfinite(volts).all():
        pixel = int(np.argwhere(~np.isfinite(volts))[0, 0])
        raise DisturbanceError(f"pixel {pixel} has a sample that is not a finite number of volts")
    counts = np.rint(volts / scale[:, None])
    clipped = np.clip(counts, -HALF_COUNTS, HALF_COUNTS - 1)
    beyond = (counts != clipped).any(axis=(1, 2))
    flags = np.where(beyond, Status.over_range, Status.good).astype(np.uint8)
    return clipped.astype(np.int16), flags
