"""Plans before own calibration boxes: every stand sees all circles, and a scan finds them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import sldvexp as program
from sldvexp import planner
from sldvexp.planner.circle_limits import hidden_told
from sldvexp.planner.images import stand_at
from sldvexp.planner.place import Place, Unseen
from sldvexp.planner.search import candidates, examined
from tests.composing import experiment

#: A box with circles on its front and on its top, so many mm before the plane of the plate.
BOX = """defaults: [schema/circles@_here_, _self_]
unit: mm
accuracy: 0.05
planes:
  front: {{origin: [0, 0, {0}], normal: [0, 0, 1]}}
  top: {{origin: [0, 150, {0}], normal: [0, 1, 0]}}
circles:
  1: {{x: 20, y: 20, diameter: 30}}
  2: {{x: 180, y: 25, diameter: 30}}
  3: {{x: 170, y: 125, diameter: 30}}
  4: {{x: 30, y: 120, diameter: 30}}
  5: {{x: 30, y: 40, diameter: 30, plane: top}}
  6: {{x: 160, y: 60, diameter: 30, plane: top}}
"""
SESSION = """# @package _global_
defaults:
  - override /target: box
  - override /laser: mine
  - override /scene: schema/plate
  - override /scan: session
  - override /instrument: simulated
  - override /signal: sine_fit
  - override /pose: edge
  - override /volume: grid
  - override /reconstruction: samplewise
  - override /report: none
scene:
  plate:
    size: [0.6, 0.4]
    center: [0.55, 0.10, 0.0]
    modes:
      bending: {x: 1, y: 1, frequency: 126.0, velocity: 0.02}
scan:
  structure:
    corners_at: [[0.25, -0.10, 0], [0.85, -0.10, 0], [0.85, 0.30, 0], [0.25, 0.30, 0]]
    pixels: [13, 17]
    sampling: {frequency: [126.0]}
volume:
  center: [0.55, 0.10, 0]
  size: [0.56, 0.36]
  shape: [9, 7]
  layers: 3
  thickness: 0.003
  margin: 0.016
plan:
  stands: 3
  candidates: 300
  room: {incidence: 72}
"""
LASER = (
    "defaults: [schema/two_mirror@_here_, _self_]\nup_down: {gain: 20}\nleft_right: {gain: 20}\n"
)


@pytest.fixture
def own(tmp_path, monkeypatch):
    """Write a session before a box that stands so many mm before the plate's plane."""

    def written(forward: int) -> str:
        files = {"target/box": BOX.format(forward), "laser/mine": LASER, "experiment/own": SESSION}
        for name, text in files.items():
            path = tmp_path / "lab" / f"{name}.yaml"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return str(tmp_path / "lab")

    monkeypatch.chdir(tmp_path)
    return written


@pytest.mark.whole
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("forward", [100, 0])
def test_no_planned_stand_has_a_circle_hidden(forward, seed, own):
    """Beside the plate, whose edge is before circles on the top, and before it."""
    e = experiment("experiment=own", f"seed={seed}", config_dir=own(forward))
    found = planner.plan(e)
    assert (found.examined.refused == 0).all()
    assert list(hidden_told(found.stands, found.place)) == []
    assert list(hidden_told(found.stands, Place.from_experiment(e, new_stands=False))) == []


def test_places_from_which_the_plate_hides_circles_are_not_feasible(own):
    """They are many of those that all else allows."""
    place = Place.from_experiment(experiment("experiment=own", config_dir=own(0))).thinned()
    origins = candidates(place, 200, np.random.default_rng(0)).examined.origins
    assert not place.marks.hidden_by(place.structure, origins).any()
    away = np.array([[1.455, 1.081, 0.585]])
    assert examined(place, away).refused.tolist() == [Unseen.target_behind_structure]
    (told,) = hidden_told([stand_at("a", away[0], place)], place)
    assert "hides circle 6 " in told


@pytest.mark.whole
@pytest.mark.parametrize("forward", [100, 0])
def test_a_scan_from_planned_stands_finds_all_circles(forward, own, sldvexp):
    lab = own(forward)
    done = sldvexp("--config-dir", lab, "plan", "experiment=own", "--to", lab, "--name", "planned")
    assert (done.status, done.err) == (0, "")
    checked = sldvexp("--config-dir", lab, "plan", "check", "experiment=planned")
    assert (checked.status, checked.err) == (0, "")
    assert "hides" not in checked.out
    tree = program.run("experiment=planned", config_dir=Path(lab), quiet=True)
    planned = [s.split("│")[2] for s in done.out.splitlines() if s.startswith("│ ")][:3]
    places = np.array([[float(x) for x in row.split(",")] for row in planned])
    np.testing.assert_allclose(tree["pose"]["origin"].values, places, atol=2e-3)
