"""Commands, questions and blocks of samples, as a profile says, over lines to its devices.

`Dialogue` speaks; `Persistence` repeats a step over a new connection when something disturbs it.
"""

from __future__ import annotations

import logging
import math
import re
import time
from collections import Counter
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from sldvexp.instrument.connection import BrokenOffError, DisturbanceError, Line
from sldvexp.instrument.profile import (
    Commands,
    Device,
    Header,
    Profile,
)
from sldvexp.instrument.protocol import InstrumentError

#: Errors that are read from a queue at most.
QUEUE = 20

#: Reason for which a device that can be reached may not even say who it is.
HELD = (
    "another program may hold the instrument, as a console that is open or a run that is not done"
)

#: Sequences by which a text steers a terminal: colours, cursor, title.
ESCAPES = re.compile(r"(?:\x1b\[|\x9b)[0-?]*[ -/]*[@-~]|\x1b\][^\x07\x1b]*(?:\x07|\x1b\\)?|\x1b.")
#: Characters of a command or an answer that messages show.
SHOWN = 40

#: What some devices send around a line: blanks, ends, fillings and flow control.
AROUND = " \t\r\n\0\x11\x13"


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
        answer: str = _told(device, question, self._line, device, patience)
        if answer == question.strip() and not self.profile.devices[device].echo:
            raise InstrumentError(
                f"{device} answered {_short(question)} with the question itself: if it echoes, the "
                f"profile has to say so (devices.{device}.echo: true)"
            )
        return answer

    def numbers(self, key: str, device: str, question: str, count: int) -> list[float]:
        """Ask the question of a key; the finite numbers that answer it, separated by commas."""
        answer = self.ask(device, question)
        try:
            values = [float(text) for text in answer.split(",")]
        except ValueError:
            values = []
        if len(values) != count or not all(math.isfinite(v) for v in values):
            wanted = "a finite number" if count == 1 else f"{count} finite numbers"
            raise DisturbanceError(
                f"{device} answered {_short(answer)} to {question}, where {wanted} had to come "
                f"({key} of the profile)"
            )
        return values

    def block(
        self, question: str, count: int, patience: float = 0.0, key: str = "data.ask"
    ) -> bytes:
        """Ask a question of the profile's data; the block of `count` bytes that answers it."""
        data = self.profile.data
        line, end = self._lines[data.device], data.end.encode("latin-1")

        def received(bytes_: int) -> bytes:
            return _told(data.device, question, line.receive, bytes_, self.timeout + patience)

        if question:
            self._send(data.device, question)
        if data.header is Header.ieee:
            self._read_header(received, question, count, key)
        right = f"where its end is {data.end!r} (data.end of the profile)"
        after = f"the {count} bytes that answer {question}"
        try:
            block = received(count + len(end))
        except BrokenOffError as error:
            raise DisturbanceError(f"{error}, before {after} and their end {data.end!r}") from error
        if block[count:] != end:
            found = block[count:].decode("latin-1")
            raise DisturbanceError(f"{data.device} sent {found!r} after {after}, {right}")
        return block[:count]

    def require_no_error(self, device: str, after: str, patience: float = 0.0) -> None:
        """Empty a device's queue of errors, and complain about the oldest."""
        found = self._errors(device, patience)
        if found:
            more = f" (and {len(found) - 1} more)" if len(found) > 1 else ""
            raise InstrumentError(f"{device} reports {found[0]}{more} after {_short(after)}")

    def verify(self, playing: bool) -> None:
        """Ask what must be so for a measurement to be right."""
        for i, question in enumerate(self.profile.verify):
            if playing or not question.while_playing:
                answer = self.ask(question.device, question.ask)
                if not same_answer(answer, question.answer):
                    raise InstrumentError(
                        f"{question.otherwise}: {question.device} answered {_short(answer)} to "
                        f"{question.ask}, not {question.answer}, which is right by "
                        f"verify[{i}].answer of the profile"
                    )

    def _greet(self, name: str, device: Device) -> None:
        """Listen to a device's greeting, ask it who it is, and forget errors from before."""
        for _ in range(device.banner):
            _told(name, "", self._line, name)
        if device.identify:
            try:
                answer = self.ask(name, device.identify)
            except BrokenOffError:
                raise
            except DisturbanceError as error:
                raise DisturbanceError(f"{error}; {HELD}") from error
            if not re.match(device.identity, answer):
                # Whatever answers here may be the rest of an earlier answer.
                raise DisturbanceError(
                    f"{name} says that it is {_short(answer)}, which the profile does not expect "
                    f"({device.identity}): devices.{name}.identity is what its name begins with, "
                    f"devices.{name}.banner the number of lines with which it greets"
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
                    f"queue of errors as devices.{device}.errors.answer has it"
                )
            if same_answer(match[1], queue.none):
                break
            meaning = queue.meaning.get(match[1], "")
            found.append(f"{answer}: {meaning}" if meaning else answer)
        return found

    def _send(self, device: str, text: str) -> None:
        """Send a line, and listen to its echo if there is one."""
        message = text.encode("latin-1") + self._ends(device)[0]
        _told(device, text, self._lines[device].send, message)
        if self.profile.devices[device].echo:
            echo = _told(device, text, self._line, device)
            if echo != text.strip():
                raise DisturbanceError(
                    f"{device} sent {_short(echo)} where the echo of {_short(text)} had to come "
                    f"(devices.{device}.echo)"
                )

    def _line(self, device: str, patience: float = 0.0) -> str:
        """Receive a line."""
        end = self._ends(device)[1]
        line = self._lines[device].receive_line(end, self.timeout + patience)
        return printable(line.decode("ascii", errors="replace")).strip(AROUND)

    def _ends(self, device: str) -> tuple[bytes, bytes]:
        known = self.profile.devices[device]
        return known.sent_end.encode("latin-1"), known.answer_end.encode("latin-1")

    def _read_header(
        self, received: Callable[[int], bytes], question: str, count: int, key: str
    ) -> None:
        """Require that ``#<digits><bytes>`` announces the right number of bytes; ``#0`` any."""
        start = received(2)
        if start == b"#0":
            return
        digits = received(int(start[1:])) if re.fullmatch(rb"#[1-9]", start) else b""
        if not digits.isdigit():
            raise DisturbanceError(
                f"{self.profile.data.device} answered {_short((start + digits).decode('latin-1'))} "
                f"to {question}, which is not the beginning of a block ({key} and data.header of "
                "the profile)"
            )
        if int(digits) != count:
            raise DisturbanceError(
                f"{self.profile.data.device} announced {int(digits)} bytes to answer {question}, "
                f"where {count} had to come ({key}, data.type and samples of the profile)"
            )


