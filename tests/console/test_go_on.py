"""A scan that has failed goes on in the console that began it, and one that was cut off before."""

from __future__ import annotations

import threading
from contextlib import suppress

import pytest

from sldvexp.console import Console
from sldvexp.console.afterwards import Advice
from sldvexp.instrument import NOT_HOME
from sldvexp.session.interruption import (
    LINES_KEPT,
    InterruptedRun,
    UnfinishedError,
    kept_lines,
)
from tests.console.test_bench import Seen


@pytest.fixture
def console(lab_experiment, tmp_path):
    """A console whose runs fail once, and are done when they go on; what was run."""
    runs = []

    def run(settings, watcher, operator):
        runs.append(list(settings))
        if len(runs) == 1:
            left = f"{NOT_HOME}: lost; {LINES_KEPT}; or so"  # words say nothing of themselves
            raise UnfinishedError("sampling: no answer", tmp_path, not_home=left)
        raise KeyboardInterrupt

    def made(unfinished=None):
        return Console(
            lab_experiment,
            ["experiment=plate"],
            tmp_path,
            lambda settings: lab_experiment,
            run,
            unfinished=unfinished,
        )

    return made, runs


def test_scan_that_failed_goes_on_here_and_the_instrument_is_doubted_until_it_answers(
    console, tmp_path
):
    made, runs = console
    one = made()
    seen = Seen(one.board)
    one.bench.further["scan"]({"do": "scan"})
    topics = seen.look()
    assert topics["scan"]["resumable"]
    assert not topics["scan"]["running"]
    for told in (topics["said"]["text"], topics["scan"]["told"], topics["result"]["told"]):
        assert "Go on does that here, or once this console has ended: sldvexp " in told
        assert NOT_HOME in told
    one.bench.steered = True
    one.bench._tell_level()
    topics = seen.look()
    assert topics["said"]["text"] == "The instrument answers again."
    for told in (topics["scan"]["told"], topics["result"]["told"]):
        assert NOT_HOME not in told
        assert "sampling: no answer; what was scanned is kept, Go on does that here" in told
    with pytest.raises(KeyboardInterrupt):
        one.bench.further["go_on"]({"do": "go_on"})
    assert runs[1] == [f"resume={tmp_path}"]


def test_go_on_is_not_promised_to_help_where_it_would_end_alike(lab_experiment, tmp_path):
    def run(settings, watcher, operator):
        raise UnfinishedError("scan: no edge", tmp_path, kept_lines(tmp_path, mend=True))

    words = ["experiment=plate"]
    one = Console(lab_experiment, words, tmp_path, lambda settings: lab_experiment, run)
    one.bench.further["scan"]({"do": "scan"})
    told = Seen(one.board).look()["scan"]["told"]
    assert "scan: no edge; what was scanned is kept: once that is mended, Go on does here" in told
    assert told.endswith("begin a fresh console with it, without resume")


def test_every_scan_shows_its_tab_also_after_one_that_failed(console):
    """A browser shows a tab when it is told of one anew, whichever it shows by then."""
    made, _ = console
    one = made()
    seen = Seen(one.board)
    counts = [seen.look()["phase"]["count"]]
    for wish in ("scan", "scan"):
        with suppress(KeyboardInterrupt):
            one.bench.further[wish]({"do": wish})
        assert seen.look()["phase"]["tab"] == "scan"
        counts.append(seen.topics["phase"]["count"])
    assert counts == sorted(set(counts))


def test_console_of_a_run_that_was_cut_off_offers_to_go_on(console, tmp_path):
    made, _ = console
    topics = Seen(made(tmp_path).board).look()
    scan = topics["scan"]
    assert topics["phase"]["tab"] == "scan"
    assert scan["resumable"]
    assert "Go on scans what is missing" in scan["told"]
    one = made()
    one.bench._safely(lambda: one.bench.further["go_on"]({"do": "go_on"}))
    assert Seen(one.board).look()["said"]["text"] == "there is no scan to go on with"


def test_scan_that_begins_says_so_before_the_session_tells_of_it(lab_experiment, tmp_path):
    told = []

    def run(settings, watcher, operator):
        told.append(seen.look()["scan"]["told"])
        raise UnfinishedError("no", tmp_path)

    words = ["experiment=plate"]
    one = Console(lab_experiment, words, tmp_path, lambda settings: lab_experiment, run)
    seen = Seen(one.board)
    one.bench.further["scan"]({"do": "scan"})
    assert told[0].startswith("The scan begins: ")


def test_the_end_waits_for_advice_that_is_computed(lab_experiment, tmp_path):
    """A thread that draws while the interpreter ends aborts the process."""
    begun, finish, ended = threading.Event(), threading.Event(), []

    def advise(experiment, groups):
        begun.set()
        finish.wait()
        ended.append(True)
        return Advice(["enough"])

    words = ["experiment=plate"]
    one = Console(
        lab_experiment, words, tmp_path, lambda settings: lab_experiment, None, advise=advise
    )
    with one:
        one.bench.further["plan"]({"do": "plan"})
        begun.wait()
        threading.Timer(0.2, finish.set).start()
    assert ended == [True]


@pytest.mark.whole
def test_marks_that_contradict_one_another_are_told_once_before_the_scan(lab_experiment, tmp_path):
    runs = []

    def run(settings, watcher, operator):
        runs.append(list(settings))
        raise UnfinishedError("no", tmp_path)

    words = ["experiment=plate"]
    one = Console(lab_experiment, words, tmp_path, lambda settings: lab_experiment, run)
    seen = Seen(one.board)
    places = [(-371, 1322), (-517, 601), (588, 318), (551, 1030)]  # the last 400 steps beside
    for number, steps in enumerate(places, 1):
        one.bench.marks.put("1", ("circle", number), steps)
    wish = {"do": "scan", "name": "aimed"}
    for _ in range(2):
        one.bench._safely(lambda: one.bench.further["scan"](wish))
        if not runs:  # of the first time
            told = seen.look()["said"]
            assert told["problem"]
            assert told["text"].startswith("view 1: circles 1, 2, 3 and 4 contradict one another")
            assert told["text"].endswith("or Scan again, which scans with the marks as they are")
    assert len(runs) == 1


def test_console_that_had_an_instrument_says_how_it_is_left(lab_experiment, tmp_path):
    one = Console(lab_experiment, ["experiment=plate"], tmp_path, None, None)
    for wish in ({"do": "taken"}, {"do": "move", "to": [30, 40]}):
        one.wishes.put(wish)
        one.bench.turn()

    def ended():
        raise KeyboardInterrupt

    one.bench.turn = ended
    assert one.serve() == ("the console has ended: the mirrors are home and the generator is off")
    one.bench.doubt()
    assert "did not answer at last: see to its mirrors" in one.serve()
    unfinished = InterruptedRun("interrupted", tmp_path)

    def ended_in_a_scan():
        raise unfinished

    one.bench.turn = ended_in_a_scan
    assert one.serve().endswith(
        f"; what was scanned is kept, go on with: sldvexp console resume={tmp_path}"
    )
