"""A scan that is paused, steered, left alone and stopped: nothing is lost, and bits stay."""

from __future__ import annotations

import threading
from dataclasses import replace

import numpy as np
import pytest

from sldvexp.console.painting import Painter, pitch, spacing
from sldvexp.console.scanning import Asked, Scanning
from sldvexp.instrument.visa import Visa
from sldvexp.scan import Sampling
from sldvexp.session.session import scan_views
from sldvexp.signal import ExcitationKind, Response
from sldvexp.stopping import Stopped
from sldvexp.virtual_lab.lab import VirtualLab
from sldvexp.virtual_lab.server import LabServer
from tests.console.test_bench import Seen


class Scripted(Scanning):
    """A controller who wishes something when so many lines are done."""

    def __init__(self, *args, script=()):
        super().__init__(*args)
        self.script, self.done, self.look = dict(script), 0, []

    def line_done(self, line):
        super().line_done(line)
        if line.again:
            return
        self.done += 1
        for wish in self.script.get(self.done, ()):
            if callable(wish):
                wish()
            else:
                self.wishes.put({"do": wish})

    def _pause(self, why):
        super()._pause(why)
        self.look.append(self.script["at_rest"]()) if "at_rest" in self.script else None


@pytest.fixture
def two_images(lab_experiment):
    """Two views of the plate alone, of few pixels."""
    structure = lab_experiment.scan.structure
    views = {name: structure.views[name] for name in ("1", "2")}
    scan = replace(structure, views=views, pixels=[6, 7])
    return replace(lab_experiment, scan=scan)


@pytest.fixture
def plain(two_images, tmp_path):
    return scan_views(two_images, tmp_path / "plain")


@pytest.fixture
def scan(two_images, board, wishes, tmp_path):
    """Scan with a script of wishes; what was scanned."""

    def scanned(script, experiment=two_images, folder="watched"):
        watcher = Scripted(experiment, board, wishes, script=script)
        try:
            return scan_views(
                experiment, tmp_path / folder, Asked(watcher), watcher=watcher
            ), watcher
        finally:
            watcher.end()

    return scanned


def same(a, b):
    return a.keys() == b.keys() and all(
        a[name]["velocity"].values.tobytes() == b[name]["velocity"].values.tobytes() for name in a
    )


def test_scan_that_is_watched_has_the_bits_of_one_that_is_not(scan, plain):
    assert same(scan({})[0], plain)


def test_pause_rests_the_instrument_and_the_scan_goes_on_with_the_same_bits(
    two_images, scan, plain
):
    e = two_images
    lab = VirtualLab(e.scene, e.laser, e.target, e.seed)
    with LabServer(lab) as server:
        far = replace(e, instrument=Visa(resource=server.resource, timeout=10.0))
        rest = [lambda: (lab.position, server.dialect.playing)]
        script = {3: ["pause", "go_on"], 8: ["lost", "taken", "go_on"], "at_rest": rest[0]}
        found, watcher = scan(script, far)
    assert same(found, plain)
    assert watcher.look == [((0, 0), False)] * 2


def test_line_is_scanned_again_with_another_noise(scan, plain):
    found, _ = scan({2: ["again"]})
    again, before = (tree["image/1"]["velocity"].values.reshape(6, 7) for tree in (found, plain))
    assert [(again[k] == before[k]).all() for k in range(6)] == [True, False, *4 * [True]]


def test_bad_lines_are_scanned_again(two_images, scan):
    vibrometer = replace(two_images.scene.vibrometer, drop_out=0.3)
    dull = replace(two_images, scene=replace(two_images.scene, vibrometer=vibrometer))
    found, _ = scan({6: ["again_bad"]}, dull)
    plain, _ = scan({}, dull, folder="dull")
    bad = [(plain["image/1"]["flags"].values.reshape(6, 7)[k] != 0).mean() > 0.2 for k in range(6)]
    again, before = (tree["image/1"]["velocity"].values.reshape(6, 7) for tree in (found, plain))
    assert any(bad)
    assert [bool((again[k] != before[k]).any()) for k in range(6)] == bad


def test_view_is_skipped_and_the_next_one_scanned(scan, plain):
    found, _ = scan({3: ["skip"]})
    assert found["image/1"].sizes["pixel"] == 3 * 7
    assert found["image/2"].equals(plain["image/2"])


def test_stopped_scan_goes_on_where_it_was_to_the_same_bits(scan, plain):
    with pytest.raises(Stopped):
        scan({5: ["stop"]})
    found, watcher = scan({})
    assert same(found, plain)
    assert watcher._progress.tally.done.total() == 84  # those of the journal too


