"""A small session in the virtual lab, run once, and its figures, each drawn once."""

from __future__ import annotations

from pathlib import Path

import pytest
import xarray as xr
from matplotlib.figure import Figure

from sldvexp import dataset
from sldvexp.plot import figures_of

SMALL = [
    "report=none",
    "pose=bitangent",
    *(f"~scan.{part}.views.{view}" for part in ("calibration", "structure") for view in "45"),
    *(f"scan.{part}.sampling.samples=256" for part in ("calibration", "structure")),
    "scan.calibration.fine.lines=16",
    "scan.structure.pixels=[9,11]",
    "volume.shape=[7,6]",
    "volume.layers=3",
]


@pytest.fixture(scope="session")
def run_file(run_once) -> Path:
    """run.nc of a small session, with its journal beside it."""
    return run_once(*SMALL) / "run.nc"


@pytest.fixture(scope="session")
def tree(run_file) -> xr.DataTree:
    with dataset.load(run_file) as opened:
        return opened.load()


class Drawn(dict[str, Figure]):
    """Every figure of the session, laid out when it is first looked at."""

    def __init__(self, tree: xr.DataTree) -> None:
        self._draw = figures_of(tree)
        self._made: dict[str, Figure] = {}

    def made(self, name: str) -> Figure:
        """Make a figure that need not be laid out, which takes longest."""
        if name not in self._made:
            self._made[name] = self._draw[name]()
        return self._made[name]

    def __missing__(self, name: str) -> Figure:
        figure = self[name] = self.made(name)
        figure.draw_without_rendering()
        return figure


@pytest.fixture(scope="session")
def figures(tree) -> Drawn:
    return Drawn(tree)
