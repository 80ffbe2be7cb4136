"""A run's file is what xarray writes of the same groups, declared at once."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from xarray.backends.netCDF4_ import BaseNetCDF4Array, NetCDF4DataStore

from sldvexp import dataset
from sldvexp.dataset import store

#: Names of what declares a variable and of what writes its values.
DECLARE, WRITE = "prepare_variable", "__setitem__"


def as_xarray_writes(
    tree: dict[str, xr.Dataset], attributes: dict[str, object], path: Path
) -> None:
    root = xr.Dataset(attrs={**store.CONVENTIONS, **attributes})
    whole = xr.DataTree.from_dict({"/": root, **{f"/{k}": v for k, v in tree.items()}})
    whole.to_netcdf(path, engine="netcdf4", auto_complex=True)


def tree_of_all_kinds() -> dict[str, xr.Dataset]:
    """Return groups within groups with every kind of value that a run has."""
    rng = np.random.default_rng(1)
    values = rng.normal(size=(5, 3))
    values[2, 1] = np.nan
    image = xr.Dataset(
        {
            "velocity": (("pixel", "frequency"), values + 1j * values[::-1], {"units": "m/s"}),
            "std": (("pixel", "frequency"), values),
            "flags": ("pixel", np.arange(5)),
            "passed": ("pixel", values[:, 0] > 0),
            "small": ("pixel", np.arange(5, dtype=np.int8)),
            "text": ("pixel", ["a", "", "longer", "µ", "e"]),
            "empty": ("none", np.zeros(0)),
            "number": 2.5,
            "sentence": "one",
        },
        coords={"frequency": ("frequency", [1.0, 2.0, 3.0], {"units": "Hz"})},
        attrs={"list": [1, 2], "text": "t", "number": np.float64(0.1)},
    )
    return {"image/front": image, "pose": image[["std"]], "image/front/more": image[["text"]]}


@pytest.mark.parametrize("at_once", [0, store.WAITING_BYTES])
def test_a_file_is_what_xarray_writes(
    tmp_path: Path, at_once: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whether values wait or not."""
    monkeypatch.setattr(store, "WAITING_BYTES", at_once)
    tree, attributes = tree_of_all_kinds(), {"seed": 1, "title": "a run"}
    dataset.save(tree, attributes, tmp_path / "run.nc")
    as_xarray_writes(tree, attributes, tmp_path / "other.nc")
    for decoded in (True, False):
        with (
            xr.open_datatree(tmp_path / "run.nc", auto_complex=True, decode_cf=decoded) as found,
            xr.open_datatree(tmp_path / "other.nc", auto_complex=True, decode_cf=decoded) as other,
        ):
            xr.testing.assert_identical(found.load(), other.load())
            for node, same in zip(found.subtree, other.subtree, strict=True):
                of_both = [{k: v.dtype for k, v in n.variables.items()} for n in (node, same)]
                assert of_both[0] == of_both[1]


@pytest.fixture
def done(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Give what is done to a file, one after the other."""
    order: list[str] = []

    def noted(kind: type, name: str) -> None:
        usual = getattr(kind, name)

        def note(self: Any, *given: Any, **named: Any) -> Any:
            order.append(name)
            return usual(self, *given, **named)

        monkeypatch.setattr(kind, name, note)

    noted(NetCDF4DataStore, DECLARE)
    noted(BaseNetCDF4Array, WRITE)
    return order


def test_all_is_declared_before_the_first_value(tmp_path: Path, done: list[str]) -> None:
    dataset.save(tree_of_all_kinds(), {}, tmp_path / "run.nc")
    declared = done.count(DECLARE)
    assert declared > 10
    assert done == [DECLARE] * declared + [WRITE] * declared


def test_of_much_each_value_is_written_once_and_does_not_wait(
    tmp_path: Path, done: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "WAITING_BYTES", 100)
    dataset.save(tree_of_all_kinds(), {}, tmp_path / "run.nc")
    assert done.count(WRITE) == done.count(DECLARE)
    assert done.index(WRITE) < 5


def test_arrays_of_dask_are_written_too(tmp_path: Path) -> None:
    pytest.importorskip("dask")
    tree = {"image/1": tree_of_all_kinds()["image/front"][["velocity", "std"]]}
    chunked = {name: group.chunk(pixel=2) for name, group in tree.items()}
    dataset.save(chunked, {}, tmp_path / "run.nc")
    assert dataset.open_run(tmp_path)["image/1"].to_dataset().identical(tree["image/1"])
