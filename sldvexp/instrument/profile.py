"""A command profile: how some digitiser and its boards are spoken to, as data instead of code.

Commands may hold placeholders such as ``{rate}`` or ``{up_down:+05d}``, filled as `str.format`
does; `PLACEHOLDERS` lists them for each group of commands.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum
from string import Formatter

from sldvexp.errors import Checks, nearest

#: Channels of every block of samples; `sldvexp.instrument.protocol.CHANNELS` without numpy.
CHANNELS = ("velocity", "reference")

SAMPLING = ("rate", "interval", "interval_us", "samples")
GENERATOR = ("frequencies", "amplitude")

#: What the commands of each group may be filled with.
PLACEHOLDERS: dict[str, tuple[str, ...]] = {
    "setup": (),
    "view": ("view",),
    "configure": (*SAMPLING, *GENERATOR),
    "generator_on": GENERATOR,
    "generator_off": (),
    "move": ("up_down", "left_right"),
    "home": (),
    "acquire": ("samples",),
    "stream": ("stream",),
    "scan": ("positions", "pixels", "samples"),
}

#: Groups without which nothing can be measured, and what they are for.
NEEDED = {
    "configure": "sets the sampling",
    "move": "points the beam",
    "home": "sends the mirrors home",
    "acquire": "samples one pixel",
}

#: Of which placeholders a group must have one each.
TELLS = {
    "configure": (("rate", "interval", "interval_us"), ("samples",)),
    "move": (("up_down",), ("left_right",)),
    "scan": (("positions",),),
}


class SampleType(Enum):
    """Numbers of a block; the value is numpy's name."""

    int16 = "i2"
    uint16 = "u2"
    float32 = "f4"


class ByteOrder(Enum):
    """Which byte of a number comes first; the value is numpy's sign."""

    little = "<"
    big = ">"


class Header(Enum):
    """What precedes the bytes of a block: IEEE 488.2's ``#<digits><bytes>``, or nothing."""

    ieee = "ieee"
    none = "none"


class Layout(Enum):
    """Samples of one pixel: all of a channel and then of the next, or by turns."""

    by_channel = "by_channel"
    interleaved = "interleaved"


@dataclass(kw_only=True)
class ErrorQueue:
    """How a device is asked for its errors.

    Parameters
    ----------
    ask : str
        Answered by the oldest error, which is thereby forgotten.
    answer : str
        Regular expression of every answer; its first group is the error's code.
    none : str
        The code of no error.
    meaning : dict of str to str
        What a code means, where the answer does not say it.
    """

    ask: str
    answer: str = r"([-+]?\d+),.*"
    none: str = "0"
    meaning: dict[str, str] = field(default_factory=dict)


@dataclass(kw_only=True)
class Device:
    """One device on the bus.

    Parameters
    ----------
    errors : ErrorQueue
        Asked after every group of commands.
    identify : str
        Question of who it is; empty asks nothing.
    identity : str
        Regular expression that the beginning of the answer must match.
    sent_end, answer_end : str
        What ends a message to it and a line from it.
    """

    errors: ErrorQueue
    identify: str = ""
    identity: str = ".*"
    sent_end: str = "\n"
    answer_end: str = "\n"


Commands = dict[str, list[str]]


