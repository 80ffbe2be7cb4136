"""Habits of real instruments: right samples, or a sentence that names the key of the profile.

Obeying the sentence is tried too: with the key it names, the samples are those of the lab.
"""

from __future__ import annotations

import math
import re
import struct
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import pytest
import yaml

from sldvexp.errors import UserError
from sldvexp.instrument import Acquisition, InstrumentError
from sldvexp.instrument.connection import canonical_resource
from sldvexp.instrument.visa import Visa
from sldvexp.virtual_lab import LabServer

PROFILE = Path(__file__).parents[2] / "conf" / "profile" / "virtual_lab.yaml"
ACQUISITION = Acquisition(20000.0, 256, (450.0,), 0.8)
#: How long an answer may take in the client's time, which passes only where nothing comes, s.
PATIENCE = 2.0

Answer = Callable[[str, bytes], bytes]


def plainly(line: str, answer: bytes) -> bytes:
    return answer


@dataclass
class Habit:
    """What an instrument does, and what the program makes of it.

    `told` is said with the profile of the lab, nothing if that is right anyway; `keys` are the
    settings that the sentence names, with which the samples are right.
    """

    answer: Answer = plainly
    greeting: bytes = b""
    told: str = ""
    keys: dict[str, object] = field(default_factory=dict)
    silent: bool = False


def at(question: str, change: Callable[[bytes], bytes]) -> Answer:
    """Change the answers to a question."""
    return lambda line, answer: change(answer) if line.startswith(question) else answer


def counts(answer: bytes) -> tuple[bytes, list[int]]:
    """Name header and numbers of a block."""
    begin = 2 + int(answer[1:2])
    body = answer[begin:-1]
    return answer[:begin], list(struct.unpack(f"<{len(body) // 2}h", body))


def rewritten(pack: str, change: Callable[[list[int]], list[int]] = list) -> Answer:
    """Samples in another form, as many bytes."""

    def change_block(answer: bytes) -> bytes:
        head, numbers = counts(answer)
        changed = change(numbers)
        return head + struct.pack(f"{pack[0]}{len(changed)}{pack[1]}", *changed) + b"\n"

    return at("DATA?", change_block)


def interleaved(numbers: list[int]) -> list[int]:
    n = ACQUISITION.samples
    pixels = [numbers[i : i + 2 * n] for i in range(0, len(numbers), 2 * n)]
    return [v for pixel in pixels for both in zip(pixel[:n], pixel[n:], strict=True) for v in both]


def from_below(numbers: list[int]) -> list[int]:
    return [v + 2**15 for v in numbers]


def no_code(answer: bytes) -> bytes:
    return b"No error\n"


