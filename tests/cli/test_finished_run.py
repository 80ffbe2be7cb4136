"""A finished run is lost by no command that is refused or fails, only replaced by a better one."""

from __future__ import annotations

import hashlib
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sldvexp.dataset import open_run
from sldvexp.sweep.lock import alone, locked
from sldvexp.testing import power
from sldvexp.writing import NEW, OUTDATED, READY, making, settle, take_over, whole_or_nothing

POINT = ("experiment=point", "export={mine: {plugin: csv}, other: {plugin: mat}}")
#: Of those, without what the finished run has.
OTHER = ("experiment=point", "seed=1", "overwrite=true")


@pytest.fixture(scope="module")
def made(run_once, tmp_path_factory):
    """A run with a page, exports and a note of its owner's."""
    folder = tmp_path_factory.mktemp("made") / "run"
    shutil.copytree(run_once(*POINT, pages=True), folder)
    (folder / "note.txt").write_text("the left speaker rattles")
    return folder


@pytest.fixture
def finished(made, tmp_path):
    return Path(shutil.copytree(made, tmp_path / "same"))


def contents(folder):
    """Digest of every file but the attempt's own, and whether it is the same file still."""
    return {
        str(file.relative_to(folder)): (
            hashlib.sha256(file.read_bytes()).hexdigest(),
            file.stat().st_ino,
            file.stat().st_mtime_ns,
        )
        for file in folder.rglob("*")
        if file.is_file() and NEW not in file.parts
    }


REFUSED = {
    "no leave to overwrite": ([*POINT], "has a finished run; overwrite=true puts this one in its"),
    "a wrong value": ([*OTHER, "seed=-1"], "seed must be zero"),
    "a wrong type": ([*OTHER, "seed=x"], "must be a whole number"),
    "an unknown setting": ([*OTHER, "reconstruction.nope=1"], "is not a known setting"),
    "an unknown choice": ([*OTHER, "reconstruction=nope"], "there is no reconstruction=nope"),
    "an unknown experiment": (["experiment=nope", "overwrite=true"], "there is no experiment=nope"),
    "half a leave": ([*POINT, "overwrite=maybe"], "overwrite must be true or false"),
    "a setting of Hydra's": ([*OTHER, "hydra.nope=1"], "hydra.nope"),
    "an unknown option": ([*OTHER, "--nope"], "command line: "),
    "another configuration": ([*OTHER, "--config-path=elsewhere"], "--config-path would replace"),
    "a name of no group": ([*OTHER, "+compare.a+={plugin: relative}"], "command line"),
    "a setting that cannot be read": ([*OTHER, "a=[1"], "cannot be read"),
    "a missing value": ([*OTHER, "instrument.path=???"], "instrument.path must be given"),
    "an expectation of nothing": (
        [*OTHER, "expect={x: {at_most: {compare/nope: 1}}}"],
        "compare has no entry nope",
    ),
    "a comparison without a method": ([*OTHER, "+compare.x={rows: all}"], "must say which plugin"),
    "resume": (["resume={run}"], "this run is finished"),
    "resume, overwriting": (["resume={run}", "overwrite=true"], "this run is finished"),
    "rerun with other words": (["rerun", "{run}", "seed=1"], "rerun takes one run.nc"),
    "export in no format": (["export", "{run}"], "export takes a run.nc"),
    "export in an unknown format": (["export", "{run}", "mat", "csw"], "there is no export=csw"),
    "export of what it has not": (["export", "{run}", "csv", "vtu"], "vtu needs a field over"),
    "export with a wrong setting": (["export", "{run}", "uff", "uff.shapes=9"], "uff.shapes"),
    "report of two": (["report", "{run}", "{run}"], "report takes one run.nc"),
    "plot of an unknown figure": (["plot", "{run}", "nope"], "nope"),
    "plot of what it has not": (["plot", "{run}", "images"], "images"),
    "compare with nothing": (["compare", "{run}", "nowhere"], "nowhere"),
    "check of an unknown file": (["check", "{run}/nope.yaml"], "nope.yaml"),
    "a command that does not exist": (["delete", "{run}"], "there is no command delete"),
}


