"""What was aimed is an experiment that a run takes as it is, and no file is lost by it."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
import yaml

from sldvexp.cli.console import composed
from sldvexp.config import hydra_plugin
from sldvexp.config.experiment import Experiment
from sldvexp.console.console import Console
from sldvexp.console.marks import CIRCLE, CORNER, SPOT, AimedMarks, view_names, wanted
from sldvexp.console.written import settings_with, write_experiment
from sldvexp.errors import UserError
from sldvexp.scan.by_digitizer import ByDigitizer
from sldvexp.scan.calibration import CalibrationScan
from sldvexp.scan.rectangle import Rectangle
from sldvexp.scan.session import Session
from tests.console.conftest import BENCH


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "bench.yaml").write_text(BENCH)
    hydra_plugin.install()
    return tmp_path


@pytest.fixture
def marks() -> AimedMarks:
    made = AimedMarks()
    for number, steps in enumerate([(-371, 1322), (-517, 601), (588, 318), (551, 1430)], 1):
        made.put("1", (CIRCLE, number), steps)
    for number, steps in enumerate([(-661, 159), (-659, -1454), (683, -1503), (682, 165)], 1):
        made.put("1", (CORNER, number), steps)
    return made


@pytest.mark.whole
def test_aimed_experiment_is_the_other_one_with_the_places_that_were_marked(folder, marks):
    base = ["experiment=bench", "scan.structure.pixels=[9,11]", "seed=3"]
    scan = marks.settings(composed(base, str(folder)))
    path = write_experiment(folder, "bench_aimed", base, scan)
    made = composed(settings_with(base, "bench_aimed"), str(folder))
    assert made.scan.view_names() == ["1"]
    assert made.scan.calibration.views["1"].dac[0] == [-371, 1322]
    assert made.scan.structure.views["1"].corners[3] == [682, 165]
    assert (made.scan.calibration.fine.lines, made.scan.structure.pixels) == (16, [9, 11])
    assert made.seed == 3
    text = path.read_text()
    assert f"sldvexp --config-dir {folder} experiment=bench_aimed" in text
    assert yaml.safe_load(text)["defaults"] == ["/experiment/bench", "_self_"]


def test_file_that_is_there_stays_unless_it_may_be_replaced(folder, marks):
    scan = marks.settings(Experiment(scan=CalibrationScan()))
    path = write_experiment(folder, "mine", ["experiment=bench"], scan)
    path.write_text("dear to somebody")
    with pytest.raises(UserError, match="exists; take another name"):
        write_experiment(folder, "mine", ["experiment=bench"], scan)
    assert path.read_text() == "dear to somebody"
    write_experiment(folder, "mine", ["experiment=bench"], scan, replace=True)
    assert "Aimed with" in path.read_text()


def test_console_replaces_what_it_wrote_itself_and_nothing_that_was_changed(folder):
    words = ["experiment=bench"]
    console = Console(composed(words, str(folder)), words, folder, None, None)
    console.server._socket.close()  # nobody is served
    console.bench.marks.put("1", (CIRCLE, 1), (1, 2))
    console._write({"do": "write", "name": "mine"})
    console.bench.marks.put("1", (CIRCLE, 1), (3, 4))
    console._write({"do": "write", "name": "mine"})
    path = folder / "experiment" / "mine.yaml"
    assert "- [3, 4]" in path.read_text() or "[[3, 4]]" in path.read_text()
    news, _ = console.board.news(console.board.reader(lambda: None))
    told = next(t for t in news if isinstance(t, str) and '"written"' in t)
    assert f"sldvexp --config-dir {folder} experiment=mine scans it" in told
    path.write_text(path.read_text() + "seed: 3\n")
    with pytest.raises(UserError, match="exists; take another name"):
        console._write({"do": "write", "name": "mine"})
    console._write({"do": "write", "name": "mine", "replace": True})
    assert "seed" not in path.read_text()


def test_file_and_what_is_told_of_it_follow_the_marks(folder):
    words = ["experiment=bench"]
    base = composed(words, str(folder))
    console = Console(base, words, folder, None, None)
    console.server._socket.close()  # nobody is served
    path = folder / "experiment" / "mine.yaml"

    def told():
        console.bench._tell_marks()
        reader = console.board.reader(lambda: None)
        news = [json.loads(t) for t in console.board.news(reader)[0] if isinstance(t, str)]
        return next(word["word"] for word in news if word["topic"] == "written")

    for steps in ((1, 2), (3, 4)):
        console.bench.marks.put("1", (CIRCLE, 1), steps)
        console._write({"do": "write", "name": "mine"})
    command = f"sldvexp --config-dir {folder} experiment=mine scans"
    assert told() == f"{path}; {command} it"
    console.bench._do({"do": "undo"})
    assert told() == f"{path} has earlier marks than these: Write brings it up to date"
    console.bench._do({"do": "undo"})
    assert told() == f"{path} has no marks any more; {command} what the console began with"
    made = composed(["experiment=mine"], str(folder))
    assert made.scan.calibration.views == {}
    assert made == base
    console.bench._do({"do": "redo"})
    assert "Write brings it up to date" in told()
    console._write({"do": "write", "name": "mine"})
    path.write_text(path.read_text() + "seed: 3\n")
    console.bench._do({"do": "undo"})
    assert told() == f"{path} was changed by somebody and keeps the marks taken back here"
    assert "seed: 3" in path.read_text()


@pytest.mark.parametrize("name", ["", "../evil", "a/b", "a b", "x" * 65, ".hidden", "ü", "a\nb"])
def test_name_that_is_none_is_refused(folder, name):
    with pytest.raises(UserError, match="cannot be a name"):
        write_experiment(folder, name, [], {})
    assert [p.name for p in folder.rglob("*.yaml")] == ["bench.yaml"]


def test_experiment_is_not_made_of_itself(folder):
    with pytest.raises(UserError, match="of itself"):
        write_experiment(folder, "bench", ["experiment=bench"], {}, replace=True)
    assert (folder / "experiment" / "bench.yaml").read_text() == BENCH


def test_file_is_whole_or_not_there(folder, monkeypatch):
    def broken(*_, **__):
        raise OSError(28, "no space left on device")

    monkeypatch.setattr(os, "replace", broken)
    monkeypatch.setattr(os, "rename", broken)
    monkeypatch.setattr(Path, "replace", broken)
    with pytest.raises((UserError, OSError)):
        write_experiment(folder, "mine", ["experiment=bench"], {"views": {}})
    assert [p.name for p in (folder / "experiment").iterdir()] == ["bench.yaml"]


def test_places_of_each_kind_of_scan_have_their_own_key():
    for scan, kind, key in (
        (CalibrationScan(), CIRCLE, "dac"),
        (Rectangle(pixels=[3, 3]), CORNER, "corners"),
        (ByDigitizer(), SPOT, "dac"),
    ):
        marks = AimedMarks()
        marks.put("a", (kind, 2), (3, 4))
        marks.put("a", (kind, 1), (1, 2))
        named = {"circles": [1, 2]} if kind == CIRCLE else {}  # so that they are called by these
        wanted_of_a = {key: [[1, 2], [3, 4]], **named}
        assert marks.settings(Experiment(scan=scan)) == {"views": {"a": wanted_of_a}}


@pytest.mark.whole
def test_session_without_views_wants_circles_and_corners_in_every_view_of_the_lab(folder):
    made = composed(["experiment=bench"], str(folder))
    assert isinstance(made.scan, Session)
    assert wanted(made) == {CIRCLE: [1, 2, 3, 4], CORNER: [1, 2, 3, 4]}
    assert view_names(made) == ["1", "2", "3", "4", "5"]
