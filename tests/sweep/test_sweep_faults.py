"""What goes wrong around a sweep: one sentence each, and nothing that was done is lost."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.sweep import collect, record
from sldvexp.sweep.lock import locked
from sldvexp.sweep.plan import OWNER, Plan
from sldvexp.sweep.record import State

SWEEP = ("-m", "~experiment", "target=dissertation", "report=none")


@pytest.fixture
def disk(tmp_path):
    """A file system of its own, whose size and kind can be changed."""
    place = tmp_path / "disk"
    place.mkdir()

    def mount(options):
        call = ["mount", "-t", "tmpfs", "-o", options, "none", str(place)]
        return subprocess.run(call, capture_output=True).returncode == 0

    if sys.platform != "linux" or not mount("size=10m"):
        pytest.skip("needs the right to mount a file system")
    yield SimpleNamespace(folder=place / "swept", again=lambda o: mount(f"remount,{o}"))
    subprocess.run(["umount", "-l", str(place)], check=True)


def runs(folder):
    """Runs that are done, with the bytes and times of their files."""
    return {
        path.parent.name: (path.read_bytes(), path.stat().st_mtime_ns, record.read(path.parent))
        for path in folder.glob("*/run.nc")
        if record.read(path.parent).state is State.done
    }


def fill(path):
    """Leave no byte free on the disk."""
    with path.open("wb", buffering=0) as file, suppress(OSError):
        while file.write(bytes(4096)):
            pass


def sentences(done):
    """What was said, all of which are sentences to a user."""
    lines = done.err.splitlines()
    assert all(line.startswith("sldvexp: ") for line in lines), done.err
    return lines


@pytest.mark.whole
@pytest.mark.parametrize("left", [0, 4096, 20000], ids="{} bytes left".format)
def test_sweep_that_begins_on_a_full_disk(sldvexp, disk, left):
    space = disk.folder.parent / "space"
    fill(space)
    os.truncate(space, space.stat().st_size - left)
    done = sldvexp(*SWEEP, "seed=1,2", f"hydra.sweep.dir={disk.folder}")
    assert done.status == 1
    said = sentences(done)
    assert said
    assert all("No space left on device" in line for line in said), said
    assert not any("[Errno" in line or "command line" in line for line in said), said
    space.unlink()
    assert sldvexp(*SWEEP, "seed=1,2", f"hydra.sweep.dir={disk.folder}").status == 0


@pytest.mark.whole
def test_disk_that_is_full(sldvexp, disk):
    where = f"hydra.sweep.dir={disk.folder}"
    assert sldvexp(*SWEEP, "seed=1,2", where).status == 0
    kept = runs(disk.folder)
    space = disk.folder.parent / "space"
    fill(space)
    done = sldvexp(*SWEEP, "seed=1,2,3,4", where)
    assert done.status == 1
    said = sentences(done)
    assert said
    assert all("No space left on device" in line for line in said), said
    assert runs(disk.folder) == kept
    with dataset.load(next(disk.folder.glob("*seed=1*/run.nc"))) as tree:
        assert "target" in tree.children
    space.unlink()
    done = sldvexp(*SWEEP, "seed=1,2,3,4", where)
    assert done.status == 0, done.err
    now = runs(disk.folder)
    assert len(now) == 4
    assert kept.items() <= now.items()
    assert not [p for p in disk.folder.rglob(".*") if p.suffix == ".nc"]


@pytest.mark.parametrize("size", [0, 2**17, 2**19, 2**24])
def test_disk_that_becomes_full_while_a_file_is_written(size, disk):
    """What HDF5 says of it depends on how far it came; what is told does not."""
    path = disk.folder.parent / "run.nc"
    dataset.save({"g": xr.Dataset({"a": ("n", np.arange(4.0))})}, {}, path)
    kept = path.read_bytes()
    fill(disk.folder.parent / "space")
    assert disk.again(f"size={10 * 2**20 + size // 2}")
    with pytest.raises(UserError) as told:
        dataset.save({"g": xr.Dataset({"a": ("n", np.ones(1 + size // 8))})}, {}, path)
    assert str(told.value) == f"{path}: cannot be written: No space left on device"
    assert path.read_bytes() == kept
    assert sorted(p.name for p in path.parent.iterdir()) == ["run.nc", "space"]


@pytest.mark.whole
def test_disk_that_becomes_read_only(sldvexp, disk):
    where = f"hydra.sweep.dir={disk.folder}"
    assert sldvexp(*SWEEP, "seed=1,2", where).status == 0
    kept = runs(disk.folder)
    assert disk.again("ro")
    done = sldvexp(*SWEEP, "seed=1,2,3", where)
    assert done.status == 1
    assert len(sentences(done)) == 1
    assert "cannot be written: Read-only file system" in done.err
    assert runs(disk.folder) == kept
    assert disk.again("rw")
    assert sldvexp(*SWEEP, "seed=1,2,3", where).status == 0
    assert kept.items() <= runs(disk.folder).items()


@pytest.mark.whole
def test_folder_of_one_run_that_cannot_be_written(sldvexp, tmp_path):
    """Others are done all the same, and their results are there at the end."""
    sldvexp(*SWEEP, "seed=1,2", "hydra.sweep.dir=swept")
    run = next((tmp_path / "swept").glob("*seed=2*"))
    (run / "run.nc").unlink()
    (run / "run.nc").mkdir()
    done = sldvexp(*SWEEP, "seed=1,2,3", "hydra.sweep.dir=swept")
    assert done.status == 1
    (said,) = sentences(done)
    assert "run.nc: cannot be written" in said
    states = {p.parent.name: record.read(p.parent).state for p in run.parent.glob("*/record.json")}
    assert sorted(states.values()) == [State.done, State.done, State.failed]


class Backwards(datetime):
    """A calendar's clock that is set back by an hour whenever it is read."""

    read = 0

    @classmethod
    def now(cls, tz=None):
        cls.read += 1
        return datetime(2026, 3, 4, 12, tzinfo=UTC) - timedelta(hours=cls.read)