ERRORS, NAME = "SYST:ERR?", "*IDN?"
LINES = (b"\n", b"\r\n")
HABITS = {
    "a sign before the code": Habit(at(ERRORS, lambda a: b'+0,"No error"\n')),
    "a blank after the comma": Habit(at(ERRORS, lambda a: b'0, "No error"\n')),
    "leading zeros": Habit(at(ERRORS, lambda a: b'+000,"No error"\n')),
    "a negative zero": Habit(at(ERRORS, lambda a: b'-0,"no error"\n')),
    "no quotation marks": Habit(at(ERRORS, lambda a: b"0, No error\n")),
    "a code alone": Habit(at(ERRORS, lambda a: b"0\n")),
    "no code": Habit(
        at(ERRORS, no_code),
        told=r"'No error' to SYST:ERR\?, .* devices\.lab\.errors\.answer",
        keys={"devices.lab.errors.answer": "(.*)", "devices.lab.errors.none": "no error"},
    ),
    "a greeting": Habit(
        greeting=b"Welcome to ACME scan control\n",
        told=r"'Welcome to ACME scan control', which .* devices\.lab\.banner the number of lines",
        keys={"devices.lab.banner": 1},
    ),
    "a greeting of three lines": Habit(
        greeting=b"\nACME\n(c) 1998\n",
        told=r"devices\.lab\.banner",
        keys={"devices.lab.banner": 3},
    ),
    "an echo": Habit(
        lambda line, answer: line.encode() + b"\n" + answer,
        told=r"'\*IDN\?' with the question itself: .*devices\.lab\.echo: true",
        keys={"devices.lab.echo": True},
    ),
    "an echo with a carriage return": Habit(
        lambda line, answer: line.encode() + b"\r\n" + answer,
        told=r"devices\.lab\.echo: true",
        keys={"devices.lab.echo": True},
    ),
    "another name": Habit(
        at(NAME, lambda a: b"ACME,9000\n"),
        told=r"'ACME,9000', .* devices\.lab\.identity is what its name begins with",
        keys={"devices.lab.identity": "ACME"},
    ),
    "carriage returns after lines": Habit(
        lambda line, answer: answer if line in ("DATA?", "STAT?") else answer.replace(*LINES)
    ),
    "fillings after lines": Habit(
        lambda line, answer: (
            answer if line in ("DATA?", "STAT?") else answer.replace(b"\n", b"\0 \x11\n")
        )
    ),
    "no end of lines": Habit(
        at(NAME, lambda a: a.strip()),
        told=r"the end '\\n' of a line, its answer_end in the profile, did not come",
        silent=True,
    ),
    "lines that end with a carriage return alone": Habit(
        lambda line, answer: answer if line in ("DATA?", "STAT?") else answer.replace(b"\n", b"\r"),
        told=r"answer_end in the profile",
        keys={"devices.lab.answer_end": "\r"},
        silent=True,
    ),
    "a line without end": Habit(
        at(NAME, lambda a: b"x" * (2**20 + 2**17)), told=r"answer_end .* within 1048576 bytes"
    ),
    "a block of unknown length": Habit(
        lambda line, a: b"#0" + a[2 + int(a[1:2]) :] if line in ("DATA?", "STAT?") else a
    ),
    "a block without its end": Habit(
        lambda line, a: a[:-1] if line in ("DATA?", "STAT?") else a,
        told=r"before the \d+ bytes that answer DATA\? and their end '\\n'",
        keys={"data.end": ""},
        silent=True,
    ),
    "a carriage return after a block": Habit(
        lambda line, a: a[:-1] + b"\r\n" if line in ("DATA?", "STAT?") else a,
        told=r"sent '\\r' after the \d+ bytes .* where its end is '\\n' \(data\.end",
        keys={"data.end": "\r\n"},
    ),
    "no header": Habit(
        lambda line, a: a[2 + int(a[1:2]) :] if line in ("DATA?", "STAT?") else a,
        told=r"is not the beginning of a block \(data\.ask and data\.header",
        keys={"data.header": "none"},
    ),
    "the other byte first": Habit(
        rewritten(">h"), told=r"and is one with data\.order: big$", keys={"data.order": "big"}
    ),
    "samples by turns": Habit(
        rewritten("<h", interleaved),
        told=r"and is one with data\.layout: interleaved$",
        keys={"data.layout": "interleaved"},
    ),
    "counts from below": Habit(
        rewritten("<H", from_below),
        told=r"and is one with data\.type: uint16$",
        keys={"data.type": "uint16"},
    ),
    "all three": Habit(
        rewritten(">H", lambda v: from_below(interleaved(v))),
        told=r"is one with data\.type: uint16, data\.order: big, data\.layout: interleaved$",
        keys={"data.type": "uint16", "data.order": "big", "data.layout": "interleaved"},
    ),
    "a unit after the rate": Habit(
        at("SAMP:RATE?", lambda a: a.strip() + b" Hz\n"),
        told=r"where a finite number had to come \(data\.rate of the profile\)",
        keys={"data.rate": ""},
    ),
    "the header before the scale": Habit(
        at("CHAN:SCAL?", lambda a: b"CHAN:SCAL " + a),
        told=r"2 finite numbers had to come \(data\.scale of the profile\)",
    ),
    "a switch that answers with a sign": Habit(at("GEN:OUTP?", lambda a: b"+" + a)),
    "a switch that answers with a decimal": Habit(at("GEN:OUTP?", lambda a: a.strip() + b".0\n")),
    "a shutter in small letters": Habit(at("LAS:SHUT?", lambda a: a.lower())),
    "a switch that answers with a word": Habit(
        at("GEN:OUTP?", lambda a: b"ON\n"),
        told=r"'ON' to GEN:OUTP\?, not 1, which is right by verify\[0\]\.answer",
        keys={"verify.0.answer": "on"},
    ),
    "a status in letters": Habit(
        at("STAT?", lambda a: a[:-2] + b"A\n"),
        told=r"status of pixel 7 is nonsense: 65 in answer to STAT\? \(data\.status",
        keys={"data.status": ""},
    ),
}


