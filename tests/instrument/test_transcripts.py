"""Instruments that are not there: what is said to them, word for word, and what is made of answers.

A transcript is a list of (device, sent, answered); nothing else may be said, and all of it must be.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sldvexp.instrument import Acquisition, DisturbanceError, InstrumentError, Status
from sldvexp.instrument.blocks import decoded
from sldvexp.instrument.profile import SampleType
from sldvexp.instrument.profile_file import load_profile
from sldvexp.instrument.visa import CommandedInstrument
from sldvexp.signal import Excitation, ExcitationKind

CONF = Path(__file__).parents[2] / "conf"


class Transcript:
    """Lines that know by heart what will be said on them."""

    def __init__(self, *said):
        self.left = list(said)

    def connect(self, device):
        return Spoken(self, device)


class Spoken:
    """One device's line of a transcript."""

    def __init__(self, transcript, device):
        self.transcript, self.device, self.unread = transcript, device, b""

    def send(self, message):
        assert self.unread == b"", f"{self.device}: {self.unread} was not read before {message}"
        assert self.transcript.left, f"{self.device}: {message} was not expected any more"
        device, sent, answered = self.transcript.left.pop(0)
        assert (self.device, message) == (device, sent)
        self.unread = answered

    def receive_line(self, end, patience):
        line, found, self.unread = self.unread.partition(end)
        assert found, f"{self.device}: {line} has no end"
        return line

    def receive(self, count, patience):
        assert len(self.unread) >= count
        found, self.unread = self.unread[:count], self.unread[count:]
        return found

    def close(self):
        assert self.unread == b""


def talk(profile, transcript, retries=0):
    return CommandedInstrument(profile, transcript.connect, 1.0, retries)


def no_error(device):
    return (device, b"E?\n", b"E0\r\n")


HELLO = [
    no_error("dac"),
    no_error("adc"),
    ("dac", b"P1 C0 A0 R2 X\n", b""),
    ("dac", b"P2 C0 A0 R2 X\n", b""),
    no_error("dac"),
    ("adc", b"C1 R3 X\n", b""),
    ("adc", b"C2 R2 X\n", b""),
    ("adc", b"C1,2 X\n", b""),
    ("adc", b"G2 X\n", b""),
    no_error("adc"),
]
CONFIGURED = [
    ("adc", b"I100 X\n", b""),
    ("adc", b"N3 X\n", b""),
    ("adc", b"T1 X\n", b""),
    no_error("adc"),
]
GOODBYE = [("dac", b"P1 V#0 X\n", b""), ("dac", b"P2 V#0 X\n", b""), no_error("dac")]


def moved(up_down, left_right):
    return [
        ("dac", b"P1 V#%d X\n" % up_down, b""),
        ("dac", b"P2 V#%d X\n" % left_right, b""),
        no_error("dac"),
    ]


def sampled(*counts):
    block = b"".join(count.to_bytes(2, "big", signed=True) for count in counts)
    return [
        ("adc", b"@\n", b""),
        no_error("adc"),
        ("adc", b"B X\n", block),
        no_error("adc"),
    ]


@pytest.fixture
def iotech():
    profile = load_profile("iotech")
    profile.settle = 0.0
    return profile


def test_the_dissertations_boards_pixel_by_pixel(iotech):
    transcript = Transcript(
        *HELLO,
        *CONFIGURED,
        *moved(-142, -704),
        *sampled(1, 10, 2, 11, 3, 12),
        *moved(4095, 0),
        *sampled(-1, -10, -2, -11, -32768, 32767),
        *moved(-4096, 7),
        *sampled(*range(6)),
        *GOODBYE,
    )
    with talk(iotech, transcript) as ours:
        ours.configure(Acquisition(10000.0, 3, (450.0,)))
        ours.move([-142, -704])
        one = ours.acquire()
        two = ours.scan(np.array([[4095, 0], [-4096, 7]]), stream=3)
    assert transcript.left == []
    assert one.counts.tolist() == [[[1, 2, 3], [10, 11, 12]]]
    expected = [[[-1, -2, -32768], [-10, -11, 32767]], [[0, 2, 4], [1, 3, 5]]]
    assert two.counts.tolist() == expected
    assert two.counts.dtype == np.int16
    assert two.status.tolist() == [0, 0]
    assert two.rate == 10000.0
    np.testing.assert_array_equal(one.volts_per_count, [10 / 2**15, 5 / 2**15])


