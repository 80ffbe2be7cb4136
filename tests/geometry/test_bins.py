"""Boxes sorted into bins: every box that holds a place is among its candidates."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from sldvexp.geometry import Bins


@given(st.integers(1, 60), st.integers(0, 40), st.integers(0, 2**32 - 1))
def test_no_box_is_missed(boxes, places, seed):
    rng = np.random.default_rng(seed)
    least = rng.uniform(-1, 1, (boxes, 2)) * [1, 1000]
    most = least + rng.exponential(0.1, (boxes, 2)) * [1, 1000]
    x = rng.uniform(-1.2, 1.2, (places, 2)) * [1, 1000]
    place, box = Bins.from_boxes(least, most).pairs(x)
    candidates = np.zeros((places, boxes), int)
    np.add.at(candidates, (place, box), 1)
    inside = ((x[:, None] >= least) & (x[:, None] <= most)).all(axis=2)
    assert candidates.max(initial=0) <= 1
    assert (candidates[inside] == 1).all()
    assert (np.diff(place) >= 0).all()


def test_boxes_without_extent():
    place, box = Bins.from_boxes(np.zeros((3, 2)), np.zeros((3, 2))).pairs(np.zeros((2, 2)))
    assert place.tolist() == [0, 0, 0, 1, 1, 1]
    assert box.tolist() == [0, 1, 2] * 2


def test_few_candidates():
    least = np.stack(np.meshgrid(np.arange(50.0), np.arange(50.0)), axis=-1).reshape(-1, 2)
    x = np.random.default_rng(1).uniform(0, 50, (1000, 2))
    place, _ = Bins.from_boxes(least, least + 1).pairs(x)
    assert len(place) / len(x) < 4
