"""A file holds complex numbers of both precisions as they were."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from sldvexp import dataset


@pytest.mark.parametrize("order", [("single", "double"), ("double", "single")])
def test_both_precisions_in_one_file(tmp_path: Path, order: tuple[str, str]) -> None:
    rng = np.random.default_rng(3)
    values = rng.normal(size=(2000, 2)) @ [1, 1j]
    kinds = {"single": values.astype(np.complex64), "double": values}
    tree = {name: xr.Dataset({"velocity": ("pixel", kinds[name])}) for name in order}
    dataset.save(tree, {}, tmp_path / "run.nc")
    with dataset.load(tmp_path / "run.nc") as found:
        for name, kind in kinds.items():
            np.testing.assert_array_equal(found[f"{name}/velocity"].values, kind)
