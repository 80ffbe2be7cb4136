"""The experiment that a plan writes, built on the user's own or with all lines of it."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from sldvexp.pose.bitangent import Bitangent
from sldvexp.pose.edge import Edge
from sldvexp.virtual_lab.console import experiment
from tests.console.two_faces import FILES

MINE = """# @package _global_
# My plate over my box.
defaults:
  - override /target: box
  - override /laser: fine
  - override /scan: session
  - override /instrument: visa
  - override /signal: sine_fit
  - override /pose: edge
  - override /volume: grid
instrument:
  resource: TCPIP::127.0.0.1::5627::SOCKET   # the practice instrument
  profile: virtual_lab                       # what is sent to it
signal: {velocity_per_volt: 0.01}            # m/s
scan:
  structure:
    corners_at: [[-0.18, 0.20, 0], [0.42, 0.20, 0], [0.42, 0.60, 0], [-0.18, 0.60, 0]]
    pixels: [9, 11]
    sampling: {frequency: [126.0]}
volume: {center: [0.12, 0.40, 0], size: [0.56, 0.36], shape: [7, 5], layers: 3, thickness: 0.003}
"""
POSES = "  poses:\n    front: {origin: [0.1, 1.0, 1.2], look_at: [0.1, 0.3, 0]}\n"
pytestmark = pytest.mark.whole
PLAN = (
    *("plan", "--config-dir", "lab", "--to", "lab", "experiment=mine"),
    *("plan.stands=3", "plan.candidates=300"),
)


@pytest.fixture
def lab(sldvexp):
    for name in ("target/box.yaml", "laser/fine.yaml"):
        path = Path("lab") / name
        path.parent.mkdir(parents=True)
        path.write_text(FILES[name])
    path = Path("lab/experiment/mine.yaml")
    path.parent.mkdir()
    path.write_text(MINE)
    return path


def test_a_plan_is_built_on_the_experiment_that_it_is_of(lab, sldvexp):
    done = sldvexp(*PLAN)
    assert (done.status, done.err) == (0, "")
    text = Path("lab/experiment/planned.yaml").read_text()
    assert "# Built on experiment=mine: its lines hold where nothing else is said here." in text
    made = yaml.safe_load(text)
    assert made["defaults"] == ["/experiment/mine", "_self_"]
    assert set(made) == {"defaults", "scan", "plan"}
    assert set(made["scan"]) == {"poses"}
    lab.write_text(MINE.replace("velocity_per_volt: 0.01", "velocity_per_volt: 0.02"))
    run = experiment(["experiment=planned"], "lab")
    assert run.signal.velocity_per_volt == 0.02
    assert list(run.scan.rough_poses()) == ["1", "2", "3"]
    assert run.scan.structure.pixels == [9, 11]


def test_a_plan_in_place_of_views_of_its_own_keeps_all_else_that_is_stated(lab, sldvexp):
    lab.write_text(MINE.replace("scan:\n", f"scan:\n{POSES}"))
    done = sldvexp(*PLAN)
    assert (done.status, done.err) == (0, "")
    text = Path("lab/experiment/planned.yaml").read_text()
    assert "# Made of experiment=mine, of which it has all lines that it goes on with." in text
    made = yaml.safe_load(text)
    assert made["signal"] == {"velocity_per_volt": 0.01}
    assert made["instrument"]["profile"] == "virtual_lab"
    run = experiment(["experiment=planned"], "lab")
    assert list(run.scan.rough_poses()) == ["1", "2", "3"]


@pytest.mark.parametrize(
    ("added", "chosen", "pose"),
    [("overwrite: true\n", (), Edge), ("", ("pose=bitangent",), Bitangent)],
    ids=["of other views", "another choice"],
)
def test_a_plan_is_not_built_on_what_does_not_hold_for_it(lab, sldvexp, added, chosen, pose):
    lab.write_text(MINE + added)
    done = sldvexp(*PLAN, *chosen)
    assert (done.status, done.err) == (0, "")
    made = yaml.safe_load(Path("lab/experiment/planned.yaml").read_text())
    assert "/experiment/mine" not in made["defaults"]
    run = experiment(["experiment=planned"], "lab")
    assert not run.overwrite
    assert isinstance(run.pose, pose)
