"""Whatever goes wrong with an instrument ends in the right result or in a sentence that says it."""

from __future__ import annotations

import select
import signal
import socket
import threading
from dataclasses import dataclass
from functools import partial

import pytest

from sldvexp.instrument import Acquisition, InstrumentError
from sldvexp.instrument.visa import Visa
from sldvexp.testing import faults as f
from sldvexp.virtual_lab import LabServer

pytestmark = pytest.mark.usefixtures("client_clock")

ACQUISITION = Acquisition(20000.0, 256, (450.0,), 0.8)
ALWAYS = 1000

#: What goes wrong while a line is measured, and what is said if it does not stop doing so.
PASSING = [
    (partial(f.Silence, "DATA?"), r"no answer within 0\.\d+ s after 'DATA\?'"),
    (partial(f.Silence, "SYST:ERR?", after=5), r"no answer within 0\.\d+ s after 'SYST:ERR\?'"),
    (partial(f.Slow, "DATA?", delay=0.4), r"no answer within"),
    (partial(f.Garbage, "DATA?"), r"is not the beginning of a block|announced \d+ bytes"),
    (partial(f.Garbage, "DATA?", seed=1), r"is not the beginning of a block|announced \d+ bytes"),
    (partial(f.Garbage, "STAT?"), r"is not the beginning of a block"),
    (partial(f.Garbage, "SYST:ERR?", after=5), r"which is no entry of its queue of errors"),
    (partial(f.Instead, "DATA?", text="nan,nan"), r"answered 'na' to DATA\?, which is not the beg"),
    (partial(f.Instead, "STAT?", text="#18\n\n\n\n\n\n\n\n"), r"the status of pixel 0 is nonsense"),
    (partial(f.Cut, "DATA?"), r"lab: the answer broke off .* after 'DATA\?'"),
    (partial(f.Cut, "DATA?", missing=1), r"lab: the answer broke off .* after 'DATA\?'"),
    (partial(f.ShortBlock, "DATA?"), r"announced 8092 bytes to answer DATA\?, where 8192 had"),
    (partial(f.Surplus, "DATA?"), r"after the 8192 bytes that answer DATA\?"),
    (partial(f.Disconnect, "DATA?"), r"lab: the connection was lost after 'DATA\?'"),
    (partial(f.Disconnect, "DATA?", sent=5000), r"was lost in the middle of the answer after 'DA"),
    (partial(f.Disconnect, "MEAS:LIST"), r"lab: the connection was lost"),
]

#: What goes wrong while the sampling is set.
CONFIGURING = [
    (partial(f.Instead, "CHAN:SCAL?"), r"'nan' to CHAN:SCAL\?, where 2 finite numbers had to come"),
    (partial(f.Instead, "CHAN:SCAL?", text="1,nan"), r"'1,nan' to .* 2 finite numbers"),
    (partial(f.Instead, "SAMP:RATE?"), r"'nan' to SAMP:RATE\?, where a finite number had to come"),
    (
        partial(f.Instead, "*IDN?", text="ACME,scope"),
        r"lab says that it is 'ACME,scope', which the",
    ),
    (
        partial(f.Silence, "*IDN?"),
        r"'\*IDN\?'; another program may hold the instrument, as a console",
    ),
    (partial(f.Garbage, "*IDN?"), r"which the profile does not expect \(sldvexp,virtual lab,\)"),
    (partial(f.Disconnect, "GEN:OUTP"), r"the connection was lost"),
]


@pytest.fixture
def measured(lab, line):
    """Measure a line with some faults: two lines through VISA, and what they should be."""

    def run(*faults, retries=2):
        reference, behind = lab("seed=2"), lab("seed=2")
        reference.configure(ACQUISITION)
        wanted = [reference.scan(line, stream=s) for s in (4, 5)]
        with (
            LabServer(behind, faults=faults) as server,
            Visa(server.resource, timeout=0.15, retries=retries).open() as ours,
        ):
            ours.configure(ACQUISITION)
            return [ours.scan(line, stream=s) for s in (4, 5)], wanted, behind

    return run


