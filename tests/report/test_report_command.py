"""Runs and sweeps leave a page, which can be made anew, and which never costs a result."""

from __future__ import annotations

import csv
import json
import os
import re
from pathlib import Path
from urllib.parse import quote, unquote

import netCDF4
import pytest

POINT = "experiment=point"
SWEEP = ("-m", POINT, "reconstruction=absolute,relative", "hydra.sweep.dir=sweep")


@pytest.mark.one_in(2)
@pytest.mark.parametrize("given", ["", "run.nc"])
def test_run_leaves_a_page_that_can_be_made_anew(sldvexp, pages, given):
    done = sldvexp(POINT)
    page = done.folder / "report.html"
    assert done.status == 0
    assert done.out.splitlines()[-1].endswith("report.html")
    first = page.read_bytes()
    page.unlink()
    again = sldvexp("report", str(done.folder / given))
    assert (again.status, again.err, again.out) == (0, "", f"{page}\n")
    assert page.read_bytes() == first
    assert first.count(b"<section") == 6
    assert first.index(b'class="verdict') < first.index(b"mm/s") < first.index(b"data:image/svg")
    assert b"data:image/svg+xml" in first
    text = first.decode()
    order = [text.index(f"{t}</h2>") for t in ("Result", "What to mind", "Velocity", "Checks")]
    assert order == sorted(order)
    assert text.rpartition("<pre")[2].partition(">")[2].startswith("sldvexp rerun run.nc</pre>")


@pytest.mark.parametrize("off", ["~report", "report=none"])
def test_page_can_be_left_out_and_a_stale_one_goes(sldvexp, pages, tmp_path, off):
    where = "hydra.run.dir=here"
    stale = tmp_path / "here/report.html"
    stale.parent.mkdir()
    stale.write_text("of another run")
    done = sldvexp(POINT, off, where)
    assert (done.status, done.err) == (0, "")
    assert (tmp_path / "here/run.nc").is_file()
    assert not stale.exists()


def test_failing_page_does_not_lose_the_run(sldvexp, pages, monkeypatch):
    def fail(*_):
        raise MemoryError("no room")

    monkeypatch.setattr("sldvexp.report.html.run_page.write_of", fail)
    done = sldvexp(POINT)
    assert done.status == 0
    assert done.err.startswith("sldvexp: report: was not made (MemoryError: no room); the results")
    assert done.err.count("\n") == 1
    assert "point" in done.tree
    assert not (done.folder / "report.html").exists()


@pytest.mark.whole
def test_sweep_leaves_one_page_and_its_runs_none(sldvexp, pages, tmp_path):
    done = sldvexp(*SWEEP)
    page = tmp_path / "sweep/report.html"
    assert done.out.splitlines()[-1] == "sweep/report.html"
    assert [p.name for p in tmp_path.rglob("report.html")] == ["report.html"]
    first = page.read_bytes()
    assert b"Runs by point.velocity_std, the smallest first" in first
    command = f"sldvexp {' '.join(SWEEP)}"
    assert first.decode().rpartition("<pre")[2].partition(">")[2].startswith(f"{command}</pre>")
    links = re.findall(r'<a href="(\./[^"]*)">(.*?)</a>', first.decode())
    assert [text for _, text in links] == ["folder", "folder"]
    runs = {page.parent / unquote(address) for address, _ in links}
    assert runs == {found.parent for found in page.parent.rglob("run.nc")}
    with (page.parent / "sweep.csv").open() as file:
        assert {page.parent / row["folder"] for row in csv.DictReader(file)} == runs
    page.unlink()
    assert sldvexp("report", str(tmp_path / "sweep")).status == 0
    assert page.read_bytes() == first
    one = runs.pop()
    (one / "report.html").write_text("")
    sldvexp("report", str(tmp_path / "sweep"))
    found = re.findall(r'<a href="(\./[^"]*)">page</a>', page.read_text())
    assert [page.parent / unquote(address) for address in found] == [one / "report.html"]


@pytest.mark.long
def test_each_run_of_a_sweep_may_have_a_page(sldvexp, pages, no_figures, tmp_path):
    sldvexp(*SWEEP, "report.each_run=true")
    assert len(list(tmp_path.rglob("report.html"))) == 3


