"""What a session of many lines, a page of many nodes and files of many functions and rows take.

Processor time and memory of processes of their own. Sizes are full only with
``SLDVEXP_BENCHMARK=1``, when they are asserted; otherwise the same is done once and small.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from sldvexp.config.paths import JOURNAL, RUN_FILE
from sldvexp.instrument import Acquisition, RawSamples
from sldvexp.instrument.recording import write_line

FULL_SIZE = os.environ.get("SLDVEXP_BENCHMARK") == "1"
SLDVEXP = (sys.executable, "-m", "sldvexp.cli.main")

#: Of each: how many at full size, s and MB at most; of the page its size in MB.
LINES, LINES_SECONDS, LINES_MEGABYTES = 100_000 if FULL_SIZE else 20, 60.0, 500.0
SIDES, PAGE_SECONDS, PAGE_MEGABYTES = (380, 264) if FULL_SIZE else (8, 6), 10.0, 4.0
FUNCTIONS, FUNCTIONS_SECONDS = 100_000 if FULL_SIZE else 20, 5.0
ROWS = 1_000_000 if FULL_SIZE else 50
#: A whole run of a table, over making numbers of its cells with the module csv, each the least of
#: three that take turns: 1.08 as measured, 4.0 s. And its memory, MB.
ROWS_RATIO, ROWS_MEGABYTES, TURNS = 1.3, 450.0, 3 if FULL_SIZE else 1

pytestmark = pytest.mark.skipif(
    not FULL_SIZE and "PYTEST_XDIST_WORKER" in os.environ,
    reason="processes of seconds each; run without -n, or set SLDVEXP_BENCHMARK=1",
)

ACQUISITION = Acquisition(rate=100e3, samples=20, amplitude=1.0, excitation=(1000.0,))
REPLAYED = """
import sys
from pathlib import Path
import numpy as np
from sldvexp.instrument import Acquisition
from sldvexp.instrument.recording import Recording

recorded = Recording(Path(sys.argv[1]), "front")
recorded.configure(Acquisition(rate=100e3, samples=20, amplitude=1.0, excitation=(1000.0,)))
for k in range(int(sys.argv[2])):
    found = recorded.scan(np.column_stack([np.arange(20), np.full(20, k)]))
    assert found.counts[0, 0, 0] == k % 1000
"""
INDEXED = """
import sys
from pathlib import Path
from sldvexp.io.uff import universal_file

with universal_file(Path(sys.argv[1])) as file:
    assert len(file.functions) == int(sys.argv[2])
"""
READ = """
import csv
import sys

with open(sys.argv[1], newline="") as file:
    rows = csv.reader(file)
    next(rows)
    table = [[float(cell) for cell in row] for row in rows]
assert len(table) == int(sys.argv[2])
"""
FUNCTION = """\
    -1
    58
made
NONE
29-Nov-26 12:00:00
NONE
NONE
    4         0    0         0 NONE      {0:10d}   3 NONE               1   1
         5         4         1  0.00000E+00  1.00000E+00  0.00000E+00
        18    0    0    0 NONE                 NONE
        11    0    0    0 NONE                 NONE
        13    0    0    0 NONE                 NONE
         0    0    0    0 NONE                 NONE
  1.00000E+00  2.00000E+00  3.00000E+00  4.00000E+00  5.00000E+00  6.00000E+00
  7.00000E+00  8.00000E+00
    -1
