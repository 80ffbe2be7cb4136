"""After a scan a view that is aimed anew is scanned anew, and the good ones are kept."""

from __future__ import annotations

import contextlib
from pathlib import Path

import pytest

from sldvexp.config.paths import JOURNAL
from sldvexp.console import Console
from sldvexp.errors import UserError
from sldvexp.session.interruption import UnfinishedError
from sldvexp.session.session import scan_views
from sldvexp.virtual_lab.console import experiment
from tests.console.conftest import BENCH
from tests.console.test_bench import Seen

CIRCLES = {
    "1": [(-371, 1322), (-517, 601), (588, 318), (551, 1430)],
    "2": [(-225, 1163), (-464, 551), (596, 307), (657, 1268)],
}
CORNERS = {
    "1": [(-661, 159), (-659, -1454), (683, -1503), (682, 165)],
    "2": [(-639, 152), (-836, -1426), (574, -1485), (689, 158)],
}
COARSE = ["scan.structure.pixels=[3,4]", "scan.calibration.fine.lines=8"]


class Bench:
    """A console whose runs scan for real, into a folder each; they end when the scan is whole."""

    def __init__(self, folder: Path) -> None:
        (folder / "experiment").mkdir()
        (folder / "experiment" / "bench.yaml").write_text(BENCH)
        self.folder, self.stop_after = folder, ""
        self.settings = ["experiment=bench", *COARSE]
        self.runs: list[Path] = []
        self.one = Console(self.compose(self.settings), self.settings, folder, self.compose, self)
        self.seen = Seen(self.one.board)

    def compose(self, settings):
        return experiment(settings, str(self.folder))

    def __call__(self, settings, watcher, operator) -> Path:
        run = self.folder / f"run_{len(self.runs) + 1}"
        self.runs.append(run)
        made = self.compose(settings)
        with watcher:
            watcher.run_begun(run)
            with contextlib.suppress(UserError):
                scan_views(made, run / JOURNAL, operator, watcher=_Until(watcher, self.stop_after))
        raise UnfinishedError("stopped", run)

    def mark(self, view: str, by: int = 0) -> None:
        self.one.bench.views = list(dict.fromkeys([*self.one.bench.views, view]))
        for kind, places in (("circle", CIRCLES[view]), ("corner", CORNERS[view])):
            for number, (up, left) in enumerate(places, 1):
                self.one.bench.marks.put(view, (kind, number), (up + by, left))
        self.one.bench._tell_marks()

    def scan(self, **more) -> None:
        self.one.bench._safely(
            lambda: self.one.bench.further["scan"]({"do": "scan", "name": "aimed", **more})
        )

    @property
    def ahead(self):
        return self.seen.look()["ahead"]

    def measured(self, number: int) -> dict[str, bytes]:
        journal = self.runs[number] / JOURNAL
        return {str(p.relative_to(journal)): p.read_bytes() for p in journal.rglob("*.npz")}


class _Until:
    """A watcher that stops the session before a view."""

    def __init__(self, watcher, view: str) -> None:
        self._watcher, self._view = watcher, view

    def __getattr__(self, name):
        return getattr(self._watcher, name)

    def view_begun(self, view) -> None:
        if view.name == self._view:
            raise UserError("stopped")
        self._watcher.view_begun(view)


@pytest.fixture
def bench(tmp_path):
    return Bench(tmp_path)


@pytest.mark.whole
def test_view_that_is_aimed_anew_is_scanned_anew_and_the_other_is_kept(bench):
    assert bench.ahead["label"] == "Scan"
    bench.mark("1")
    bench.mark("2")
    assert bench.ahead["label"] == "Scan"
    bench.scan()
    assert bench.ahead["label"] == "Scan all views anew"
    first = bench.measured(0)
    assert {name.partition("/")[0] for name in first} == {"1", "2"}

    bench.mark("2", by=4)
    assert bench.ahead["label"] == "Scan view 2 anew, keep 1"
    assert bench.ahead["changed"] == ["2"]
    told = bench.ahead["go_on"]
    assert "what was marked since in view 2 does not count" in told
    assert "For that: Scan view 2 anew, keep 1, at Aim" in told
    bench.scan()
    second = bench.measured(1)
    assert second.keys() == first.keys()
    kept = {name for name in first if second[name] == first[name]}
    assert all(name in kept for name in first if name.startswith("1/"))
    # Fine lines lie around the ellipse that is found, which may be to the step where it was.
    assert not [name for name in kept if name.startswith("2/") and "fine" not in name]
    # What the first run has measured is as it was.
    assert bench.measured(0) == first
    facts = bench.seen.look()["scan"]["facts"]
    assert facts["not scanned anew"] == f"view 1 of {bench.runs[0]}"
    assert bench.ahead["label"] == "Scan all views anew"


@pytest.mark.whole
def test_view_that_was_not_reached_is_scanned_and_every_view_if_that_is_wished(bench):
    bench.mark("1")
    bench.mark("2")
    bench.stop_after = "2"
    bench.scan()
    assert bench.ahead["label"] == "Scan view 2, keep 1"
    bench.mark("1", by=4)  # now both are to be scanned
    assert bench.ahead["label"] == "Scan view 1 anew and view 2"
    bench.one.bench.marks.undo()
    bench.mark("1")
    bench.stop_after = ""
    bench.scan(anew=True)
    assert "not scanned anew" not in bench.seen.look()["scan"]["facts"]
    assert {name.partition("/")[0] for name in bench.measured(1)} == {"1", "2"}


@pytest.mark.whole
def test_view_is_not_kept_whose_experiment_has_changed_since(bench):
    bench.mark("1")
    bench.mark("2")
    bench.scan()
    bench.mark("2", by=4)
    path = bench.folder / "experiment" / "bench.yaml"
    path.write_text(path.read_text().replace("coarse: {lines: 3", "coarse: {lines: 5"))
    bench.scan()
    assert len(bench.runs) == 1
    assert "view 1 was scanned with another configuration" in bench.seen.look()["said"]["text"]