def test_browsers_see_how_far_it_is_and_every_pixel(scan, board, plain):
    seen = Seen(board)
    scan({2: ["pause", seen.look, "go_on"]})
    word = seen.look()["scan"]
    assert (word["running"], word["part"]) == (False, 1.0)
    assert word["facts"]["view"] == "2, 2 of 2"
    assert "reference 1" in word["facts"]["level"]
    images = [h for h, _ in seen.parts if h["picture"] == "image"]
    assert {h["frequency"] for h in images if "tall" in h} == {197.0}
    assert [h["name"] for h in images if h.get("begin") and "name" in h][-1] == "2 image"


def test_image_of_a_broadband_scan_is_of_the_line_at_which_most_moves(two_images, scan, board):
    how = {"excitation": ExcitationKind.multisine, "band": [50.0, 1325.0], "records": 2}
    sampling = Sampling(rate=5120.0, samples=512, **how)
    experiment = replace(
        two_images, scan=replace(two_images.scan, sampling=sampling), signal=Response()
    )
    seen = Seen(board)
    found, _ = scan({}, experiment)
    seen.look()
    image = found["image/2"]
    power = (np.abs(image["velocity"].values) ** 2).sum(axis=0)
    strongest = image["frequency"].values[power.argmax()]
    shown = [h for h, _ in seen.parts if h["picture"] == "image" and "tall" in h]
    assert shown[-1]["frequency"] == strongest
    assert {h["among"] for h in shown} == {len(image["frequency"])}


def test_page_says_why_nothing_is_scanned_to_whom_it_concerns(board, wishes):
    seen, watcher = Seen(board), Scanning(None, board, wishes)
    for wish, told in (
        ("lost", "Nobody is steering: the scan waits"),
        ("taken", "The scan waits"),
        ("go_on", ""),
        ("pause", "Paused."),
    ):
        watcher._heed({"do": wish}, "image", 1)
        assert seen.look()["scan"]["told"].startswith(told)
        assert ("Nobody" in seen.topics["scan"]["told"]) == (wish == "lost")
    watcher.end("the instrument is lost")
    assert seen.look()["scan"]["told"] == "Nothing is scanned now: the instrument is lost"


def test_operator_is_asked_on_the_page(board, wishes):
    seen = Seen(board)

    class Answered:
        def get(self):
            told.append(seen.look()["ask"])
            return answers.pop(0)

    told, answers = (
        [],
        [{"do": "move"}, {"do": "lost"}, {"do": "taken"}, {"do": "answer", "text": " 1 2 3 "}],
    )
    watcher = Scanning(None, board, Answered())
    assert Asked(watcher).ask("View a, spot 1: x y z in m: ") == "1 2 3"
    assert told[0] == {"text": "View a, spot 1: x y z in m", "answer": True}
    answers = [{"do": "answer", "text": ""}]
    Asked(watcher).wait_for("Move the instrument to the view a, then press Enter: ")
    assert told[-1] == {
        "text": "Move the instrument to the view a, then say Go on",
        "answer": False,
    }
    assert seen.look()["ask"] is None
    watcher.end()


def test_where_a_run_is_kept_is_told_with_the_command_that_goes_on_with_it(board, wishes, tmp_path):
    watcher, seen = Scanning(None, board, wishes), Seen(board)
    watcher.run_begun(tmp_path / "a b")
    word = seen.look()["scan"]
    assert word["facts"]["kept in"] == str(tmp_path / "a b")
    assert word["resume"] == f"sldvexp console 'resume={tmp_path / 'a b'}'"
    watcher.end()


def test_pixels_of_lines_meet_their_neighbours():
    row = np.array([[0, 0], [0, 10], [0, 20]])
    assert spacing(row) == 10
    assert spacing(np.array([[0, 0], [1, 2], [2, 4]])) == 2
    assert spacing(row[:1]) == 1
    assert pitch(row) == (1, 10)


def test_picture_that_cannot_be_painted_does_not_end_a_scan(two_images, scan, plain, monkeypatch):
    def broken(*_):
        raise ZeroDivisionError

    monkeypatch.setattr(Painter, "_paint", broken)
    assert same(scan({})[0], plain)


def test_rows_of_an_image_are_not_laid_anew_for_each_of_its_lines_to_be_painted(
    two_images, scan, monkeypatch
):
    """They would cost as the square of their number; the picture's square needs them too."""
    kind, by = type(two_images.scan), []
    lines = kind.lines

    def counted(part, view):
        by.append((threading.current_thread().name, view))
        return lines(part, view)

    monkeypatch.setattr(kind, "lines", counted)
    _, watcher = scan({})
    assert sorted(view for name, view in by if name == "painter") == ["1", "1", "2", "2"]
    assert {len(found) for found in watcher._painter.bad.values()} == {6}