@pytest.mark.whole
def test_clock_that_is_set_back(sldvexp, tmp_path, monkeypatch):
    """Nothing is computed again, and no time is less than nothing."""
    for module in ("sldvexp.pipeline.runner", "sldvexp.pipeline.provenance"):
        monkeypatch.setattr(f"{module}.datetime", Backwards)
    assert sldvexp(*SWEEP, "seed=1,2", "hydra.sweep.dir=swept").status == 0
    folder = tmp_path / "swept"
    kept = runs(folder)
    assert Backwards.read >= 4
    assert all(found.seconds >= 0 for _, _, found in kept.values())
    assert sldvexp(*SWEEP, "seed=1,2", "hydra.sweep.dir=swept").status == 0
    assert runs(folder) == kept
    (run, *_) = folder.glob("*/run.nc")
    (run.parent / record.FILE).unlink()  # as a run of its own leaves it
    table = collect.collect(["seed"], [("1",)], [run.parent])
    assert table["state"].item() == "done"
    assert not table["seconds"].item() < 0


def test_folder_that_belongs_to_another_sweep(tmp_path):
    def claim(*settings, others=()):
        Plan.from_overrides(settings).claim(tmp_path, *others)

    ours = ("experiment=point", "reconstruction=absolute,relative")
    claim(*ours)
    kept = (tmp_path / OWNER).read_bytes()
    claim("experiment=point", "reconstruction=absolute,combined", "sweep.retry=all")
    with pytest.raises(UserError) as refused:
        claim("experiment=pose", "seed=1,2")
    assert str(refused.value) == (
        f"{tmp_path}: belongs to another sweep, over reconstruction with experiment=point; "
        "choose another folder with hydra.sweep.dir=..."
    )
    with pytest.raises(UserError, match="belongs to another sweep"):
        claim(*ours, others=("/my/conf", ""))
    assert (tmp_path / OWNER).read_bytes() == kept
    (tmp_path / OWNER).write_bytes(kept[:9])
    claim("experiment=pose", "seed=1,2")


@pytest.mark.whole
def test_command_leaves_the_folder_of_another_sweep_alone(sldvexp, tmp_path):
    assert sldvexp(*SWEEP, "seed=1,2", "hydra.sweep.dir=swept").status == 0
    before = {p: p.stat().st_mtime_ns for p in (tmp_path / "swept").rglob("*")}
    done = sldvexp(*SWEEP, "laser.mirror_offset=0,0.01", "hydra.sweep.dir=swept")
    assert done.status == 1
    (said,) = sentences(done)
    assert "belongs to another sweep, over seed" in said
    assert {p: p.stat().st_mtime_ns for p in (tmp_path / "swept").rglob("*")} == before


def test_two_sweeps_at_once(sldvexp, tmp_path):
    """The second is refused, and loses nothing of the first's."""
    assert sldvexp(*SWEEP, "seed=1,2", "hydra.sweep.dir=swept").status == 0
    kept = runs(tmp_path / "swept")
    with locked(tmp_path / "swept" / ".lock"):
        done = sldvexp(*SWEEP, "seed=1,2,3", "sweep.retry=all", "hydra.sweep.dir=swept")
    assert done.status == 1
    (said,) = sentences(done)
    assert "another sweep is at work in this folder" in said
    assert runs(tmp_path / "swept") == kept
    assert len(kept) == 2


@pytest.mark.whole
def test_misspelt_key_leaves_a_sweep_as_it_was(sldvexp, tmp_path):
    assert sldvexp(*SWEEP, "seed=1,2", "hydra.sweep.dir=swept").status == 0
    before = {p: p.stat().st_mtime_ns for p in (tmp_path / "swept").glob("*/*")}
    done = sldvexp(*SWEEP, "sede=1,2", "hydra.sweep.dir=swept")
    assert done.status == 1
    (said,) = sentences(done)
    assert "sede is not a known setting; did you mean seed?" in said
    after = {p: p.stat().st_mtime_ns for p in (tmp_path / "swept").glob("*/*")}
    assert after == before