"""
DIRECTIONS = np.array([[0, 0, 1.0], [0, 0.6, 0.8], [0.6, 0, 0.8], [-0.6, 0, 0.8], [0, -0.6, 0.8]])


def test_journal_of_many_lines(cost_of, tmp_path):
    for k in range(LINES):
        samples = RawSamples(
            np.full((20, 2, 20), k % 1000, np.int16), np.full(2, 1e-4), 100e3, np.zeros(20, int)
        )
        dac = np.column_stack([np.arange(20), np.full(20, k)])
        path = tmp_path / JOURNAL / "front" / f"image_{k:06d}.npz"
        write_line(path, dac, ACQUISITION, samples, lasting=False)
    cost = cost_of([sys.executable, "-c", REPLAYED, str(tmp_path), str(LINES)], tmp_path)
    print(f"replay of {LINES} lines: {cost.seconds:.1f} s, {cost.megabytes:.0f} MB")
    if FULL_SIZE:
        assert cost.seconds <= LINES_SECONDS
        assert cost.megabytes <= LINES_MEGABYTES


def many_points(path: Path) -> Path:
    """Write a bending wave on a sheet, as five views see it."""
    x, y = np.meshgrid(*(np.linspace(0, 0.001 * n, n) for n in SIDES), indexing="ij")
    z = (1e-3 * np.cos(25 * x) * np.cos(25 * y)).reshape(-1, 1)
    at = np.arange(x.size).reshape(SIDES)
    corners = (at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, :-1], at[1:, 1:], at[:-1, 1:])
    noise = 1e-6 * np.random.default_rng(3).normal(size=(len(DIRECTIONS), x.size, 1))
    by = ("view", "point", "frequency")
    cosines = np.broadcast_to(DIRECTIONS[:, None], (len(DIRECTIONS), x.size, 3))
    xr.Dataset(
        {
            "direction_cosines": (("view", "point", "axis"), cosines),
            "velocity": (by, DIRECTIONS[:, 2, None, None] * z + noise),
            "std": (by, np.full(noise.shape, 1e-6)),
            "frequency": ("frequency", [200.0]),
            "position": (("point", "axis"), np.stack([x, y, 0 * x], -1).reshape(-1, 3)),
            "triangle": (("face", "corner"), np.stack(corners, axis=-1).reshape(-1, 3)),
        }
    ).to_netcdf(path)
    return path


def test_page_of_many_nodes(cost_of, tmp_path):
    measured = many_points(tmp_path / "points.nc")
    run = [*SLDVEXP, "experiment=point", f"instrument.path={measured}", "hydra.run.dir=run"]
    cost_of([*run, "report=none"], tmp_path)
    assert (tmp_path / "run" / RUN_FILE).is_file()
    cost = cost_of([*SLDVEXP, "report", "run"], tmp_path)
    size = (tmp_path / "run" / "report.html").stat().st_size / 1e6
    print(f"page of {np.prod(SIDES)} nodes: {cost.seconds:.1f} s, {size:.1f} MB")
    if FULL_SIZE:
        assert cost.seconds <= PAGE_SECONDS
        assert size <= PAGE_MEGABYTES


def test_universal_file_of_many_functions(cost_of, tmp_path):
    path = tmp_path / "many.uff"
    with path.open("w") as file:
        file.writelines(FUNCTION.format(k + 1) for k in range(FUNCTIONS))
    cost = cost_of([sys.executable, "-c", INDEXED, str(path), str(FUNCTIONS)], tmp_path)
    print(f"index of {FUNCTIONS} functions: {cost.seconds:.1f} s, {cost.megabytes:.0f} MB")
    if FULL_SIZE:
        assert cost.seconds <= FUNCTIONS_SECONDS


def test_table_of_many_rows(cost_of, tmp_path):
    points, rng = ROWS // len(DIRECTIONS), np.random.default_rng(4)
    with (tmp_path / "rows.csv").open("w") as file:
        file.write("view,point,dx,dy,dz,frequency,real,imag,std\n")
        for k, (x, y, z) in enumerate(DIRECTIONS):
            along = 1.0 + 0.001 * rng.normal(size=points)
            file.writelines(
                f"{k},{p},{x},{y},{z},100,{z * a:.5f},0.0,0.001\n" for p, a in enumerate(along)
            )
    run = [*SLDVEXP, "experiment=point", "instrument.path=rows.csv", "report=none"]
    read = [sys.executable, "-c", READ, "rows.csv", str(points * len(DIRECTIONS))]
    runs, reads = [], []
    for k in range(TURNS):
        runs.append(cost_of([*run, f"hydra.run.dir=run_{k}"], tmp_path))
        reads.append(cost_of(read, tmp_path))
    cost, plain = min(runs), min(reads)
    ratio = cost.seconds / plain.seconds
    print(f"run of {ROWS} rows: {cost.seconds:.1f} s, {cost.megabytes:.0f} MB")
    print(f"reading them with csv: {plain.seconds:.1f} s, a ratio of {ratio:.2f}")
    if FULL_SIZE:
        assert ratio <= ROWS_RATIO
        assert cost.megabytes <= ROWS_MEGABYTES