@pytest.mark.whole
@pytest.mark.parametrize("name", REFUSED)
def test_a_refused_command_changes_nothing(sldvexp, finished, tmp_path, name):
    arguments, told = REFUSED[name]
    where = [f"hydra.run.dir={finished}"] if "=" in arguments[0] and "resume" not in name else []
    before, around = contents(finished), set(tmp_path.iterdir())
    done = sldvexp(*where, *(a.replace("{run}", str(finished)) for a in arguments))
    assert done.status == 1
    assert told in done.err
    assert contents(finished) == before
    assert not (finished / NEW).exists()
    assert set(tmp_path.iterdir()) == around


@pytest.mark.whole
def test_another_run_at_work_changes_nothing(sldvexp, finished):
    before = contents(finished)
    with locked(finished / ".lock"):
        done = sldvexp(*OTHER, f"hydra.run.dir={finished}")
    assert "another run is at work in this folder" in done.err
    assert contents(finished) == before


def stumble(*_, **__):
    raise ZeroDivisionError


def no_space(*_, **__):
    raise OSError(28, "No space left on device")


def interrupt(*_, **__):
    signal.raise_signal(signal.SIGTERM)


#: What writes the file of a run.
WRITTEN = "sldvexp.dataset.store._write"
FAILED = {
    "a missing file": (
        ["instrument.path=nope.csv"],
        ["instrument.path=conf://data/point_simulated.csv"],
        None,
        1,
        "nope.csv: there is no such file",
    ),
    "an export that is refused": (
        ["export.x.plugin=vtu"],
        ["export.x.plugin=csv"],
        None,
        1,
        "vtu needs a field over",
    ),
    "a full disk": ([], [], (WRITTEN, no_space), 1, "No space left on device"),
    "a signal": ([], [], ("sldvexp.dataset.save", interrupt), 143, "interrupted"),
}


@pytest.mark.one_in(4)
@pytest.mark.parametrize("name", FAILED)
def test_a_failed_run_leaves_its_sentence_and_what_was_there(
    sldvexp, finished, tmp_path, monkeypatch, name
):
    settings, mended, broken, status, told = FAILED[name]
    before, around = contents(finished), set(tmp_path.iterdir())
    with monkeypatch.context() as patch:
        if broken:
            patch.setattr(*broken)
        done = sldvexp(*OTHER, *settings, f"hydra.run.dir={finished}")
    assert done.status == status
    assert told in done.err
    assert contents(finished) == before
    assert told in (finished / NEW / "sldvexp.log").read_text()
    assert set(tmp_path.iterdir()) == around
    # The attempt can be gone on with, and then nothing is left of it.
    again = sldvexp(f"resume={finished}", *mended)
    assert again.status == 0, again.err
    now = contents(finished)
    assert now["run.nc"] != before["run.nc"]
    assert now["note.txt"] == before["note.txt"]
    assert not (finished / NEW).exists()


def test_a_defect_leaves_what_was_there(sldvexp, finished, monkeypatch):
    before = contents(finished)
    with monkeypatch.context() as patch:
        patch.setattr("sldvexp.dataset.save", stumble)
        with pytest.raises(ZeroDivisionError):
            sldvexp(*OTHER, f"hydra.run.dir={finished}")
    assert contents(finished) == before
    assert "ZeroDivisionError" in (finished / NEW / "sldvexp.log").read_text()
    assert sldvexp(*OTHER, f"hydra.run.dir={finished}").status == 0


def test_a_failed_run_in_a_new_folder_has_its_sentence_in_its_log(sldvexp):
    done = sldvexp(*OTHER, "instrument.path=nope.csv")
    assert sorted(p.name for p in done.folder.iterdir()) == [
        *(".hydra", ".lock", "report.html", "sldvexp.log")
    ]
    assert done.err.removeprefix("sldvexp: ") in (done.folder / "sldvexp.log").read_text() + "\n"