class Quirky(LabServer):
    """A virtual lab with a habit."""

    def __init__(self, lab, habit, clock):
        super().__init__(lab)
        self.habit, self.clock = habit, clock

    def _serve_client(self, client):
        client.sendall(self.habit.greeting)
        super()._serve_client(client)

    def _answer(self, line, client):
        right = self.dialect.answer(line) or b""
        connection, answer = self.clock.connection, self.habit.answer(line, right)
        client.sendall(answer)
        if self.habit.silent and answer != right:
            self.clock.keep_silent(math.inf, connection)


@pytest.fixture
def scanned(lab, line, tmp_path, client_clock):
    """Scan a line of an instrument with a habit, with some keys of the profile changed."""

    def run(habit, keys=()):
        profile = yaml.safe_load(PROFILE.read_text())
        for key, value in dict(keys).items():
            *path, last = [int(k) if k.isdigit() else k for k in key.split(".")]
            table = profile
            for step in path:
                table = table[step]
            table[last] = value
        file = tmp_path / "mine.yaml"
        file.write_text(yaml.safe_dump(profile))
        with (
            Quirky(lab(), habit, client_clock) as server,
            Visa(server.resource, str(file), timeout=PATIENCE, retries=0).open() as ours,
        ):
            ours.configure(ACQUISITION)
            return ours.scan(line, stream=1)

    return run


@pytest.fixture
def wanted(lab, line):
    """The samples as they are."""
    reference = lab()
    reference.configure(ACQUISITION)
    return reference.scan(line, stream=1)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", [name for name, habit in HABITS.items() if habit.told])
def test_a_habit_is_told_with_the_key_of_the_profile(scanned, name):
    habit = HABITS[name]
    with pytest.raises(InstrumentError) as error:
        scanned(habit)
    said = str(error.value).split("; the mirrors may not be home")[0]
    assert re.search(habit.told.removesuffix("$"), said), said
    assert "\n" not in said


@pytest.mark.one_in(4)
@pytest.mark.parametrize("name", [n for n, h in HABITS.items() if h.keys or not h.told])
def test_samples_are_right_as_soon_as_the_profile_is(scanned, wanted, same, name):
    habit = replace(HABITS[name], silent=False)
    assert same(scanned(habit, habit.keys), wanted)


def test_there_are_more_than_twenty_habits():
    assert len(HABITS) > 20


@pytest.mark.parametrize(
    ("name", "right"),
    [
        ("tcpip::10.0.0.7::5025::socket", "TCPIP::10.0.0.7::5025::SOCKET"),
        ("TCPIP0::scope.local::inst0::instr", "TCPIP0::scope.local::inst0::INSTR"),
        (" gpib0::9::Instr", "GPIB0::9::INSTR"),
        ("asrl/dev/ttyUSB0::instr", "ASRL/dev/ttyUSB0::INSTR"),
        ("usb::0x1AB1::0x04CE::DS1ZA::instr", "USB::0x1AB1::0x04CE::DS1ZA::INSTR"),
    ],
)
def test_names_of_devices_in_any_case(name, right):
    assert canonical_resource(name) == right


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("TCPIP::10.0.0.7::5025", "names no socket: write TCPIP::10.0.0.7::5025::SOCKET"),
        ("TCPIP::10.0.0.7::5025::INSTR", "write TCPIP::10.0.0.7::5025::SOCKET"),
        ("10.0.0.7:5025", "write TCPIP::10.0.0.7::5025::SOCKET"),
        ("COM3", "write ASRL3::INSTR"),
        ("/dev/ttyUSB0", "write ASRL/dev/ttyUSB0::INSTR"),
    ],
)
def test_names_that_people_write_for_others(name, told):
    with pytest.raises(UserError, match=rf"resource: {name} .*{told}"):
        Visa(name)
