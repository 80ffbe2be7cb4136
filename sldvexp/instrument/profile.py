"""A command profile: how some digitiser and its boards are spoken to, as data instead of code.

Commands may hold placeholders such as ``{rate}`` or ``{up_down:+05d}``, filled as `str.format`
does; `sldvexp.instrument.profile_file.PLACEHOLDERS` lists them for each group of commands.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

#: Channels of every block of samples; `sldvexp.instrument.protocol.CHANNELS` without numpy.
CHANNELS = ("velocity", "reference")


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
    """Beginning of a block: IEEE 488.2's ``#<digits><bytes>``, or nothing."""

    ieee = "ieee"
    none = "none"


class ChannelOrder(Enum):
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
        The code of no error. Codes that are whole numbers are compared as such: ``+0`` is ``0``.
    meaning : dict of str to str
        What a code means, where the answer does not say it.
    """

    ask: str
    answer: str = r"([-+]?\d+)\s*(,.*)?"
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
    banner : int
        Lines with which it greets whoever connects.
    echo : bool
        Whether it sends every line that it gets back before it does anything else.
    """

    errors: ErrorQueue
    identify: str = ""
    identity: str = ".*"
    sent_end: str = "\n"
    answer_end: str = "\n"
    banner: int = 0
    echo: bool = False


Commands = dict[str, list[str]]


@dataclass(kw_only=True)
class CommandGroups:
    """Commands of each step, by device, in the order in which they are sent.

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
    play : dict of str to list of str
        In the place of `generator_on` for all but sines: the generator's own ``{function}`` of that
        kind, or an arbitrary ``{waveform}`` of one record. Empty if the generator cannot.
    records : dict of str to list of str
        Sets how many records a pixel takes, one behind the other. Empty if the device takes one at
        a time: then `acquire` is sent for each, and must wait for the trigger if there is one.
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
    play: dict[str, list[str]] = field(default_factory=dict)
    records: dict[str, list[str]] = field(default_factory=dict)
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
        The right one. Numbers are compared as numbers, words without regard to capitals.
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
        Answered by a block of one byte a record, bits of `sldvexp.instrument.protocol.Status`;
        empty if the device knows of no such thing.
    header : Header
        Of both blocks; ``ieee`` also takes ``#0``, since their lengths are known.
    end : str
        What follows the last byte of a block.
    type : SampleType
        Counts, from the middle of the range (int16) or from its lower end (uint16), or volts.
    order : ByteOrder
    layout : ChannelOrder
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
    layout: ChannelOrder = ChannelOrder.by_channel
    channels: list[str] = field(default_factory=lambda: list(CHANNELS))
    rate: str = ""
    scale: str = ""
    volts_per_count: dict[str, float] = field(default_factory=dict)


@dataclass(kw_only=True)
class BenchQuestions:
    """Questions that help a person to aim; each may be empty, if the device cannot answer it.

    Parameters
    ----------
    device : str
        That answers.
    position : str
        Answered by up_down,left_right, the DAC steps at which the mirrors stand.
    light : str
        Answered by how much of the laser's light comes back, from 0 to 1.
    picture : str
        Answered by a block, as those of `data` are, of a camera's picture: one byte a pixel, row by
        row from above.
    picture_size : list of int
        Rows and columns of the picture.
    """

    device: str
    position: str = ""
    light: str = ""
    picture: str = ""
    picture_size: list[int] = field(default_factory=list)


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
    functions : dict of str to str
        Names of the generator's own functions, by `sldvexp.signal.ExcitationKind`, for the
        ``{function}`` of ``commands.play``.
    verify : list of Verify
        Asked after configuring and after every list of pixels.
    data : Data
    bench : BenchQuestions, optional
    """

    tried_on_hardware: bool
    settle: float = 0.0
    devices: dict[str, Device]
    commands: CommandGroups
    functions: dict[str, str] = field(default_factory=dict)
    verify: list[Verify] = field(default_factory=list)
    data: Data
    bench: BenchQuestions | None = None