@pytest.mark.one_in(6)
@pytest.mark.parametrize(("fault", "told"), [*PASSING, *CONFIGURING])
def test_a_fault_that_passes_changes_nothing(measured, same, fault, told):
    got, wanted, behind = measured(fault(times=2))
    assert all(map(same, got, wanted))
    assert behind.position == (0, 0)


@pytest.mark.one_in(3)
@pytest.mark.parametrize(("fault", "told"), PASSING)
def test_a_fault_that_stays_is_told(measured, fault, told):
    """Without touching the way home, where nobody listens to `DATA?`."""
    with pytest.raises(InstrumentError, match=rf"^scanning 8 pixels: .*({told}).*\(tried once\)$"):
        measured(fault(times=1), retries=0)


@pytest.mark.parametrize(("fault", "told"), CONFIGURING)
def test_a_fault_in_the_beginning_is_told(measured, fault, told):
    with pytest.raises(InstrumentError, match=rf"^con.*ing: .*({told}).*\(tried once\)"):
        measured(fault(times=1), retries=0)


def test_patience_ends(measured):
    fault = f.Silence("DATA?", times=ALWAYS)
    with pytest.raises(InstrumentError, match=r"after 'DATA\?' \(tried 3 times\)$"):
        measured(fault)
    assert fault.times == ALWAYS - 3


def test_slow_is_not_wrong(measured, same, caplog):
    got, wanted, _ = measured(f.Slow("DATA?", times=ALWAYS, delay=0.05, parts=4), retries=0)
    assert all(map(same, got, wanted))
    assert not caplog.records


@pytest.mark.parametrize("command", ["MEAS:LIST", "DATA?", "GEN:AMPL", "MEAS:STR"])
def test_an_entry_in_the_queue_of_errors_stops_at_once(measured, command):
    fault = f.Refusal(command, times=ALWAYS, text="Hardware error; the spindle is bent")
    told = (
        r'^(scanning 8 pixels|configuring): lab reports -240,"Hardware error; the spindle is bent"'
    )
    with pytest.raises(InstrumentError, match=told):
        measured(fault)
    assert fault.times == ALWAYS - 1


def test_several_entries_are_read_and_counted(lab, line):
    with LabServer(lab()) as server, Visa(server.resource).open() as ours:
        ours.configure(ACQUISITION)
        for n in (1, 2):
            server.dialect.report(-n, f"number {n}")
        with pytest.raises(InstrumentError, match=r'-1,"number 1" \(and 1 more\) after'):
            ours.scan(line)
        assert len(ours.scan(line).counts) == len(line)


@pytest.mark.parametrize("command", ["GEN:OUTP 1", "MEAS:STR"])
def test_a_generator_that_is_off(measured, command):
    with pytest.raises(InstrumentError, match=r"the generator's output is off: lab answered '0'"):
        measured(f.GeneratorDies(command))


def test_a_shutter_that_is_closed(measured):
    with pytest.raises(InstrumentError, match=r"the laser's shutter is closed: .* 'CLOSED' to LAS"):
        measured(f.ShutterCloses("MEAS:STR", after=1))


def test_nobody_there(line):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    told = rf"^connecting: device lab: TCPIP::127.0.0.1::{port}::SOCKET cannot be reached: "
    with (
        pytest.raises(InstrumentError, match=told),
        Visa(f"TCPIP::127.0.0.1::{port}::SOCKET").open(),
    ):
        pass


@pytest.mark.parametrize("resource", ["TCPIP::nonsense", "GPIB0::9::INSTR", "hello"])
def test_resources_that_cannot_be(resource):
    with (
        pytest.raises(InstrumentError, match=rf"^connecting: device lab: {resource} cannot be "),
        Visa(resource, retries=0).open(),
    ):
        pass