def test_the_generator_beside_the_bus_is_asked_for(iotech, caplog):
    with talk(iotech, Transcript(*HELLO, *CONFIGURED, *CONFIGURED, *GOODBYE)) as ours:
        ours.configure(Acquisition(10000.0, 3, ()))
        assert not caplog.records
        ours.configure(Acquisition(10000.0, 3, (450.0, 61.5), 0.5))
    assert "the generator is set by hand: 450, 61.5 Hz with 0.5 V" in caplog.text


def test_a_device_that_takes_one_record_at_a_time_is_asked_for_each(iotech, caplog):
    """What its generator plays, and in which records, is set by hand."""
    design = Excitation(ExcitationKind.chirp, [200.0, 2000.0]).design(10000.0, 500)
    transcript = Transcript(
        *HELLO,
        *CONFIGURED,
        *moved(5, 6),
        *sampled(1, 10, 2, 11, 3, 12),
        *sampled(*range(6)),
        *GOODBYE,
    )
    with talk(iotech, transcript) as ours:
        ours.configure(Acquisition(10000.0, 3, (), 1.0, design, records=2, lead=1))
        found = ours.scan(np.array([[5, 6]]))
    assert transcript.left == []
    assert found.records == 2
    assert found.counts.tolist() == [[[1, 2, 3], [10, 11, 12]], [[0, 2, 4], [1, 3, 5]]]
    told = "the generator is set by hand: chirp from 200 to 2000 Hz in records of 3 samples with 1"
    assert told in caplog.text


@pytest.mark.parametrize(
    ("code", "means"),
    [(1, "unrecognized command"), (2, "invalid parameter"), (7, "adc$")],
)
def test_errors_by_number_are_explained(iotech, code, means):
    refused = [
        ("adc", b"I100 X\n", b""),
        ("adc", b"N3 X\n", b""),
        ("adc", b"T1 X\n", b""),
        ("adc", b"E?\n", b"E%d\r\n" % code),
        no_error("adc"),
    ]
    told = rf"^configuring: adc reports E{code}(: {means})? after 'I100 X; N3 X; T1 X'$"
    with (
        pytest.raises(InstrumentError, match=told),
        talk(iotech, Transcript(*HELLO, *refused, *GOODBYE)) as ours,
    ):
        ours.configure(Acquisition(10000.0, 3, ()))


def test_rates_that_the_board_cannot_have(iotech):
    told = r"30000 samples a second are not a whole number of micro.* the nearest .* is 30303.0303"
    with (
        pytest.raises(InstrumentError, match=told),
        talk(iotech, Transcript(*HELLO, *GOODBYE)) as ours,
    ):
        ours.configure(Acquisition(30000.0, 3, ()))


def test_after_garbage_everything_is_said_again(iotech):
    garbled = [("adc", b"@\n", b""), ("adc", b"E?\n", b"\xff\x00\r\n")]
    again = [*HELLO, *CONFIGURED, *moved(5, 6), *sampled(*range(6))]
    transcript = Transcript(*HELLO, *CONFIGURED, *moved(5, 6), *garbled, *again, *GOODBYE)
    with talk(iotech, transcript, retries=1) as ours:
        ours.configure(Acquisition(10000.0, 3, ()))
        ours.move([5, 6])
        assert ours.acquire().counts.tolist() == [[[0, 2, 4], [1, 3, 5]]]
    assert transcript.left == []


LAB = (CONF / "profile" / "virtual_lab.yaml").read_text()


@pytest.fixture
def received(tmp_path):
    """What an instrument with other data makes of a block of two pixels."""

    def made(block, *changes, status=b"\0\0", samples=3):
        text = LAB
        for old, new in changes:
            assert text.count(old) == 1
            text = text.replace(old, new)
        file = tmp_path / "other.yaml"
        file.write_text(text)
        profile = load_profile(str(file))
        quiet = ("lab", b"SYST:ERR?\n", b'0,"No error"\n')
        home = [("lab", m, b"") for m in (b"GEN:OUTP 0\n", b"MIRR:HOME\n")]
        data = [("lab", b"DATA?\n", block)]
        if profile.data.status:
            data.append(("lab", b"STAT?\n", b"#12" + status + b"\n"))
        scale = [("lab", b"CHAN:SCAL?\n", b" 0.5 , 0.25\n")] if profile.data.scale else []
        transcript = Transcript(
            ("lab", b"*IDN?\n", b"sldvexp,virtual lab,0,1\n"),
            quiet,
            ("lab", b"*CLS\n", b""),
            quiet,
            ("lab", b"SAMP:RATE 1000.0\n", b""),
            ("lab", b"SAMP:COUN %d\n" % samples, b""),
            quiet,
            ("lab", b"SAMP:REC 1,0,generator\n", b""),
            quiet,
            home[0],
            quiet,
            ("lab", b"SAMP:RATE?\n", b"999.5\n"),
            *scale,
            ("lab", b"LAS:SHUT?\n", b"OPEN\n"),
            ("lab", b"MEAS:LIST 1,2,3,-4\n", b""),
            quiet,
            *data,
            quiet,
            ("lab", b"LAS:SHUT?\n", b"OPEN\n"),
            home[0],
            quiet,
            home[1],
            quiet,
        )
        with talk(profile, transcript) as ours:
            ours.configure(Acquisition(1000.0, samples, ()))
            found = ours.scan(np.array([[1, 2], [3, -4]]))
        assert transcript.left == []
        assert found.rate == 999.5
        return found

    return made


