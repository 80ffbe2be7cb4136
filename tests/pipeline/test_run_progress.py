"""Progress of a run: rows of every width, plain lines, and a time left that is true."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass

import pytest

from sldvexp.instrument import RawSamples, ScanningPlugin
from sldvexp.pipeline.run_progress import RunProgress
from sldvexp.progress import TimeLeft, doing
from sldvexp.session import Operator, PartAhead, ViewAhead
from sldvexp.session.session import scan_views
from tests.composing import experiment

VIEWS = "{{a: {0}, b: {0}, c: {0}}}"
CORNERS = "{corners: [[-400, 140], [-400, -900], [400, -900], [400, 140]]}"
PLACES = (
    "{a: {euler: [0.024, 2.910, -3.117], origin: [0.290, 0.530, 1.655]},"
    " b: {euler: [2.075, 2.988, -1.072], origin: [0.073, 0.015, 1.680]},"
    " c: {euler: [0.024, 2.910, -3.117], origin: [0.280, 0.530, 1.655]}}"
)
IMAGES = [
    "scene=plate",
    f"scene.views={PLACES}",
    "scan=rectangle",
    f"scan.views={VIEWS.format(CORNERS)}",
    "scan.pixels=[20,7]",
    "scan.sampling.samples=64",
]
CIRCLES = "{dac: [[-365, 1314], [-525, 595], [581, 323], [557, 1437]]}"
SESSION = [
    "scene=plate",
    f"scene.views={PLACES}",
    "scan=session",
    f"scan.calibration.views={{a: {CIRCLES}}}",
    "scan.calibration.coarse.pixels=150",
    "scan.calibration.fine.lines=8",
    "scan.calibration.sampling.samples=64",
    f"scan.structure.views={{a: {CORNERS}}}",
    "scan.structure.pixels=[30,20]",
    "scan.structure.sampling.samples=640",
]


class Clock:
    """Time that passes only where an instrument takes it."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        return self.now


@dataclass
class Slow(ScanningPlugin):
    """The virtual lab, which takes as long as a real instrument would, by a clock of its own.

    A second for opening it, some time a line and a pixel, and what a pixel's record takes. Each
    `hitch`-th line takes ten times as long, as if a command had been sent again.
    """

    lab: ScanningPlugin
    clock: Clock
    opening: float = 20.0
    line: float = 0.3
    pixel: float = 0.15
    hitch: int = 0
    ends: list[tuple[float, str]] = None

    real = False

    @contextmanager
    def open(self, *how, **more):
        self.clock.now += self.opening
        with self.lab.open(*how, **more) as lab:
            self.opened, self.lines = lab, 0
            yield self

    def configure(self, acquisition):
        self.acquisition = acquisition
        self.opened.configure(acquisition)

    def scan(self, dac, stream=None) -> RawSamples:
        record = self.acquisition.samples / self.acquisition.rate
        taken = self.line + len(dac) * (self.pixel + record)
        self.lines += 1
        self.clock.now += taken * (10 if self.hitch and self.lines % self.hitch == 0 else 1)
        return self.opened.scan(dac, stream)


class Noted(RunProgress):
    """Notes after every line what is told, and when that was."""

    def __init__(self, clock):
        super().__init__(quiet=True, clock=clock)
        self.clock, self.told, self.at = clock, [], []

    def line_done(self, line):
        super().line_done(line)
        self.told.append((self._scan.share, self._scan.seconds_left, self.clock.now))
        self.at.append(list(self._scan.rows("step 2 of 5: scan", 200)))

    def session_done(self):
        super().session_done()
        self.end = self.clock.now


def scanned(settings, folder, operator=None, **how):
    """Scan with the slow lab; what was told, and the relative errors of it by share done."""
    chosen = ["~experiment", "target=dissertation", "signal=sine_fit", "instrument=simulated"]
    made = experiment(*chosen, *settings)
    clock = Clock()
    made.instrument = Slow(made.instrument, clock, **how)
    watcher = Noted(clock)
    scan_views(made, folder, operator and operator(watcher, clock), watcher=watcher)
    errors = [
        (share, (left - (watcher.end - at)) / (watcher.end - at))
        for share, left, at in watcher.told
        if left is not None and watcher.end > at
    ]
    return watcher, errors


