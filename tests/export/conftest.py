"""Small runs to export: a field in world and in local components, and points."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from sldvexp import dataset
from sldvexp.dataset.run_data import RunData
from sldvexp.pipeline import runner
from tests.composing import config

#: Not evenly spaced, and one with more digits than most formats have.
FREQUENCIES = [195.0, 440.0, 545.012345]

FIELD = [
    "experiment=plate_frf",
    *("scan.pixels=[9,9]", "~scan.views.5"),
    "scan.sampling={samples: 256, rate: 5120.0, frequency: [195.0, 440.0, 545.012345]}",
    "volume={size: [0.2, 0.15], shape: [4, 3], layers: 3, thickness: 0.01}",
    *("reconstruction=samplewise", "~compare.samplewise", "~check.truth", "~check.samplewise"),
    *("~expect.truth", "~expect.resonances", "~expect.all_lines"),
]


@dataclass(frozen=True)
class Made:
    """A run that was done: its groups, the attributes of its file, and the folder of it."""

    tree: dict[str, xr.Dataset]
    attributes: dict
    folder: Path

    @property
    def run(self) -> RunData:
        return RunData(self.tree, self.attributes)


def made(folder: Path, *overrides: str) -> Made:
    runner.run(config(*overrides), str(folder), quiet=True)
    with dataset.load(folder / "run.nc") as tree:
        nodes = {n.path.strip("/"): n.to_dataset(inherit=False).load() for n in tree.subtree}
        return Made(nodes, dict(tree.attrs), folder)


@pytest.fixture(scope="session")
def world(tmp_path_factory) -> Made:
    return made(tmp_path_factory.mktemp("world"), *FIELD)


@pytest.fixture(scope="session")
def local(tmp_path_factory) -> Made:
    """On a curved surface, so that every node has axes of its own, and nodes not seen at all."""
    bent = ["volume.radius=0.3", "volume.coordinates=local"]
    found = made(tmp_path_factory.mktemp("local"), *FIELD, *bent)
    field = found.tree["field"]
    for name in ("velocity", "velocity_std", "confidence"):
        field[name].values[5] = np.nan
        field[name].values[7, 0] = np.nan
    field["observable"].values[5] = 0
    field["observable"].values[7, 0] = 0
    return found


@pytest.fixture(scope="session")
def points(tmp_path_factory) -> Made:
    return made(tmp_path_factory.mktemp("points"), "experiment=point")
