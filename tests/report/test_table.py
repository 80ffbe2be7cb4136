"""Rows of the closing table."""

from __future__ import annotations

import numpy as np

from sldvexp import dataset
from sldvexp.report.table import _point_rows


def test_rows_tell_of_their_own_point_and_frequency():
    velocity = np.ones((2, 3, 2), complex)
    efficiency = np.array([0.9, 0.8, 0.3, 0.2])[:, None].reshape(2, 1, 2) * np.ones((2, 3, 2))
    point = dataset.group(
        "point",
        {"point": ["a", "b"], "frequency": [10.0, 20.0]},
        velocity=velocity,
        confidence=np.full((2, 3, 2), 0.1),
        efficiency=efficiency,
        rcond=[0.5, 0.25],
        observable=np.array([[True, True, True], [True, True, False]]),
    )
    notes = {label: note for label, _, _, note in _point_rows("point", point)}
    assert notes["point, point a, frequency 10: V_z"] == "efficiency 0.9, rcond 0.5"
    assert notes["point, point a, frequency 20: V_z"] == "efficiency 0.8, rcond 0.5"
    assert notes["point, point b, frequency 10: V_x"] == "efficiency 0.3, rcond 0.25"
    assert notes["point, point b, frequency 20: V_x"] == "efficiency 0.2, rcond 0.25"
    assert notes["point, point b, frequency 20: V_z"] == "not determined by these views"
