"""A box with circles on its front and its top, and a plate, as a user plans and meets them.

The true stands are some 22 mm and a degree beside the planned ones.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sldvexp.config.experiment import Experiment
from sldvexp.typing import Array
from sldvexp.virtual_lab.console import experiment

FILES = {
    "target/box.yaml": """
defaults: [schema/circles@_here_, _self_]
unit: mm
accuracy: 0.05
planes:
  front: {origin: [0, 0, 140], normal: [0, 0, 1]}
  top: {origin: [0, 160, 140], normal: [0, 1, 0]}
circles:
  1: {x: 25, y: 25, diameter: 30}
  2: {x: 210, y: 30, diameter: 30}
  3: {x: 200, y: 125, diameter: 30}
  4: {x: 40, y: 118, diameter: 30}
  5: {x: 30, y: 32, diameter: 30, plane: top}
  6: {x: 205, y: 38, diameter: 30, plane: top}
  7: {x: 185, y: 110, diameter: 30, plane: top}
  8: {x: 50, y: 102, diameter: 30, plane: top}
""",
    "laser/fine.yaml": """
defaults: [schema/two_mirror@_here_, _self_]
board: bits_16
mirror_offset: 0.05
up_down: {gain: 20}
left_right: {gain: 20}
""",
    "scene/practice.yaml": """
defaults: [schema/plate@_here_, _self_]
spot: {waist: 0.001, rayleigh: 2.03}
vibrometer: {distance: {worst: 1}}
plate:
  size: [0.6, 0.4]
  center: [0.12, 0.40, 0]
  thickness: 0.003
  modes:
    first: {x: 1, y: 1, velocity: 0.02}
    second: {x: 2, y: 1, velocity: 0.02}
views:
  '1': {origin: [-1.385, 1.002, 0.968], look_at: [0.105, 0.300, 0], roll: 0.6, angle_unit: deg}
  '2': {origin: [-0.050, 0.708, 1.210], look_at: [0.095, 0.300, 0], roll: -0.8, angle_unit: deg}
  '3': {origin: [0.310, 1.485, 0.830], look_at: [0.140, 0.320, 0], roll: 0.5, angle_unit: deg}
  '4': {origin: [0.648, 0.722, 1.180], look_at: [0.130, 0.285, 0], roll: -0.4, angle_unit: deg}
""",
    "experiment/bench.yaml": """# @package _global_
defaults:
  - _self_
  - override /target: box
  - override /laser: fine
  - override /scene: practice
  - override /scan: session
  - override /instrument: simulated
  - override /signal: sine_fit
  - override /pose: edge
  - override /volume: grid
scan:
  structure:
    corners_at: [[-0.18, 0.20, 0], [0.42, 0.20, 0], [0.42, 0.60, 0], [-0.18, 0.60, 0]]
    pixels: [25, 37]
    sampling: {frequency: [126.0]}
  poses:
    '1': {origin: [-1.397, 0.989, 0.981], look_at: [0.092, 0.315, 0.0]}
    '2': {origin: [-0.036, 0.696, 1.198], look_at: [0.111, 0.288, 0.0]}
    '3': {origin: [0.324, 1.498, 0.816], look_at: [0.131, 0.303, 0.0]}
    '4': {origin: [0.633, 0.733, 1.169], look_at: [0.146, 0.293, 0.0]}
volume:
  center: [0.12, 0.40, 0]
  size: [0.56, 0.36]
  shape: [29, 19]
  layers: 3
  thickness: 0.003
  margin: 0.016
""",
}


def write_files(folder: Path) -> Path:
    """Write the user's folder."""
    for name, text in FILES.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return folder


def area_of(outline: Array) -> float:
    """Compute the area within an outline, squared."""
    x, y = outline.T
    return float(abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2)


def box_experiment(folder: Path) -> Experiment:
    """Make the experiment of such a folder."""
    return experiment(["experiment=bench"], str(write_files(folder)))
