"""Any runs side by side, by what sets their configurations apart."""

from __future__ import annotations

import pytest
import xarray as xr

from sldvexp import dataset


def compared(done):
    path = next(line for line in done.out.splitlines() if line.endswith("sweep.nc"))
    with xr.open_dataset(path, engine="netcdf4", auto_complex=True) as table:
        return table.load()


@pytest.mark.whole
def test_runs_are_told_apart_by_their_settings(sldvexp):
    runs = {
        method: sldvexp("experiment=point", f"reconstruction={method}").folder
        for method in ("absolute", "combined")
    }
    done = sldvexp("compare", *map(str, runs.values()), "sweep.rank=point.sse")
    assert done.status == 0, done.err
    assert "by point.sse" in done.out
    table = compared(done)
    assert table["state"].dims == ("reconstruction",)
    for method, folder in runs.items():
        with dataset.load(folder / "run.nc") as run:
            expected = run["point/velocity"].values
        assert (table["point.velocity"].sel(reconstruction=method).values == expected).all()
    assert (table["seconds"] > 0).all()


def test_runs_of_a_sweep_and_others(sldvexp):
    sldvexp("-m", "experiment=point", "seed=1,2", "hydra.sweep.dir=swept")
    other = sldvexp("experiment=point", "seed=5").folder
    done = sldvexp("compare", "swept", str(other / "run.nc"))
    assert sorted(compared(done)["seed"].values.tolist()) == [1, 2, 5]


@pytest.mark.whole
def test_same_run_twice_is_told_apart_by_nothing(sldvexp):
    folders = [str(sldvexp("experiment=point").folder) for _ in range(2)]
    assert compared(sldvexp("compare", *folders))["state"].dims == ("run",)


@pytest.mark.whole
def test_failed_runs_are_left_out(sldvexp):
    good = [sldvexp("experiment=point", f"seed={seed}").folder for seed in (1, 2)]
    failed = sldvexp("experiment=point", "reconstruction.rows=nonsense")
    assert failed.status == 1
    assert (failed.folder / ".hydra").is_dir()
    done = sldvexp("compare", *map(str, good), str(failed.folder))
    assert f"{failed.folder}: left out" in done.out
    assert compared(done)["seed"].values.tolist() == [1, 2]


@pytest.mark.parametrize("words", [[], ["nowhere"], ["."]])
def test_folder_without_a_run(words, sldvexp):
    done = sldvexp("compare", *words)
    assert done.status == 1
    assert len(done.err.splitlines()) == 1
