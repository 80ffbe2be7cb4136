"""A run's file is what xarray writes of the same tree, and all is declared before any value."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from xarray.backends.netCDF4_ import BaseNetCDF4Array, NetCDF4DataStore

from sldvexp.dataset import open_run, save


@pytest.fixture
def tree():
    velocity = np.random.default_rng(3).normal(size=(4, 3, 2)) @ [1, 1j]
    field = xr.Dataset(
        {
            "velocity": (("node", "component"), velocity, {"units": "m/s"}),
            "element": (("triangle", "corner"), np.arange(6).reshape(2, 3)),
            "valid": ("node", np.array([1, 0, 1, 1], np.int8)),
            "none": ("finding", np.zeros(0)),
            "s": 0.25,
        },
        {"component": ["x", "y", "z"]},
        {"residual_std": 0.5},
    )
    return {"field": field, "compare/one": field * 2, "compare/two": field[["s"]], "pose": field}


def test_a_file_is_that_of_xarray(tree, tmp_path):
    save(tree, {"seed": 3}, tmp_path / "run.nc")
    ours = open_run(tmp_path)
    theirs = xr.DataTree.from_dict(
        {"/": xr.Dataset(attrs=ours.attrs), **{f"/{k}": v for k, v in tree.items()}}
    )
    theirs.to_netcdf(tmp_path / "other.nc", engine="netcdf4", auto_complex=True)
    with xr.open_datatree(tmp_path / "other.nc", engine="netcdf4", auto_complex=True) as other:
        assert other.load().identical(ours)


def test_all_is_declared_before_the_first_value(tree, tmp_path, monkeypatch):
    done = []

    def noted(kind, name):
        usual = getattr(kind, name)

        def note(self, *given, **named):
            done.append(name)
            return usual(self, *given, **named)

        monkeypatch.setattr(kind, name, note)

    noted(NetCDF4DataStore, "prepare_variable")
    noted(BaseNetCDF4Array, "__setitem__")
    save(tree, {}, tmp_path / "run.nc")
    declared = done.count("prepare_variable")
    assert declared > 15
    assert done == ["prepare_variable"] * declared + ["__setitem__"] * declared


def test_arrays_of_dask_are_written_too(tree, tmp_path):
    pytest.importorskip("dask")
    save(
        {k: v.chunk(node=2) for k, v in tree.items() if "node" in v.sizes}, {}, tmp_path / "run.nc"
    )
    assert open_run(tmp_path)["field"].to_dataset().identical(tree["field"])