@pytest.mark.whole
def test_runs_that_are_done_get_the_pages_that_they_lack(sldvexp, pages, no_figures, tmp_path):
    sldvexp(*SWEEP)
    done = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("run.nc")}
    assert len(done) == 2
    sldvexp(*SWEEP, "report.each_run=true")
    made = {path: path.stat().st_mtime_ns for path in tmp_path.glob("sweep/*/report.html")}
    assert {path.parent for path in made} == {path.parent for path in done}
    assert b">page</a>" in (tmp_path / "sweep/report.html").read_bytes()
    next(iter(made)).unlink()
    sldvexp(*SWEEP, "report.each_run=true")
    again = {path: path.stat().st_mtime_ns for path in tmp_path.glob("sweep/*/report.html")}
    assert set(again) == set(made)
    assert sum(again[path] == made[path] for path in made) == 1  # what is there stays
    assert done == {path: path.stat().st_mtime_ns for path in done}  # and no run is done again


@pytest.mark.whole
def test_failed_runs_come_first_in_a_sweeps_page(sldvexp, pages, no_figures, tmp_path):
    sldvexp("-m", POINT, "reconstruction.rows='1,2,3','1,2,<b>'", "hydra.sweep.dir=sweep")
    text = (tmp_path / "sweep/report.html").read_text()
    warned = text.partition("<h2>What to mind</h2>")[2].partition("</section>")[0]
    assert text.index("Of 2 runs: 1 done, 1 failed.") < text.index("What to mind</h2>")
    states = text.partition("<h2>States</h2>")[2].partition("</section>")[0]
    assert "<dt>failed</dt><dd>not done; " in states
    assert "<dt>done</dt><dd>finished, " in states
    assert "failed: " in warned
    assert "1,2,&lt;b&gt;" in warned
    assert "<b>" not in text


@pytest.mark.whole
def test_compared_runs_have_a_page_that_names_them(sldvexp, pages, no_figures, tmp_path):
    folders = [str(sldvexp(POINT, f"seed={seed}").folder) for seed in (1, 2)]
    done = sldvexp("compare", *folders)
    [page] = (tmp_path / "outputs").rglob("report.html")
    assert f"sldvexp compare {' '.join(folders)}" in page.read_text()
    for folder in folders:
        away = quote(Path(os.path.relpath(folder, page.parent)).as_posix())
        assert f'href="./{away}/report.html"' in page.read_text()
    assert done.out.rstrip().endswith("report.html")


@pytest.mark.long
def test_page_of_the_default_run_is_small(sldvexp, pages):
    done = sldvexp()
    page = (done.folder / "report.html").read_text()
    assert len(page.encode()) <= 8e6
    assert "could not be drawn" not in page
    assert page.count("<figure") == 9
    assert "All 4 expectations are met" in page


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        ((), "command line: report takes one run.nc, or the folder of a run or of a sweep"),
        (("a", "b"), "command line: report takes one run.nc"),
        (("nowhere",), "nowhere: no such file; give a run.nc"),
        ((".",), ".: neither run.nc nor sweep.nc is there; give a run.nc"),
    ],
)
def test_misuse_gets_one_sentence(sldvexp, words, answer):
    done = sldvexp("report", *words)
    assert (done.status, done.out) == (1, "")
    assert done.err.startswith(f"sldvexp: {answer}")
    assert done.err.count("\n") == 1


def test_damaged_files_get_one_sentence(sldvexp, pages, no_figures, tmp_path):
    for name in ("run.nc", "sweep.nc"):
        folder = tmp_path / name.partition(".")[0]
        folder.mkdir()
        (folder / name).write_bytes(b"nothing of the kind")
        done = sldvexp("report", str(folder))
        assert (done.status, done.err.count("\n")) == (1, 1)
        assert done.err.startswith(f"sldvexp: {folder / name}: is not a")
    done = sldvexp(POINT)
    with netCDF4.Dataset(done.folder / "run.nc", "a") as file:
        file.plugins = json.dumps(["laser"])
    again = sldvexp("report", str(done.folder))
    assert again.err.endswith("plugins: must be a table\n")
