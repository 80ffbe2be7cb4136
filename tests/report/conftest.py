"""A run's file with a small field, made by hand: all that a page looks at, in no time."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from sldvexp import dataset
from sldvexp.report.html import figures, run_page, sweep_page
from sldvexp.volume import Grid
from tests.report import devtools
from tests.report.opened import Opened

COMPONENTS = {"world": ["x", "y", "z"], "local": ["t1", "t2", "n"]}
#: What a stranger's file may have where a name is expected.
HOSTILE = "</script><img src=x onerror=alert(1)>\"'&{{7*7}}"


def volume(coordinates: str = "world", radius: float | None = None) -> xr.Dataset:
    """Nodes of a grid of 5 x 4 in 3 layers."""
    return Grid(
        size=[0.2, 0.15],
        shape=[5, 4],
        layers=3,
        thickness=0.01,
        radius=radius,
        coordinates=coordinates,
    ).group()


def field(of: xr.Dataset, coordinates: str = "world", hertz: tuple[float, ...] = (197.0, 439.0)):
    """A field whose parts and bounds are all different numbers."""
    nodes = of.sizes["node"]
    shape = (nodes, 3, len(hertz))
    rng = np.random.default_rng(7)
    velocity = 0.01 * (rng.normal(size=shape) + 1j * rng.normal(size=shape))
    velocity[:, :, 0] *= 2  # the first frequency is the stronger one
    bound = rng.uniform(1e-4, 2e-4, shape)
    parts = {"velocity_std": bound / 2, "velocity_std_noise": bound / 3, "element_error": bound / 9}
    found = dataset.group(
        "field",
        {
            "component": COMPONENTS[coordinates],
            "frequency": hertz,
            "view": ["left", HOSTILE],
        },
        velocity=velocity,
        confidence=bound,
        position=of["position"].values,
        observable=np.ones((nodes, 3), bool),
        samples_seen=[100, 90],
        residual_std_by_view=np.full((2, len(hertz)), 1e-5),
        **parts,
    )
    found = found.assign_coords(element=(("element", "corner"), of["element"].values))
    numbers = {"dof": 3 * nodes, "samples": 500, "sse": 1e-6, "residual_std": 1e-5, "cond": 40.0}
    found.attrs |= {**numbers, "confidence_level": 0.95, "coordinate_system": coordinates}
    found.attrs |= {"notes": f"mind {HOSTILE}", "coverage": "view left: sees 100 of 100 samples"}
    return found


@pytest.fixture
def no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pages without pictures, which take longest."""
    monkeypatch.setattr(figures, "PARTS", {part: {} for part in figures.PARTS})
    monkeypatch.setattr(sweep_page, "sweep_figures", lambda _: [])


@pytest.fixture
def hostile() -> str:
    """A name that a page must not obey."""
    return HOSTILE


@pytest.fixture(scope="session")
def small_volume() -> Callable[..., xr.Dataset]:
    """Make the group of a volume."""
    return volume


@pytest.fixture(scope="session")
def small_field() -> Callable[..., xr.Dataset]:
    """Make the group of a field over a volume."""
    return field


@pytest.fixture(scope="session")
def small_points() -> tuple[xr.Dataset, xr.Dataset]:
    """Velocities of five points at two frequencies, and what joins them."""
    rng = np.random.default_rng(5)
    names = {"point": ["1", "2", "7", "9", "12"]}
    velocity = 0.01 * (rng.normal(size=(5, 3, 2)) + 1j * rng.normal(size=(5, 3, 2)))
    bound = rng.uniform(1e-4, 2e-4, (5, 3, 2))
    hertz = {"frequency": [120.0, 450.0]}
    lines_of_sight = dataset.group(
        "line_of_sight",
        names,
        position=np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [2.0, 1, 1]]) / 10,
        triangle=np.array([[0, 1, 2], [1, 3, 2]]),
        line=np.array([[0, 1], [1, 3], [3, 4]]),
    )
    points = {"velocity": velocity, "confidence": bound, "velocity_std": bound / 2}
    return dataset.group("point", names | hertz, **points), lines_of_sight


@pytest.fixture
def run_file(tmp_path: Path, write_run: Callable[..., Path]) -> Callable[..., Path]:
    """Write a run's file with a field, and more groups if they are given."""
    return functools.partial(write_run, tmp_path)


@pytest.fixture(scope="session")
def write_run() -> Callable[..., Path]:
    """Write a run's file into a folder."""

    def write(
        folder: Path, coordinates: str = "world", radius: float | None = None, **groups: xr.Dataset
    ) -> Path:
        around = volume(coordinates, radius)
        tree = {"volume": around, "field": field(around, coordinates), **groups}
        attributes = {
            "config": f"volume: {{size: [0.2, 0.15], unit: {json.dumps(HOSTILE)}}}\nseed: 3\n",
            "plugins": json.dumps({"volume": "grid", HOSTILE: HOSTILE}),
            "inputs_sha256": json.dumps({HOSTILE: "00ff"}),
            "packages": json.dumps({"sldvexp": "0.1.0", "python": "3.11"}),
            "git_commit": "abc-dirty",
            "seed": 3,
            "start_time": "2026-01-02T03:04:05+00:00",
            "end_time": "2026-01-02T03:04:07+00:00",
        }
        path = folder / "run.nc"
        dataset.save(tree, attributes, path)
        return path

    return write


@pytest.fixture(scope="module")
def browser():
    """Start a browser for the tests of a file."""
    started = devtools.Browser()
    yield started
    started.close()


@pytest.fixture(scope="module")
def open_at(browser, write_run, tmp_path_factory):
    """Open the page of a run with a small field, without pictures."""

    def opened(size, **groups):
        path = write_run(tmp_path_factory.mktemp("run"), **groups)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(figures, "PARTS", {part: {} for part in figures.PARTS})
            page = run_page.write(path, path.with_name("report.html"))
        return Opened(browser, page, size)

    return opened
