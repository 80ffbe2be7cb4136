"""Drawing of the calibration object: every face is seen, and no place lies over another one."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.console.drawing import drawn_layout
from sldvexp.console.marks import wanted
from sldvexp.console.outlook import Outlook
from tests.console.two_faces import area_of, box_experiment


def drawn(experiment):
    outlook = Outlook(experiment, wanted(experiment))
    marks, told = drawn_layout(experiment, outlook.places, outlook.rims)
    return {mark["number"]: np.array(mark["at"]) for mark in marks}, marks, told


def test_a_board_is_drawn_from_its_front(lab_experiment):
    at, marks, told = drawn(lab_experiment)
    assert told == "from its front"
    target = lab_experiment.target
    flat = {k: target.unit.value * np.array([c.x, c.y]) for k, c in target.circles.items()}
    for number, place in flat.items():
        np.testing.assert_allclose(at[number] - at[1], place - flat[1], atol=2e-4)
    assert all(len(mark["rim"]) >= 12 for mark in marks)


@pytest.mark.whole
def test_circles_of_two_faces_stand_apart_in_their_order(tmp_path):
    at, marks, told = drawn(box_experiment(tmp_path))
    assert told == "obliquely"
    for left, right in ((1, 2), (4, 3), (5, 6), (8, 7)):
        assert at[left][0] < at[right][0]
    for low, high in ((1, 4), (2, 3), (4, 5), (3, 6), (5, 8), (6, 7)):
        assert at[high][1] - at[low][1] > 0.03  # on the front upwards, on the top to the rear
    areas = [area_of(np.array(mark["rim"])) for mark in marks]
    whole = np.pi * 0.015**2
    # Both faces are seen at 45 deg; a rim of 12 corners has 0.95 of its circle's area.
    assert areas == pytest.approx(8 * [0.95 * whole * np.sqrt(0.5)], rel=0.02)