COUNTS = np.arange(12).reshape(2, 2, 3) * 1000 - 5000
LITTLE, BIG = COUNTS.astype("<i2").tobytes(), COUNTS.astype(">i2").tobytes()


BY_TURNS = COUNTS.transpose(0, 2, 1).astype("<i2").tobytes()
UNSIGNED = COUNTS + 2**15

BIG_FIRST = ("order: little", "order: big")
OFFSET = ("type: int16", "type: uint16")
NO_HEADER = ("header: ieee", "header: none")
NO_STATUS = ("status: STAT?", 'status: ""')


def ends(end):
    return ('end: "\\n"\n  type', f'end: "{end}"\n  type')


@pytest.mark.parametrize(
    ("block", "changes"),
    [
        (b"#224" + LITTLE + b"\n", ()),
        (b"#3024" + LITTLE + b"\n", ()),
        (b"#224" + BIG + b"\n", [BIG_FIRST]),
        (b"#224" + BY_TURNS + b"\n", [("layout: by_channel", "layout: interleaved")]),
        (b"#224" + UNSIGNED.astype("<u2").tobytes() + b"\n", [OFFSET]),
        (b"#224" + UNSIGNED.astype(">u2").tobytes() + b"\n", [OFFSET, BIG_FIRST]),
        (LITTLE, [NO_HEADER, NO_STATUS, ends("")]),
        (b"#224" + LITTLE + b"\r\n", [NO_STATUS, ends("\\r\\n")]),
    ],
    ids=["plain", "zeros", "big", "by turns", "unsigned", "unsigned big", "bare", "crlf"],
)
def test_forms_of_blocks(received, block, changes):
    found = received(block, *changes)
    np.testing.assert_array_equal(found.counts, COUNTS)
    assert found.counts.dtype == np.int16
    assert found.volts_per_count.tolist() == [0.5, 0.25]
    assert found.status.tolist() == [0, 0]


def test_channels_the_other_way_round(received):
    swap = ("[velocity, reference]", "[reference, velocity]")
    found = received(b"#224" + LITTLE + b"\n", swap, status=b"\1\2")
    np.testing.assert_array_equal(found.counts, COUNTS[:, ::-1])
    assert found.volts_per_count.tolist() == [0.25, 0.5]
    assert found.status.tolist() == [Status.dropped_out, Status.over_range]


VOLTS = [
    ("type: int16", "type: float32"),
    ("scale: CHAN:SCAL?", "volts_per_count: {reference: 0.25, velocity: 0.5}"),
]


def volts(values):
    return b"#248" + np.asarray(values).astype("<f4").tobytes() + b"\n"


def test_volts(received):
    measured = COUNTS * np.array([0.5, 0.25])[:, None] + 0.1
    found = received(volts(measured), *VOLTS, status=b"\0\1")
    np.testing.assert_array_equal(found.counts, COUNTS)
    assert found.volts_per_count.tolist() == [0.5, 0.25]
    assert found.status.tolist() == [0, Status.dropped_out]


def test_volts_beyond_the_counts_are_flagged(received):
    measured = COUNTS * np.array([0.5, 0.25])[:, None]
    measured[0, 0, 0], measured[1, 1, 2] = -(2**14), 2**13
    found = received(volts(measured), *VOLTS, status=b"\0\1")
    assert found.counts[0, 0, 0] == -(2**15)
    assert found.counts[1, 1, 2] == 2**15 - 1
    assert found.status.tolist() == [0, Status.over_range | Status.dropped_out]


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_volts_that_are_no_numbers(bad):
    measured = np.zeros((2, 2, 3), "<f4")
    measured[1, 0, 1] = bad
    data = load_profile("virtual_lab").data
    data.type = SampleType.float32
    told = "pixel 1 has a sample that is not a finite number of volts"
    with pytest.raises(DisturbanceError, match=told):
        decoded(data, measured.tobytes(), b"", (2, 3), [1.0, 1.0], 1000.0)
