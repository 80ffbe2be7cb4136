"""What a sweep leaves: one dataset by the swept keys, a table, a ranking; and what it refuses."""

from __future__ import annotations

import csv
from argparse import Namespace

import numpy as np
import pytest
import xarray as xr

from sldvexp import dataset
from sldvexp.sweep import collect
from sldvexp.sweep.lock import locked
from sldvexp.sweep.plan import Plan, folder_name, labels
from sldvexp.sweep.sweep import Sweep, span

METHOD = ("absolute", "relative")
METHODS = ("-m", "experiment=point", "reconstruction=absolute,relative", "seed=1,-1,2")
WHERE = "hydra.sweep.dir=swept"


def opened(folder):
    with xr.open_dataset(folder / "sweep.nc", engine="netcdf4", auto_complex=True) as table:
        return table.load()


@pytest.mark.whole
def test_what_is_collected_of_runs_in_hand_is_what_their_files_have(sldvexp, tmp_path, monkeypatch):
    """A sweep opens no file of a run that it has just made."""
    opened_files, load_some = [], dataset.load_some
    monkeypatch.setattr(
        dataset,
        "load_some",
        lambda path, names: opened_files.append(path) or load_some(path, names),
    )
    runs = ("-m", "experiment=point", "reconstruction=absolute,relative")
    sldvexp(*runs, WHERE)
    assert not opened_files
    first = opened(tmp_path / "swept")
    monkeypatch.setattr(collect, "_known", {})  # as in another process
    sldvexp(*runs, WHERE)
    assert len(opened_files) == 2
    again = opened(tmp_path / "swept")
    assert list(again.variables) == list(first.variables)
    xr.testing.assert_identical(again.drop_attrs(deep=False), first.drop_attrs(deep=False))


@pytest.fixture
def swept(sldvexp, tmp_path):
    done = sldvexp(*METHODS, WHERE)
    return done, tmp_path / "swept"


def test_everything_that_a_sweep_leaves(swept):
    done, folder = swept
    table = opened(folder)
    assert done.status == 1  # seed=-1 failed
    assert table["state"].dims == ("reconstruction", "seed")
    assert table["seed"].values.tolist() == [1, -1, 2]
    assert table["seed"].dtype.kind == "i"
    assert table["reconstruction"].values.tolist() == ["absolute", "relative"]

    # Every cell is its own run's result, with its labels, and NaN where there is none.
    for method in METHOD:
        for seed in (1, 2):
            cell = table.sel(reconstruction=method, seed=seed)
            name = folder_name(["experiment=point", f"reconstruction={method}", f"seed={seed}"])
            with dataset.load(folder / name / "run.nc") as run:
                for variable in ("velocity", "velocity_std"):
                    of_run = run["point"].to_dataset()[variable].load()
                    found = cell[f"point.{variable}"]
                    assert np.array_equal(found.values, of_run.values)
                    assert set(of_run.dims) <= set(found.coords)
                    assert found.attrs["units"] == of_run.attrs["units"]
            assert cell["state"] == "done"
            assert cell["reason"] == ""
    failed = table.sel(seed=-1)
    assert (failed["state"] == "failed").all()
    sentence = "seed must be zero or a positive integer, not -1"
    assert all(sentence in reason for reason in failed["reason"].values)
    assert np.isnan(failed["point.velocity"]).all()

    # The same numbers as a plain table, one row a run.
    rows = list(csv.DictReader((folder / "sweep.csv").open(newline="")))
    assert len(rows) == 6
    for row in rows:
        cell = table.sel(reconstruction=row["reconstruction"], seed=int(row["seed"]))
        assert row["state"] == cell["state"].item()
        std = cell["point.velocity_std"]
        at = {d: std[d].values[0] if d in std.coords else 0 for d in std.dims}
        column = f"point.velocity_std[{', '.join(f'{d}={v}' for d, v in at.items())}]"
        assert float(row[column]) == pytest.approx(std.values.flat[0], rel=1e-12, nan_ok=True)

    # The smallest is the first, what failed the last, with its sentence.
    ranked = [line.split("│")[1:] for line in done.out.splitlines() if line.startswith("│")]
    places = [(cells[1].strip(), cells[2].strip()) for cells in ranked if cells[0].strip()]
    squares = table.sel(seed=1)["point.velocity_std"] ** 2
    better, worse = sorted(METHOD, key=lambda m: float(squares.sel(reconstruction=m).mean()))
    assert places == [(better, "1"), (better, "2"), (worse, "1"), (worse, "2")]
    last = " ".join(cells[-2].strip() for cells in ranked[4:])
    assert last.count(sentence) == 2

    # A line a run, which counts.
    told = [line for line in done.out.splitlines() if line.startswith(tuple("01234"))]
    assert told[0].startswith("1 of 6 done: ")  # how long it took says more about loading
    assert any(" done, 1 failed; about " in line for line in told)
    assert "4 of 6 done, 2 failed: " in told[-1]


