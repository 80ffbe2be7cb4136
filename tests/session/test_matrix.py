"""Every instrument with every pose method on both D/A boards: a pose, or one sentence."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from sldvexp.config import hydra_plugin
from sldvexp.sweep.matrix import read_matrix
from sldvexp.sweep.trial import Trials

hydra_plugin.install()

pytestmark = pytest.mark.usefixtures("client_clock")

CONF = Path(__file__).parents[2] / "conf"
FILE = CONF / "matrix" / "instruments.yaml"
CELLS = {cell.name: cell for cell in read_matrix(FILE)}

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
    pytest.param(name, marks=[pytest.mark.long] * (name not in QUICK), id=name) for name in CELLS
]


@pytest.mark.whole
@pytest.mark.parametrize("name", MARKED)
def test_cell_is_as_expected(name, tmp_path):
    verdict = Trials(list(CELLS.values()), [], tmp_path).judge(name)
    assert verdict.passed, verdict.told


def test_every_cell_is_in_the_matrix():
    """A new instrument or pose method must find its place there."""
    from sldvexp.config.registry import BUILT_IN

    axes = yaml.safe_load(FILE.read_text())["axes"]
    assert set(BUILT_IN["pose"]) == set(axes["pose"])
    assert set(BUILT_IN["instrument"]) == set(axes["instrument"])
    assert {p.stem for p in (CONF / "laser").glob("*.yaml")} == set(axes["laser"])
    assert len(CELLS) == len(axes["pose"]) * len(axes["instrument"]) * len(axes["laser"])
    assert set(CELLS) >= QUICK


@pytest.mark.whole
def test_run_that_another_needs_has_scan_lines_of_its_own(tmp_path):
    """Although one before it had the same scan, whose images it could have taken over."""
    trials = Trials(list(CELLS.values()), [], tmp_path)
    for name in ("instrument=simulated,pose=given", "instrument=replay,pose=manual"):
        verdict = trials.judge(f"{name},laser=ometron")
        assert verdict.passed, verdict.told