@dataclass(kw_only=True)
class CommandGroups:
    """The commands of each step, by device, in the order in which they are sent.

    Parameters
    ----------
    setup : dict of str to list of str
        Once after connecting.
    view : dict of str to list of str
        Goes to a view; empty if somebody must move the instrument.
    configure : dict of str to list of str
        Sets the sampling, and what the generator shall play.
    generator_on, generator_off : dict of str to list of str
        Empty if the generator is set by hand.
    move, home : dict of str to list of str
        Mirrors to a place, and to step 0.
    acquire : dict of str to list of str
        Samples one pixel where the beam stands.
    stream : dict of str to list of str
        Numbers a scan line; only a simulation needs it.
    scan : dict of str to list of str
        Samples a list of pixels; empty if the device cannot: then it is done pixel by pixel.
    """

    setup: dict[str, list[str]] = field(default_factory=dict)
    view: dict[str, list[str]] = field(default_factory=dict)
    configure: dict[str, list[str]] = field(default_factory=dict)
    generator_on: dict[str, list[str]] = field(default_factory=dict)
    generator_off: dict[str, list[str]] = field(default_factory=dict)
    move: dict[str, list[str]] = field(default_factory=dict)
    home: dict[str, list[str]] = field(default_factory=dict)
    acquire: dict[str, list[str]] = field(default_factory=dict)
    stream: dict[str, list[str]] = field(default_factory=dict)
    scan: dict[str, list[str]] = field(default_factory=dict)


@dataclass(kw_only=True)
class Verify:
    """A question whose answer tells whether the measurement can be right.

    Parameters
    ----------
    device, ask : str
    answer : str
        The right one.
    otherwise : str
        What any other answer means.
    while_playing : bool
        Asked only while the generator shall play.
    """

    device: str
    ask: str
    answer: str
    otherwise: str
    while_playing: bool = False


@dataclass(kw_only=True)
class Data:
    """How samples come back.

    Parameters
    ----------
    device : str
        That sends them.
    ask : str
        Answered by the block of the pixels sampled last; empty if it is sent without a question.
    status : str
        Answered by a block of one byte a pixel, bits of `sldvexp.instrument.protocol.Status`;
        empty if the device knows of no such thing.
    header : Header
        Of both blocks.
    end : str
        What follows the last byte of a block.
    type : SampleType
        Counts, from the middle of the range (int16) or from its lower end (uint16), or volts.
    order : ByteOrder
    layout : Layout
    channels : list of str
        The channels, in the block's order.
    rate : str
        Answered by the rate that the device really set, Hz; empty if it is the one it was given.
    scale : str
        Answered by each channel's volts per count, in the order of `channels`.
    volts_per_count : dict of str to float
        The same as numbers, instead of a question. Volts (float32) are rounded to it.
    """

    device: str
    ask: str
    status: str = ""
    header: Header = Header.ieee
    end: str = "\n"
    type: SampleType = SampleType.int16
    order: ByteOrder = ByteOrder.big
    layout: Layout = Layout.by_channel
    channels: list[str] = field(default_factory=lambda: list(CHANNELS))
    rate: str = ""
    scale: str = ""
    volts_per_count: dict[str, float] = field(default_factory=dict)


