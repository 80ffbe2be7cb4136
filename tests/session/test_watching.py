"""Who watches a session is told of every view and line, and may wait, skip, repeat and stop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.config.paths import JOURNAL
from sldvexp.dataset import take_findings
from sldvexp.errors import UserError
from sldvexp.instrument import Replay
from sldvexp.session import Watcher, Wish
from sldvexp.session.session import scan_views
from sldvexp.stopping import Stopped

PLATE = [
    "scan=session",
    "scan.calibration.views={a: {dac: [[-365, 1314], [-525, 595], [581, 323], [557, 1437]]}}",
    "scan.calibration.coarse.pixels=150",
    "scan.calibration.fine.lines=8",
    "scan.calibration.sampling.samples=64",
    "scan.structure.views={a: {corners: [[-640, 140], [-640, -1440], [660, -1440], [660, 140]]}}",
    "scan.structure.pixels=[4,6]",
]
IMAGE = [
    "scan=rectangle",
    "scan.views={a: {corners: [[-640, 140], [-640, -1440], [660, -1440], [660, 140]]},"
    " b: {corners: [[-600, 100], [600, 100], [600, -1300], [-600, -1300]]}}",
    "scan.pixels=[4,6]",
]


class Told(Watcher):
    """Remembers all it is told, and wishes what it is given for a place."""

    def __init__(self, wishes=None):
        self.wishes = wishes or {}
        self.heard, self.lines, self.ahead, self.groups = [], [], [], {}

    def session_begun(self, views):
        self.ahead = views
        self.heard.append("session")

    def view_begun(self, view):
        assert view in self.ahead
        self.heard.append(view.name)

    def between_lines(self, view, lines, done, count):
        assert 0 <= done <= count
        return self.wishes.pop((view, lines, done), Wish())

    def line_done(self, line):
        self.lines.append(line)

    def view_done(self, view, groups):
        self.groups |= groups
        self.heard.append(f"{view.name} done")

    def session_done(self):
        self.heard.append("session done")


def require_same(one, two):
    assert one.keys() == two.keys()
    for name, group in one.items():
        assert group.identical(two[name]), name


@pytest.mark.whole
def test_it_is_told_of_all_that_comes_and_changes_nothing(composed, tmp_path):
    experiment = composed(*PLATE)
    alone = scan_views(experiment, tmp_path / "alone")
    watcher = Told()
    require_same(scan_views(experiment, tmp_path / "watched", watcher=watcher), alone)
    assert watcher.heard == ["session", "a", "a done", "session done"]
    assert watcher.groups.keys() == alone.keys()
    (view,) = watcher.ahead
    assert (view.number, view.count, view.kept) == (1, 1, 0)
    assert [part.kind for part in view.parts] == ["circles", "image"]
    assert view.lines == len(watcher.lines)
    assert view.pixels == sum(len(line.dac) for line in watcher.lines)
    for part in view.parts:
        own = [line for line in watcher.lines if line.kind == part.kind]
        assert (part.lines, part.pixels) == (len(own), sum(len(line.dac) for line in own))
    image = [line for line in watcher.lines if line.lines == "image"]
    assert [(line.number, line.count) for line in image] == [(1, 4), (2, 4), (3, 4), (4, 4)]
    velocity = np.concatenate([line.image.velocity for line in image])
    np.testing.assert_array_equal(velocity, alone["image/a"]["velocity"])
    np.testing.assert_array_equal(np.concatenate([i.dac for i in image]), alone["image/a"]["dac"])
    assert all(0 < volts < 10 for line in image for volts in line.level)


def test_lines_that_the_journal_has_are_told_as_kept(composed, tmp_path):
    experiment = composed(*IMAGE)
    first = scan_views(experiment, tmp_path)
    (tmp_path / "b" / "image_002.npz").unlink()
    watcher = Told()
    require_same(scan_views(experiment, tmp_path, watcher=watcher), first)
    assert [(view.pixels, view.kept) for view in watcher.ahead] == [(24, 24), (24, 18)]
    assert [line.number for line in watcher.lines if not line.kept] == [3]


def test_a_line_that_is_scanned_again_takes_the_place_of_the_first_whole(composed, tmp_path):
    experiment = composed(*IMAGE)
    plain = scan_views(experiment, tmp_path / "plain")
    watcher = Told({("a", "image", 3): Wish(again=(2,)), ("a", "image", 4): Wish(again=(4,))})
    found = scan_views(experiment, tmp_path / "again", watcher=watcher)
    told = [(line.number, line.again) for line in watcher.lines if line.view == "a"]
    assert told == [(1, False), (2, False), (3, False), (2, True), (4, False), (4, True)]
    other = (found["image/a"]["velocity"] != plain["image/a"]["velocity"]).values.any(axis=1)
    assert other.reshape(4, 6).any(axis=1).tolist() == [False, True, False, True]
    assert found["image/b"].identical(plain["image/b"])
    require_same(scan_views(experiment, tmp_path / "again"), found)


@pytest.mark.whole
def test_a_session_that_is_stopped_goes_on_to_the_same_bits(composed, tmp_path):
    experiment = composed(*PLATE)
    whole = scan_views(experiment, tmp_path / "whole")
    for lines, done in (("2_coarse", 0), ("3_fine", 2), ("image", 4)):
        watcher = Told({("a", lines, done): Wish(stop=True)})
        with pytest.raises(Stopped):
            scan_views(experiment, tmp_path / "stopped", watcher=watcher)
    require_same(scan_views(experiment, tmp_path / "stopped"), whole)


@pytest.mark.whole
def test_a_skipped_image_keeps_the_lines_that_are_done_also_when_resumed(composed, tmp_path):
    experiment = composed(*IMAGE)
    whole = scan_views(experiment, tmp_path / "whole")
    watcher = Told({("a", "image", 2): Wish(skip=True)})
    found = scan_views(experiment, tmp_path / "skipped", watcher=watcher)
    assert watcher.heard == ["session", "a", "a done", "b", "b done", "session done"]
    assert found["image/b"].identical(whole["image/b"])
    assert "shape" not in found["image/a"].attrs
    (told,) = take_findings(dict(found))
    assert told.text == "the rest of view a was skipped: 2 of 4 lines were scanned"
    short = whole["image/a"].isel(pixel=slice(12))
    np.testing.assert_array_equal(found["image/a"]["velocity"], short["velocity"])
    np.testing.assert_array_equal(found["image/a"]["dac"], short["dac"])
    require_same(scan_views(experiment, tmp_path / "skipped"), found)

    # So does a recording, and the recording of one.
    (tmp_path / "run").mkdir()
    (tmp_path / "skipped").rename(tmp_path / "run" / JOURNAL)
    for last, again in (("run", "second"), ("second", "third")):
        replayed = replace(experiment, instrument=Replay(str(tmp_path / last)), scene=None)
        (tmp_path / again).mkdir()
        require_same(scan_views(replayed, tmp_path / again / JOURNAL), found)


def test_a_skipped_calibration_object_leaves_nothing_of_its_view(composed, tmp_path):
    experiment = composed(*PLATE)
    watcher = Told({("a", "1_fine", 3): Wish(skip=True)})
    with pytest.raises(UserError, match="every view was skipped"):
        scan_views(experiment, tmp_path, watcher=watcher)
    with pytest.raises(UserError, match="every view was skipped"):
        scan_views(experiment, tmp_path)


@pytest.mark.whole
def test_of_a_skipped_view_what_was_whole_stays(composed, tmp_path):
    experiment = composed(*PLATE)
    whole = scan_views(experiment, tmp_path / "whole")
    watcher = Told({("a", "image", 0): Wish(skip=True)})
    found = scan_views(experiment, tmp_path / "skipped", watcher=watcher)
    (told,) = take_findings(found)
    assert told.text == "the rest of view a was skipped: 44 of 48 lines were scanned"
    require_same(found, {"edge/a": whole["edge/a"]})
