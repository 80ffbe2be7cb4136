"""Runs in several processes: their states come from their records."""

from __future__ import annotations

import pytest
import xarray as xr

from sldvexp.sweep import record

pytest.importorskip("hydra_plugins.hydra_joblib_launcher")

TWO = ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2", "hydra.sweep.dir=swept")


@pytest.mark.whole
def test_runs_of_other_processes_are_done_and_collected(sldvexp, tmp_path):
    done = sldvexp("-m", "experiment=point", "seed=1,2", "report=none", *TWO)
    assert done.status == 0, done.err
    assert len(list((tmp_path / "swept").glob("*/run.nc"))) == 2
    with xr.open_dataset(tmp_path / "swept/sweep.nc", engine="netcdf4") as table:
        assert table["state"].values.tolist() == ["done"] * 2


@pytest.mark.long
def test_runs_of_other_processes(sldvexp, tmp_path):
    call = ("-m", "experiment=point", "seed=1,2,-1", "reconstruction=absolute,relative", *TWO)
    assert sldvexp(*call).status == 1  # seed=-1
    with xr.open_dataset(tmp_path / "swept/sweep.nc", engine="netcdf4") as table:
        assert table["state"].sel(seed=-1).values.tolist() == ["failed"] * 2
        assert (table["state"].sel(seed=[1, 2]) == "done").all()
        reasons = table["reason"].sel(seed=-1).values
    assert all("seed must be zero or a positive integer" in reason for reason in reasons)
    runs = list((tmp_path / "swept").glob("*/run.nc"))
    before = {run: (run.stat().st_mtime_ns, record.read(run.parent)) for run in runs}
    assert len(runs) == 4
    assert sldvexp(*call, "sweep.retry=missing").status == 1
    assert {r: (r.stat().st_mtime_ns, record.read(r.parent)) for r in runs} == before
    done = sldvexp("-m", "experiment=point", "seed=1,2", call[3], *TWO)
    assert done.status == 0, done.err
