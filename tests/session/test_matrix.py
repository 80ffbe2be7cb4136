"""Every instrument with every pose method on both D/A boards: a pose, or one sentence."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import pytest

from sldvexp.config import hydra_plugin
from sldvexp.limits import load_yaml
from sldvexp.sweep.matrix import read_matrix
from sldvexp.sweep.trial import Trials

hydra_plugin.install()

pytestmark = pytest.mark.usefixtures("client_clock")

CONF = Path(__file__).parents[2] / "conf"
FILE = CONF / "matrix" / "instruments.yaml"
AXES = load_yaml(FILE.read_text())["axes"]
NAMES = [
    ",".join(map("=".join, zip(AXES, values, strict=True))) for values in product(*AXES.values())
]

#: Left to the long tests: what differs from a quick one by its board or its way to samples alone.
QUICK = {
    "instrument=simulated,pose=bitangent,laser=ometron",
    "instrument=simulated,pose=edge,laser=ometron_16bit",
    "instrument=visa,pose=bitangent,laser=ometron_16bit",
    "instrument=replay,pose=edge,laser=ometron",
    "instrument=visa,pose=digitizer,laser=ometron",
    "instrument=file,pose=registration,laser=ometron",
    "instrument=images,pose=given,laser=ometron",
    "instrument=uff,pose=registration,laser=ometron",
    "instrument=scan_export,pose=digitizer,laser=ometron",
}
MARKED = [
    pytest.param(name, marks=[pytest.mark.long] * (name not in QUICK), id=name) for name in NAMES
]


@pytest.mark.whole
@pytest.mark.parametrize("name", MARKED)
def test_cell_is_as_expected(name, tmp_path):
    verdict = Trials(read_matrix(FILE), [], tmp_path).judge(name)
    assert verdict.passed, verdict.told


def test_every_cell_is_in_the_matrix():
    """A new instrument or pose method must find its place there."""
    from sldvexp.config.registry import BUILT_IN

    assert set(BUILT_IN["pose"]) == set(AXES["pose"])
    assert set(BUILT_IN["instrument"]) == set(AXES["instrument"])
    assert {p.stem for p in (CONF / "laser").glob("*.yaml")} == set(AXES["laser"])
    assert [cell.name for cell in read_matrix(FILE)] == NAMES
    assert len(NAMES) == len(AXES["pose"]) * len(AXES["instrument"]) * len(AXES["laser"])
    assert set(NAMES) >= QUICK


@pytest.mark.whole
def test_run_that_another_needs_has_scan_lines_of_its_own(tmp_path):
    """Although one before it had the same scan, whose images it could have taken over."""
    trials = Trials(read_matrix(FILE), [], tmp_path)
    for name in ("instrument=simulated,pose=given", "instrument=replay,pose=manual"):
        verdict = trials.judge(f"{name},laser=ometron")
        assert verdict.passed, verdict.told
