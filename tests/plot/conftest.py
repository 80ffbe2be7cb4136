"""A small session in the virtual lab, run once, and its figures, each drawn once."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
import xarray as xr

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
def run_file(tmp_path_factory):
    """run.nc of a small session, with its journal beside it."""
    folder = tmp_path_factory.mktemp("small")
    call = "from sldvexp.cli.main import main; main()"
    words = [sys.executable, "-c", call, *SMALL, f"hydra.run.dir={folder}/run"]
    subprocess.run(words, cwd=folder, capture_output=True, check=False)
    path = Path(folder / "run" / "run.nc")
    assert path.is_file()
    return path


@pytest.fixture(scope="session")
def tree(run_file) -> xr.DataTree:
    with dataset.load(run_file) as opened:
        return opened.load()


@pytest.fixture(scope="session")
def figures(tree):
    """Every figure of the session, laid out."""
    made = {name: draw() for name, draw in figures_of(tree).items()}
    for figure in made.values():
        figure.draw_without_rendering()
    return made
