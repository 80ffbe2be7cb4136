"""Baselines that several benchmarks have, and the table of all that they print.

Times are of processors: how long something takes on a machine that others use as well says little.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from sldvexp.field import View, VolumeVisibility
from sldvexp.laser import Mirror, TwoMirror, project
from sldvexp.volume import Grid

GROUPS = 13
#: A program that does nothing, with as many groups as ours.
BARE = """
import hydra

@hydra.main(version_base="1.3", config_path="conf", config_name="config")
def main(config):
    pass

main()
"""
LASER = TwoMirror(mirror_offset=0.045, up_down=Mirror(25), left_right=Mirror(25))
STANDS = [[0.0, -0.5, 1.6], [0.6, 0.5, 1.5], [0.3, 0.3, 1.6], [-0.5, 0.4, 1.5], [0.6, -0.2, 1.5]]
#: Of the plate, m; of the noise, m/s; of the poses, rad and m; how many modes the plate has.
SIDE, STD, POSE_STD, MODES = 0.4, 1e-3, 1e-4, 6


def view(name: str, origin: np.ndarray, rng: np.random.Generator, size: tuple[int, int]) -> View:
    """A lattice of pixels over the plate that sees some modes, and noise.

    Parameters
    ----------
    size : pair of int
        Pixels along a side, and frequencies.
    """
    pixels, frequencies = size
    z = -origin / np.linalg.norm(origin)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z])
    corner = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-0.1, 0.1)])
    in_laser = (1.1 * SIDE / 2 * corner - origin) @ rotation.T
    dac = LASER.dac_from_angle(project(in_laser, LASER.mirror_offset))
    axes = np.linspace(dac.min(axis=0), dac.max(axis=0), pixels).T
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    shapes = np.cos(lattice @ (1e-3 * np.arange(1, 2 * MODES + 1).reshape(2, MODES)))
    lines = np.linspace(0.0, MODES, frequencies)
    response = 1 / (np.arange(MODES)[:, None] + 0.5 - lines + 0.05j)
    noise = STD * rng.normal(size=(len(lattice), frequencies, 2)).view(complex)[..., 0]
    covariance = np.diag([POSE_STD] * 6) ** 2
    std, flags = np.full(len(lattice), STD), np.zeros(len(lattice), int)
    velocity = shapes @ response + noise
    return View(name, rotation, origin, covariance, lattice, velocity, std, flags, (pixels, pixels))


def looks_at(
    shape: tuple[int, int],
    pixels: int,
    frequencies: int = 1,
    stands: Sequence[Sequence[float]] = STANDS,
) -> VolumeVisibility:
    """The views of a volume of seven layers with so many nodes, six samples in each prism."""
    rng = np.random.default_rng(29)
    size = (pixels, frequencies)
    views = [view(str(k + 1), np.array(stand), rng, size) for k, stand in enumerate(stands)]
    volume = Grid(size=[SIDE, SIDE], shape=list(shape), layers=7, thickness=0.024)
    return VolumeVisibility(views, LASER, volume.prisms(), volume.rule())


@pytest.fixture(scope="session")
def make_looks() -> Callable[..., VolumeVisibility]:
    return looks_at


class Cost(NamedTuple):
    """Seconds that a process and its own took of all processors, and the largest one's MB."""

    seconds: float
    megabytes: float


#: Starts a call and says what it took. A process is told to have needed at least the memory of the
#: one that started it, which of all benchmarks is a lot and of this one is little.
STARTER = """
import json, os, subprocess, sys
process = subprocess.Popen(sys.argv[1:], stdout=subprocess.DEVNULL)
_, status, used = os.wait4(process.pid, 0)
status = process.returncode = os.waitstatus_to_exitcode(status)
print(json.dumps([status, used.ru_utime + used.ru_stime, used.ru_maxrss / 1024]))
"""


def cost_of(call: Sequence[str], folder: Path) -> Cost:
    start = [sys.executable, "-c", STARTER, *call]
    made = subprocess.run(start, cwd=folder, capture_output=True, text=True, check=True)
    status, *cost = json.loads(made.stdout)
    assert status in (0, 2), made.stderr
    return Cost(*cost)


def largest_memory() -> float:
    """MB that this process had at most, and not the one that started it."""
    status = Path("/proc/self/status")
    if status.is_file():
        (line,) = (of for of in status.read_text().splitlines() if of.startswith("VmHWM:"))
        return float(line.split()[1]) / 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


@pytest.fixture(scope="session", name="cost_of")
def _cost_of() -> Callable[[Sequence[str], Path], Cost]:
    return cost_of


@pytest.fixture
def bare_program(tmp_path: Path) -> Path:
    """Folder of ``bare.py``; its configuration is plain: groups of six numbers each."""
    conf = tmp_path / "conf"
    for k in range(GROUPS):
        (conf / f"group_{k}").mkdir(parents=True)
        lines = [f"key_{i}: {i}" for i in range(6)]
        (conf / f"group_{k}" / "one.yaml").write_text("\n".join(lines))
    defaults = "".join(f"  - group_{k}: one\n" for k in range(GROUPS))
    (conf / "config.yaml").write_text(f"defaults:\n{defaults}  - _self_\nseed: 0\n")
    (tmp_path / "bare.py").write_text(BARE)
    return tmp_path


#: What every benchmark has printed.
_told: list[tuple[str, str]] = []


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Iterator[None]:
    report = yield
    if report.when == "call" and report.capstdout.strip():
        _told.append((f"{report.nodeid.rpartition('/')[2]} {report.outcome}", report.capstdout))
    return report


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    if os.environ.get("SLDVEXP_BENCHMARK") == "1":
        terminalreporter.section("benchmarks, processor time")
        for name, told in _told:
            terminalreporter.write_line(name)
            for line in told.strip().splitlines():
                terminalreporter.write_line(f"    {line}")
