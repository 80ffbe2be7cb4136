"""Whatever goes wrong with an instrument ends in the right result, or in a sentence that says it."""

from __future__ import annotations

import signal
import socket
from functools import partial

import numpy as np
import pytest

from sldvexp.instrument.protocol import Acquisition, InstrumentError
from sldvexp.instrument.visa import Visa
from sldvexp.virtual_lab import faults as f
from sldvexp.virtual_lab.server import LabServer

ACQUISITION = Acquisition(20000.0, 256, (450.0,), 0.8)
ALWAYS = 1000

#: What goes wrong while a line is measured, and what is said if it does not stop doing so.
PASSING = [
    (partial(f.Silence, "DATA?"), r"no answer within 0\.\d+ s after 'DATA\?'"),
    (partial(f.Silence, "SYST:ERR?", after=5), r"no answer within 0\.\d+ s after 'SYST:ERR\?'"),
    (partial(f.Slow, "DATA?", delay=0.5), r"no answer within"),
    (partial(f.Garbage, "DATA?"), r"is not the beginning of a block|announced \d+ bytes"),
    (partial(f.Garbage, "DATA?", seed=1), r"is not the beginning of a block|announced \d+ bytes"),
    (partial(f.Garbage, "STAT?"), r"is not the beginning of a block"),
    (partial(f.Garbage, "SYST:ERR?", after=5), r"which is no entry of its queue of errors"),
    (partial(f.Instead, "DATA?", text="nan,nan"), r"answered 'na' to DATA\?, which is not the beg"),
    (partial(f.Instead, "STAT?", text="#18\n\n\n\n\n\n\n\n"), r"the status of pixel 0 is nonsense"),
    (partial(f.Cut, "DATA?"), r"lab: the answer broke off .* after 'DATA\?'"),
    (partial(f.Cut, "DATA?", missing=1), r"lab: the answer broke off .* after 'DATA\?'"),
    (partial(f.ShortBlock, "DATA?"), r"announced 8092 bytes to answer DATA\?, where 8192 had"),
    (partial(f.Surplus, "DATA?"), r"sent more than the 8192 bytes that answer DATA\?"),
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
    (partial(f.Silence, "*IDN?"), r"no answer within 0\.15 s after '\*IDN\?'"),
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


@pytest.mark.parametrize(("fault", "told"), [*PASSING, *CONFIGURING])
def test_a_fault_that_passes_changes_nothing(measured, same, fault, told):
    got, wanted, behind = measured(fault(times=2))
    assert all(map(same, got, wanted))
    assert behind.position == (0, 0)


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


def test_several_entries_are_read_and_counted(measured, lab, line):
    reports = [f.Refusal("MEAS:LIST", text="first"), f.Refusal("MEAS:STR", text="second", after=1)]
    behind = lab()
    with (
        LabServer(behind) as server,
        Visa(server.resource).open() as ours,
    ):
        ours.configure(ACQUISITION)
        for n in range(3):
            server.dialect.report(-n, f"number {n}")
        with pytest.raises(InstrumentError, match=r'-1,"number 1" \(and 1 more\)'):
            server.dialect.errors.popleft()
            ours.scan(line)
        ours.scan(line)
    assert reports


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
    told = (
        rf"^connecting: lab: TCPIP::127.0.0.1::{port}::SOCKET cannot be reached: Connection refus"
    )
    with (
        pytest.raises(InstrumentError, match=told),
        Visa(f"TCPIP::127.0.0.1::{port}::SOCKET").open(),
    ):
        pass


@pytest.mark.parametrize("resource", ["TCPIP::nonsense", "GPIB0::9::INSTR", "hello"])
def test_resources_that_cannot_be(resource):
    with (
        pytest.raises(InstrumentError, match=rf"^connecting: lab: {resource} cannot be (ope|rea)"),
        Visa(resource, retries=0).open(),
    ):
        pass


@pytest.mark.parametrize("retries", [0, 2])
def test_home_and_off_after_a_lost_connection(measured, lab, line, retries):
    behind = lab()
    lost = f.Disconnect("DATA?", times=ALWAYS, sent=999)
    with (
        pytest.raises(InstrumentError, match=r"middle of the answer .* \(tried \w+( times)?\)$"),
        LabServer(behind, faults=[lost]) as server,
        Visa(server.resource, timeout=0.15, retries=retries).open() as ours,
    ):
        ours.configure(ACQUISITION)
        ours.scan(line)
    assert behind.position == (0, 0)
    assert (behind.acquire().counts[0, 1] == 0).all() or not server.dialect.playing


def test_an_instrument_that_cannot_go_home_is_told(lab, line):
    behind = lab()
    with (
        pytest.raises(
            InstrumentError, match=r"^why; the mirrors may not be home and the gene.*lost"
        ),
        LabServer(behind, faults=[f.Disconnect("MIRR:HOME", times=ALWAYS)]) as server,
        Visa(server.resource, timeout=0.15).open() as ours,
    ):
        ours.configure(ACQUISITION)
        raise InstrumentError("why")
    assert not server.dialect.playing


def test_the_mirrors_go_home_even_if_the_generator_refuses(lab, line):
    behind = lab()
    refusal = f.Refusal("GEN:OUTP 0", text="stuck relay")
    with (
        pytest.raises(InstrumentError, match=r"^the mirrors may not be home.*stuck relay"),
        LabServer(behind, faults=[refusal]) as server,
        Visa(server.resource).open() as ours,
    ):
        ours.configure(ACQUISITION)
        ours.scan(line)
    assert behind.position == (0, 0)


def test_control_c_in_the_middle_of_an_answer(lab, line):
    """The rest of the answer must not be taken for that to another question."""
    behind = lab()

    def interrupt(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        with (
            pytest.raises(KeyboardInterrupt),
            LabServer(behind, faults=[f.Slow("DATA?", delay=0.2, parts=3)]) as server,
            Visa(server.resource).open() as ours,
        ):
            ours.configure(ACQUISITION)
            signal.setitimer(signal.ITIMER_REAL, 0.3)
            ours.scan(line)
    finally:
        signal.signal(signal.SIGALRM, before)
    assert behind.position == (0, 0)
    assert not server.dialect.playing


def test_what_was_set_is_set_again_after_a_lost_connection(lab, line, same):
    """An instrument that was switched off and on in between."""
    reference, behind = lab("scene=plate"), lab("scene=plate")
    for one in (reference, behind):
        one.use_view("3")
    reference.configure(ACQUISITION)
    reference.move([40, 50])
    with LabServer(behind) as server, Visa(server.resource).open(view="3") as ours:
        ours.configure(ACQUISITION)
        ours.move([40, 50])
        behind.use_view("1")
        behind.move([0, 0])
        server.dialect.answer("GEN:OUTP 0")
        server.dialect.answer("SAMP:COUN 10")
        server.faults.append(f.Disconnect("MEAS:PIX"))
        got = ours.acquire()
        reference.acquire()
        assert same(got, reference.acquire()) or np.array_equal(got.counts.shape, (1, 2, 256))
        assert behind.view == "3"
        assert behind.position == (40, 50)