def require_true(errors, limit=0.2):
    late = [error for share, error in errors if 0.25 <= share < 0.9]
    assert len(late) > 10
    assert max(map(abs, late)) <= limit, late


@pytest.mark.whole
@pytest.mark.parametrize("hitch", [0, 4])
def test_time_left_is_true_after_a_quarter_of_the_work(tmp_path, hitch):
    """The three views are opened one after the other, which is in it too."""
    require_true(scanned(IMAGES, tmp_path, hitch=hitch)[1])


@pytest.mark.whole
def test_time_left_knows_of_the_longer_records_of_the_next_part(tmp_path):
    require_true(scanned(SESSION, tmp_path)[1])


@pytest.mark.whole
def test_what_the_journal_has_takes_no_time(tmp_path):
    scanned(IMAGES, tmp_path)
    for line in (tmp_path / "b").glob("image_*.npz"):
        line.unlink()
    for line in (tmp_path / "c").glob("image_01*.npz"):
        line.unlink()
    watcher, errors = scanned(IMAGES, tmp_path)
    assert watcher.told[0][1] is None
    late = [error for share, error in errors if share > 0.5]
    assert len(late) > 10
    assert max(map(abs, late)) <= 0.2, late


def test_the_time_in_which_somebody_is_asked_is_not_the_scans(tmp_path):
    class Slowly(Operator):
        def __init__(self, watcher, clock):
            super().__init__(watcher)
            self.clock = clock

        def ask(self, request):
            with self._watcher.asking(request):
                self.clock.now += 600.0
            return ""

    class Moved(Slow):
        takes_views_itself = False

    before = globals()["Slow"]
    globals()["Slow"] = Moved
    try:
        watcher, _ = scanned(IMAGES, tmp_path, Slowly)
    finally:
        globals()["Slow"] = before
    scanning = 3 * (20.0 + 20 * (0.3 + 7 * (0.15 + 64 / 25600)))
    assert watcher.end == pytest.approx(scanning + 3 * 600.0)
    share, left, _ = watcher.told[len(watcher.told) // 2]
    assert left == pytest.approx((1 - share) * scanning, rel=0.2)


def test_one_stuck_line_does_not_spoil_the_estimate():
    left = TimeLeft({"image": 0.1})
    for seconds in [10.0] * 5 + [900.0] + [10.0] * 5:
        left.add("image", 50, seconds)
    assert left.left({"image": 500}) == pytest.approx(100.0, rel=0.3)
    assert left.left({"image": 0}) == 0
    assert TimeLeft({}).left({"image": 500}) is None
    left.forget("image")
    assert left.left({"image": 500}) is None


VIEW = ViewAhead("a view of a long name", 2, 4, (PartAhead("image", 10, 310, 0, 60.0),))


@pytest.mark.parametrize("width", [20, 37, 77, 120])
def test_rows_fit_every_width(width):
    progress = RunProgress(quiet=True, title="run 12 of 100")
    progress.step_begun("comparison of the views of points", 11, 12)
    assert all(len(row) <= width for row in progress.rows(width))
    progress.session_begun((VIEW,) * 4)
    progress.view_begun(VIEW)
    progress.between_lines("a", "2_coarse", 3, 10)
    rows = progress.rows(width)
    assert len(rows) == 2
    assert all(len(row) <= width for row in rows)
    assert "view 2 of 4" in rows[0] or "a view" in rows[0]
    assert "0 %" in rows[1]


def test_plain_lines_where_there_is_no_terminal(capsys):
    progress = RunProgress()
    with progress:
        progress.step_begun("scan", 2, 5)
        progress.session_begun((VIEW,))
        progress.view_begun(VIEW)
        progress.session_done()
        progress.step_begun("pose", 3, 5)
    with doing("drawing"):
        pass
    assert capsys.readouterr().out.splitlines() == [
        "step 2 of 5: scan",
        "view 2 of 4, a view of a long name: 310 pixels",
        "step 3 of 5: pose",
    ]


def test_a_run_of_many_says_no_lines(capsys):
    with (progress := RunProgress(title="run 1 of 2")):
        progress.step_begun("scan", 2, 5)
    with (progress := RunProgress(quiet=True)):
        progress.step_begun("scan", 2, 5)
    assert capsys.readouterr().out == ""