def test_a_rerun_that_fails_leaves_nothing(sldvexp, finished, tmp_path, monkeypatch):
    monkeypatch.setattr("sldvexp.dataset.save", no_space)
    done = sldvexp("rerun", str(finished))
    assert (done.status, done.err) == (1, "sldvexp: rerun: No space left on device\n")
    assert not list((tmp_path / "outputs").glob("*/*"))


def test_a_better_run_replaces_all_that_the_old_one_left(sldvexp, finished, pages):
    before = contents(finished)
    done = sldvexp(*OTHER, POINT[1], f"hydra.run.dir={finished}")
    assert done.status == 0, done.err
    now = contents(finished)
    assert now.keys() == before.keys()
    hydra = {f".hydra/{name}.yaml" for name in ("config", "hydra", "overrides")}
    replaced = {"run.nc", "report.html", "mine.csv", "other.mat", "sldvexp.log", *hydra}
    assert {name for name in now if now[name] != before[name]} == replaced
    assert "seed=1" in (finished / ".hydra/overrides.yaml").read_text()
    assert f"files: {os.path.relpath(finished / 'run.nc')}, mine.csv, other.mat" in done.out


@pytest.mark.parametrize("after", range(8))
def test_a_run_that_is_killed_while_it_is_put_in_place_is_put_there_by_the_next(
    tmp_path, monkeypatch, after
):
    """Wherever it stops, all is as it was or will be as it should."""
    old = {"run.nc": "old", "pose.txt": "old", "note": "old", "fields/1": "old", "fields/2": "old"}
    new = {"run.nc": "new", "page": "new", "fields/1": "new"}
    for where, those in ((tmp_path, old), (tmp_path / NEW, new)):
        for name, text in those.items():
            (where / name).parent.mkdir(parents=True, exist_ok=True)
            (where / name).write_text(text)

    class Killed(BaseException):
        pass

    calls = []

    def counted(function):
        def call(*arguments, **options):
            if len(calls) == after:
                raise Killed
            calls.append(function)
            return function(*arguments, **options)

        return call

    with monkeypatch.context() as patch:
        for module, name in ((os, "rename"), (os, "replace"), (shutil, "rmtree"), (Path, "unlink")):
            patch.setattr(module, name, counted(getattr(module, name)))
        try:
            take_over(tmp_path, ["pose.txt"])
        except Killed:
            decided = (tmp_path / READY).is_dir()
        else:
            decided = True
    settle(tmp_path)
    found = {
        str(p.relative_to(tmp_path)): p.read_text()
        for p in tmp_path.rglob("*")
        if p.is_file() and NEW not in p.parts
    }
    assert found == ({**new, "note": "old", "fields/2": "old"} if decided else old)
    assert decided == (after > 0)
    assert not (tmp_path / READY).exists()
    assert not (tmp_path / OUTDATED).exists()


def test_nothing_outside_a_folder_is_touched_when_results_are_put_there(tmp_path):
    """A stranger's folder may have links, and a list of what goes."""
    run, outside = tmp_path / "run", tmp_path / "outside"
    for folder in (run, outside):
        folder.mkdir()
    for name in ("page", "fields", "note"):
        (outside / name).write_text("mine")
    (run / "page").symlink_to(outside / "page")
    (run / "fields").symlink_to(outside)
    with making(run) as new:
        (new / "fields").mkdir()
        for name in ("page", "fields/note"):
            (new / name).write_text("new")
        take_over(run, ["../outside/note", str(outside / "note")])
    assert {p.read_text() for p in outside.iterdir()} == {"mine"}
    assert (run / "page").read_text() == (run / "fields/note").read_text() == "new"
    for name in (NEW, READY):
        (run / name).symlink_to(outside)
    with alone(run):
        assert not (run / NEW).exists()
    assert {p.name for p in outside.iterdir()} == {"page", "fields", "note"}


def test_a_folder_where_a_file_is_to_come_is_told_before_anything_moves(tmp_path):
    (tmp_path / "run.nc").mkdir()
    (tmp_path / "page").write_text("old")
    with making(tmp_path) as new:
        for name in ("run.nc", "page"):
            (new / name).write_text("new")
        with pytest.raises(Exception, match=r"run\.nc: cannot be written: it is a folder"):
            take_over(tmp_path)
    assert (tmp_path / "page").read_text() == "old"