@dataclass(kw_only=True)
class Profile:
    """Everything about an instrument that speaks through VISA.

    Parameters
    ----------
    tried_on_hardware : bool
        Whether somebody did; the program warns if nobody did.
    settle : float, s
        From a mirror's move to the first good sample.
    devices : dict of str to Device
    commands : CommandGroups
    verify : list of Verify
        Asked after configuring and after every list of pixels.
    data : Data
    """

    tried_on_hardware: bool
    settle: float = 0.0
    devices: dict[str, Device]
    commands: CommandGroups
    verify: list[Verify] = field(default_factory=list)
    data: Data

    def __post_init__(self) -> None:
        checks = Checks()
        checks.non_negative("settle", self.settle)
        checks.require(bool(self.devices), "devices", "must be given, as in {name: {...}}")
        for name, device in self.devices.items():
            _expression(checks, f"devices.{name}.identity", device.identity)
            _expression(checks, f"devices.{name}.errors.answer", device.errors.answer, groups=1)
            for end in ("sent_end", "answer_end"):
                text = getattr(device, end)
                checks.require(bool(text), f"devices.{name}.{end}", 'must be given, as in "\\n"')
        self._check_commands(checks)
        for i, question in enumerate(self.verify):
            self._check_device(checks, f"verify[{i}].device", question.device)
        self._check_data(checks)
        checks.done()

    def _check_commands(self, checks: Checks) -> None:
        """Every group addresses known devices, and says what it must and no more."""
        for group, allowed in PLACEHOLDERS.items():
            commands: Commands = getattr(self.commands, group)
            said = {p for texts in commands.values() for text in texts for p in _named(text)}
            for device, texts in commands.items():
                self._check_device(checks, f"commands.{group}.{device}", device)
                for i, text in enumerate(texts):
                    key = f"commands.{group}.{device}[{i}]"
                    _check_placeholders(checks, key, text, allowed)
            for among in TELLS.get(group, ()) if commands else ():
                message = f"must have a command with {' or '.join(f'{{{p}}}' for p in among)}"
                checks.require(not said.isdisjoint(among), f"commands.{group}", message)
        for group, purpose in NEEDED.items():
            given = any(getattr(self.commands, group).values())
            message = f"is missing: give the command that {purpose}, as in {{device: [command]}}"
            checks.require(given, f"commands.{group}", message)
        off = bool(self.commands.generator_off) or not self.commands.generator_on
        message = "is missing: what turns the generator on must be able to turn it off"
        checks.require(off, "commands.generator_off", message)

    def _check_data(self, checks: Checks) -> None:
        """Blocks come from a known device, hold both channels, and have a scale."""
        data = self.data
        self._check_device(checks, "data.device", data.device)
        message = f"must be {' and '.join(CHANNELS)} in the block's order, not {data.channels}"
        checks.require(sorted(data.channels) == sorted(CHANNELS), "data.channels", message)
        one = bool(data.scale) != bool(data.volts_per_count)
        message = "is missing: give either scale, a question, or volts_per_count, its numbers"
        checks.require(one, "data.scale", message)
        for channel, volts in data.volts_per_count.items():
            key = f"data.volts_per_count.{channel}"
            known = channel in CHANNELS
            checks.require(known, key, f"is not a channel; {nearest(channel, CHANNELS)}")
            checks.positive(key, volts)
        for channel in CHANNELS if data.volts_per_count else ():
            key = f"data.volts_per_count.{channel}"
            checks.require(channel in data.volts_per_count, key, "is missing")

    def _check_device(self, checks: Checks, key: str, device: str) -> None:
        """A device that is named must be one of `devices`."""
        message = f"addresses the unknown device {device}; {nearest(device, self.devices)}"
        checks.require(device in self.devices or not self.devices, key, message)


def _expression(checks: Checks, key: str, text: str, groups: int = 0) -> None:
    """Note what is no regular expression or has too few groups."""
    try:
        found = re.compile(text).groups
    except re.error as error:
        checks.require(False, key, f"is not a regular expression: {error}")
        return
    checks.require(found >= groups, key, r"must have the code in parentheses, as in (-?\d+),.*")


def _named(text: str) -> Iterator[str]:
    """The placeholders of a command; those of one that cannot be read are none."""
    try:
        parsed = list(Formatter().parse(text))
    except ValueError:
        return
    yield from (name for _, name, _, _ in parsed if name is not None)


#: A value of each placeholder, to try a command with.
EXAMPLES = {name: 1 for names in PLACEHOLDERS.values() for name in names} | {
    "rate": 1.0,
    "interval": 1.0,
    "amplitude": 1.0,
    "frequencies": "1.0",
    "positions": "1,1",
    "view": "1",
}


def _check_placeholders(checks: Checks, key: str, text: str, allowed: tuple[str, ...]) -> None:
    """Note the first thing that keeps a command from being filled."""
    for name in _named(text):
        if name not in allowed:
            valid = nearest(name, allowed).replace("there are none", "none is allowed here")
            checks.require(False, key, f"has the unknown placeholder {{{name}}}; {valid}")
            return
    try:
        text.format(**{name: EXAMPLES[name] for name in allowed})
    except (ValueError, IndexError, KeyError) as error:
        checks.require(False, key, f"is no command that can be filled: {error}")