def same_answer(answer: str, wanted: str) -> bool:
    """Tell whether two answers mean the same: equal numbers, or equal words in any capitals.

    Examples
    --------
    >>> same_answer("+0", "0"), same_answer("1.0", "1"), same_answer("open", "OPEN")
    (True, True, True)
    """
    try:
        return float(answer) == float(wanted)
    except ValueError:
        return answer.strip(' "').casefold() == wanted.strip(' "').casefold()


def _told(device: str, command: str, action: Callable[..., Any], *arguments: Any) -> Any:
    """Return what `action` returns.

    Its complaints begin with the device and end with the command.
    """
    try:
        return action(*arguments)
    except InstrumentError as error:
        after = f" after {_short(command)}" if command else ""
        raise type(error)(f"device {device}: {error}{after}") from error


def printable(text: str) -> str:
    r"""Leave out of an instrument's text what would steer the terminal that shows it.

    Examples
    --------
    >>> printable("\x1b[31;1m-240\x1b[0m,\x07Hardware error\x08")
    '-240,Hardware error'
    """
    return "".join(c for c in ESCAPES.sub("", text) if c.isprintable() or c == "\t")


def _short(text: str) -> str:
    """Shorten a text as messages show it."""
    shown = repr(text if len(text) <= SHOWN else f"{text[:SHOWN]}...")
    return shown


log = logging.getLogger(__name__)

#: Pause before the connection is made again, s; twice as long every further time.
PAUSE = 0.1

T = TypeVar("T")


class Counted:
    """Warnings of which a repeated one is told the first, the tenth, the hundredth time."""

    def __init__(self) -> None:
        self._times: Counter[str] = Counter()

    def __call__(self, text: str) -> None:
        """Warn of something that may have been told before."""
        self._times[text] += 1
        times = self._times[text]
        if times == 10 ** (len(str(times)) - 1):
            log.warning("%s%s", text, f" (for the {times}th time)" if times > 1 else "")


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
    warn : Counted
        Told of every disturbance after which a step is repeated.
    """

    def __init__(
        self,
        connect: Callable[[], Dialogue],
        restore: Callable[[Dialogue], None],
        retries: int,
        warn: Counted,
    ) -> None:
        self._connect = connect
        self._restore = restore
        self._retries, self._warn = retries, warn
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
                self._warn(f"{what}: {error}; trying again")
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
