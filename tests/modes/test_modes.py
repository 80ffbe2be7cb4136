"""Modes of lines whose poles and shapes are known."""

from __future__ import annotations

import numpy as np
import pytest
from synthetic import image, plate_shapes, responses

from sldvexp import modes

LINE = np.arange(55.0, 1331.0, 5.0)
FREQUENCY = np.array([197.0, 439.0, 545.0, 787.0, 842.0])


def test_modes_without_noise_are_exact():
    shape = plate_shapes(80, 5)
    damping = np.array([0.01, 0.02, 0.005, 0.01, 0.03])
    rest = np.linspace(1e-5, 3e-5, 80)
    seen = responses(LINE, FREQUENCY, damping, shape, above=rest, below=rest)
    views = {"a": image(LINE, seen[:40], 1e-12), "b": image(LINE, seen[40:], 1e-12)}
    found = modes.estimate_modes(views, modes.MostLikelyModes())
    assert found.modes["natural_frequency"].values == pytest.approx(FREQUENCY, rel=1e-9)
    assert found.modes["damping_ratio"].values == pytest.approx(damping, rel=1e-7)
    whole = np.concatenate([found.images[v]["velocity"].values for v in "ab"])
    assert np.abs(whole - shape).max() < 1e-7 * np.abs(shape).max()