def test_leftovers_of_killed_runs_are_swept_up_by_the_next(sldvexp, finished):
    """What other processes are at work with stays."""
    killed = subprocess.Popen([sys.executable, "-c", ""])
    killed.wait()
    with whole_or_nothing(finished / "run.nc") as beside:
        name = beside.name.replace(f"-{os.getpid()}-", "-{}-")
    dead = name.format(killed.pid)
    left = [finished / dead, finished / "journal/front" / dead]
    left.append(finished.with_name("other") / dead)
    used, mine = finished / name.format(os.getppid()), finished / ".run.123-4.nc"
    locked_one, apart = (finished.parent / n / dead for n in ("at work", "a/far"))
    for path in (*left, used, mine, locked_one, apart):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("half")
    blocks = finished / dead.replace(".run.", ".blocks.").removesuffix(".nc")
    (blocks / "field0").mkdir(parents=True)
    (finished / NEW / ".hydra").mkdir(parents=True)
    with locked(locked_one.with_name(".lock")):
        assert sldvexp(*OTHER, f"hydra.run.dir={finished}").status == 0
    assert not any(path.exists() for path in (*left, blocks, finished / NEW))
    assert used.exists()
    assert mine.exists()  # no name of the program's
    assert locked_one.exists()
    assert apart.exists()  # neither in the folder nor in one beside it


RECORDED = (
    "import sys; from pathlib import Path; from sldvexp.cli import main; "
    "from sldvexp.testing import power; folder, record, cut, *words = sys.argv[1:]; "
    "power.recorded(main.main, words, Path(folder), Path(record), int(cut))"
)
#: Power cuts, and how many of them are not left to the long tests.
CUTS, QUICK = 10, 1
#: No command syncs so often.
NEVER = 10**6


def record_syncs(folder, record, cut):
    """Let a better run replace a finished one; None if its power was cut."""
    words = [*OTHER, POINT[1], f"hydra.run.dir={folder}"]
    code = [sys.executable, "-c", RECORDED, folder, record, cut, *words]
    done = subprocess.run([*map(str, code)], capture_output=True, text=True)
    assert done.returncode in (0, -signal.SIGKILL), done.stderr
    return power.count_syncs(record) if done.returncode == 0 else None


@pytest.fixture(scope="module")
def better(made, tmp_path_factory):
    """What replaces the finished run if nobody cuts the power, and how often it syncs."""
    folder = tmp_path_factory.mktemp("better")
    shutil.copytree(made, folder / "same")
    syncs = record_syncs(folder / "same", folder / "record", NEVER)
    return variables(folder / "same"), syncs


def variables(folder):
    tree = open_run(folder)
    return {
        f"{node.path}/{name}": values.to_numpy().tobytes()
        for node in tree.subtree
        for name, values in node.data_vars.items()
    }


part = np.random.default_rng(31).uniform(size=CUTS)


@pytest.mark.whole
@pytest.mark.parametrize(
    ("part", "names"),
    [
        pytest.param(p, names, marks=[pytest.mark.long] * (k >= QUICK), id=f"{k + 1}-{names.name}")
        for k, p in enumerate(part)
        for names in power.Names
    ],
)
def test_a_power_cut_leaves_the_old_run_or_the_new_one(made, finished, better, part, names):
    new, syncs = better
    old = contents(finished)
    record = finished.with_name("record")
    assert record_syncs(finished, record, int(part * syncs)) is None
    power.cut_power(finished, record, names)
    settle(finished)
    now = contents(finished)
    assert now["note.txt"][0] == old["note.txt"][0]
    if now["run.nc"][0] == old["run.nc"][0]:
        assert {name: now[name][0] for name in old} == {name: old[name][0] for name in old}
    else:
        assert variables(finished) == new
    again = [sys.executable, "-m", "sldvexp.cli.main", *OTHER, POINT[1]]
    subprocess.run([*again, f"hydra.run.dir={finished}"], check=True, capture_output=True)
    assert variables(finished) == new