@pytest.mark.whole
def test_ranked_by_what_the_user_says(sldvexp, tmp_path):
    done = sldvexp(*METHODS[:3], "sweep.rank=point.sse", WHERE)
    assert done.status == 0
    assert "by point.sse" in done.out
    done = sldvexp(*METHODS[:3], "sweep.rank=point.ssse", WHERE)
    assert done.status == 1
    assert "sweep.rank: no run has point.ssse; did you mean point.sse?" in done.err
    assert "point.velocity_std" in opened(tmp_path / "swept").data_vars


REFUSED = [
    ("seed=1,2 sede=1", "sede is not a known setting; did you mean seed?"),
    ("seed=1,x", "seed must be a whole number, not x"),
    ("reconstruction=absolute,relativ", "did you mean relative?"),
    ("seed=1,2 hydra.sweep.subdir=x", "hydra.sweep.subdir cannot be set"),
]


@pytest.mark.one_in(2)
@pytest.mark.parametrize(("settings", "sentence"), REFUSED)
def test_mistake_in_one_setting_starts_nothing(settings, sentence, sldvexp, tmp_path):
    done = sldvexp("-m", "experiment=point", *settings.split(), WHERE)
    assert done.status == 1
    assert sentence in done.err
    assert len(done.err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_two_sweeps_at_once_in_one_folder(sldvexp, tmp_path):
    with locked(tmp_path / "swept" / ".lock"):
        done = sldvexp(*METHODS, WHERE)
    assert done.status == 1
    assert done.err.startswith("sldvexp: swept: another sweep is at work in this folder; wait")
    assert [p.name for p in (tmp_path / "swept").iterdir()] == [".lock"]


@pytest.mark.parametrize("folder", ["/proc/swept", "file/swept"])
def test_folder_that_cannot_be_written(folder, sldvexp, tmp_path):
    (tmp_path / "file").touch()
    done = sldvexp(*METHODS, f"hydra.sweep.dir={folder}")
    assert done.status == 1
    assert done.err.startswith(f"sldvexp: {folder}: cannot be written: ")
    assert len(done.err.splitlines()) == 1


def test_same_keys_share_a_folder_and_others_do_not():
    def name(*settings):
        return Plan.from_overrides(settings).sweep_name()

    assert name("seed=1,2", "target=circles") == name("target=circles", "seed=3,4,5")
    assert name("seed=1,2", "sweep.retry=all") == name("seed=1,2")
    others = [("seed=1,2",), ("seed=1,2", "target=circles"), ("laser.step=1,2",), ("seed=1",)]
    assert len({name(*settings) for settings in others}) == len(others)


def test_numbers_only_if_all_of_them_are():
    assert labels(["1", "0.5", "1e-3"]) == [1, 0.5, 0.001]
    assert labels(["1", "two"]) == ["1", "two"]
    assert labels(["'a b'"]) == ["a b"]


def test_folders_of_different_runs_differ():
    many = [[f"pose.path='{'x' * 200}{i}'"] for i in range(50)] + [["a=1/2"], ["a=1_2"], ["a=1:2"]]
    names = [folder_name(run) for run in many]
    assert len(set(names)) == len(names)
    assert all("/" not in n and len(n) < 120 for n in names)


def test_time_spans_in_words():
    assert [span(s) for s in (4, 90, 200, 4000, 9000)] == [
        "4 s",
        "90 s",
        "3 min",
        "67 min",
        "2.5 h",
    ]


@pytest.mark.parametrize(
    ("swept", "alike"),
    [
        (("seed=1,2",), True),
        (("+stream.chunks=8,16", "seed=1,2"), False),
        (("experiment=plate,point",), False),
    ],
)
def test_whether_runs_have_the_same_of_a_key(swept, alike):
    """Only then is it known of all of them, by the first, that none streams."""
    options = Namespace(overrides=list(swept), config_dir=None, config_name=None)
    assert Sweep(options).alike("stream", "experiment") is alike