@pytest.fixture
def left_behind(lab, line):
    """Scan a line with a faulty instrument and leave it; the lab afterwards, and what it plays."""

    def run(*faults, then=None, **settings):
        behind = lab()
        behind.move([9, 9])
        server = LabServer(behind, faults=faults)
        said = None
        try:
            with server, Visa(server.resource, timeout=0.15, **settings).open(view="1") as ours:
                ours.configure(ACQUISITION)
                if then is not None:
                    then()
                ours.scan(line)
        except (InstrumentError, KeyboardInterrupt) as error:
            said = error
        return behind.position, server.dialect.playing, said

    return run


@pytest.mark.parametrize("retries", [0, 2])
def test_home_and_off_after_a_lost_connection(left_behind, retries):
    lost = f.Disconnect("DATA?", times=ALWAYS, sent=999)
    position, playing, said = left_behind(lost, retries=retries)
    assert position == (0, 0)
    assert not playing
    assert "in the middle of the answer after 'DATA?' (tried" in str(said)
    assert "may not be home" not in str(said)


def test_home_and_off_although_the_view_is_refused_by_now(left_behind):
    lost, stuck = f.Disconnect("DATA?"), f.Refusal("VIEW", times=ALWAYS, after=1, text="stuck")
    position, playing, said = left_behind(lost, stuck)
    assert position == (0, 0)
    assert not playing
    assert str(said).startswith('scanning 8 pixels: lab reports -240,"stuck" after')
    assert "may not be home" not in str(said)


def test_whoever_is_refused_in_the_beginning_leaves_the_line_free(lab):
    """The server has one client at a time."""
    with LabServer(lab()) as server:
        with (
            pytest.raises(InstrumentError, match=r"no view 9") as refused,
            Visa(server.resource).open(view="9"),
        ):
            pass
        with Visa(server.resource, timeout=0.5, retries=0).open(view="1"):
            assert refused.value.__traceback__ is not None


def test_an_instrument_that_cannot_go_home_is_told(left_behind):
    def then():
        raise InstrumentError("why")

    _, playing, said = left_behind(f.Disconnect("MIRR:HOME", times=ALWAYS), then=then)
    assert not playing
    assert str(said).startswith(
        "why; the mirrors may not be home and the generator may be on: goin"
    )


@pytest.mark.parametrize("refused", ["GEN:OUTP 0", "MIRR:HOME"])
def test_home_and_off_even_if_one_of_them_is_refused(left_behind, refused):
    position, playing, said = left_behind(f.Refusal(refused, text="stuck relay"))
    assert position == (0, 0)
    assert not playing
    assert str(said).startswith("the mirrors may not be home")
    assert "stuck relay" in str(said)


@dataclass
class Interrupting(f.Fault):
    """Ctrl-C when half of the answer is sent; the rest comes when the client does something."""

    def spoil(self, answer, send, server):
        half = len(answer) // 2
        send(answer[:half])
        signal.pthread_kill(threading.main_thread().ident, signal.SIGALRM)
        select.select([server._client], [], [])
        send(answer[half:])


def test_control_c_in_the_middle_of_an_answer(left_behind):
    """The rest of the answer must not be taken for that to another question."""

    def interrupt(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        position, playing, said = left_behind(Interrupting("DATA?"))
    finally:
        signal.signal(signal.SIGALRM, before)
    assert isinstance(said, KeyboardInterrupt)
    assert position == (0, 0)
    assert not playing


def test_what_was_set_is_set_again_after_a_lost_connection(lab, line, same):
    """An instrument that was switched off and on in between."""
    reference, behind = lab("scene=plate"), lab("scene=plate")
    reference.use_view("3")
    reference.configure(ACQUISITION)
    with LabServer(behind) as server, Visa(server.resource).open(view="3") as ours:
        ours.configure(ACQUISITION)
        ours.move([40, 50])
        for command in ("VIEW 1", "MIRR:HOME", "GEN:OUTP 0", "SAMP:COUN 10", "SAMP:RATE 1"):
            server.dialect.answer(command)
        server.faults.append(f.Disconnect("MEAS:PIX"))
        assert ours.acquire().counts.shape == (1, 2, 256)
        assert behind.view == "3"
        assert behind.position == (40, 50)
        assert same(ours.scan(line, stream=1), reference.scan(line, stream=1))
