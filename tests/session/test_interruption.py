"""What Ctrl-C does, and when."""

from __future__ import annotations

import signal
import threading
from pathlib import Path

import pytest

from sldvexp.config.paths import CONFIGURATION
from sldvexp.errors import UserError
from sldvexp.instrument.recording import JOURNAL
from sldvexp.session.interruption import how_to_go_on, telling_of_the_scan
from sldvexp.stopping import (
    SIGNALS,
    Stopped,
    exit_status,
    handlers_kept,
    heed,
    stopping_once,
    undisturbed,
)


@pytest.fixture(autouse=True)
def usual():
    """Python's own way with Ctrl-C, also where the tests run in the background or by nohup."""
    ways = dict.fromkeys(SIGNALS, signal.SIG_DFL) | {signal.SIGINT: signal.default_int_handler}
    before = {number: signal.signal(number, way) for number, way in ways.items()}
    yield signal.default_int_handler
    for number, way in before.items():
        signal.signal(number, way)


def press(number=signal.SIGINT):
    signal.raise_signal(number)


def test_ctrl_c_waits_for_what_must_not_be_disturbed(usual):
    done = []

    def go_home():
        with undisturbed():
            press()
            press()
            done.append("home")

    with pytest.raises(KeyboardInterrupt):
        go_home()
    assert done == ["home"]
    assert signal.getsignal(signal.SIGINT) is usual


def test_an_error_on_the_way_home_is_not_hidden(usual):
    def fail():
        with undisturbed():
            press()
            raise OSError("the cable is out")

    with pytest.raises(OSError, match="the cable is out"):
        fail()
    assert signal.getsignal(signal.SIGINT) is usual


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_first_one_stops_and_no_other_counts(number):
    with handlers_kept():
        with pytest.raises(KeyboardInterrupt) as stopped, stopping_once():
            press(number)
        for other in SIGNALS:
            press(other)  # while the operator is told what is kept
        assert exit_status(stopped.value) == 128 + number
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_a_signal_that_waited_is_the_one_that_stops(usual):
    def go_home():
        with undisturbed():
            press(signal.SIGTERM)
            press(signal.SIGHUP)

    with handlers_kept():
        heed()
        with pytest.raises(Stopped) as stopped:
            go_home()
        assert stopped.value.number == signal.SIGTERM


def test_what_nobody_stops_leaves_ctrl_c_as_it_was(usual):
    with stopping_once():
        pass
    assert signal.getsignal(signal.SIGINT) is usual
    with pytest.raises(ZeroDivisionError), stopping_once():
        raise ZeroDivisionError
    assert signal.getsignal(signal.SIGINT) is usual


@pytest.mark.parametrize("context", [undisturbed, stopping_once])
def test_who_ignores_ctrl_c_goes_on_ignoring_it(context):
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with context():
        press()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN


@pytest.mark.parametrize("context", [undisturbed, stopping_once])
def test_other_threads_have_no_say_in_it(context, usual):
    seen = []

    def work():
        with context():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert seen == [usual]


def test_the_command_that_goes_on_can_be_pasted():
    assert how_to_go_on(Path("a b")).endswith("go on with: sldvexp 'resume=a b'")


@pytest.mark.parametrize("scanned", [True, False])
@pytest.mark.parametrize("kept", [True, False])
def test_a_mistake_behind_the_scan_tells_that_it_is_kept(tmp_path, scanned, kept):
    folder = tmp_path / "a b"
    (folder / JOURNAL / "front").mkdir(parents=True)
    (folder / JOURNAL / "front" / ("line.npz" if kept else CONFIGURATION)).touch()
    with pytest.raises(UserError) as error, telling_of_the_scan(folder, scanned):
        raise UserError("field: it is too large")
    told = "; the scan is kept: mend the configuration's file, or add settings that differ at "
    told += f"the end, and go on with: sldvexp 'resume={folder}'"
    assert str(error.value) == "field: it is too large" + (told if scanned and kept else "")
