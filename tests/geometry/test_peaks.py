"""Local maxima on triangles, and how far they stand out."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.geometry import peaks
from sldvexp.volume import Grid

GRID = Grid(size=[1.0, 0.8], shape=[41, 33], layers=2).prisms()
X, Y = GRID.surface[:, 0], GRID.surface[:, 1]


def hill(x, y, height, width=0.1):
    return height * np.exp(-((X - x) ** 2 + (Y - y) ** 2) / (2 * width**2))


def found(values, bound=0.05, most=5):
    return peaks(values, GRID.triangles, np.full(len(values), bound), most)


def test_hills_are_found_in_their_order():
    values = hill(-0.3, 0.1, 1.0) + hill(0.3, 0.2, 2.0) + hill(0.0, -0.3, 0.5)
    places = GRID.surface[found(values), :2]
    assert places == pytest.approx(np.array([[0.3, 0.2], [-0.3, 0.1], [0.0, -0.3]]), abs=0.026)


def test_no_more_than_asked_for():
    assert len(found(hill(-0.3, 0.1, 1.0) + hill(0.3, 0.2, 2.0), most=1)) == 1


def test_ripples_within_the_bound_are_none():
    """Noise on a hill makes many local maxima, none of which is a second hill."""
    noise = np.random.default_rng(1).uniform(-0.02, 0.02, len(X))
    assert len(found(hill(0.0, 0.0, 1.0, 0.3) + noise)) == 1
    assert len(found(hill(0.0, 0.0, 1.0, 0.3) + noise, bound=0.005)) > 1


def test_a_saddle_decides_whether_two_hills_are_two():
    two = hill(-0.15, 0.0, 1.0) + hill(0.15, 0.0, 0.95)
    saddle = two[np.argmin(np.hypot(X, Y))]
    assert 0.5 < saddle < 0.9
    assert len(found(two, bound=0.9 * (0.95 - saddle))) == 2
    assert len(found(two, bound=1.2 * (0.95 - saddle))) == 1


def test_a_maximum_at_the_rim_counts_and_nothing_below_its_bound():
    assert GRID.surface[found(X), 0] == pytest.approx([0.5])
    assert found(np.full(len(X), 0.01)) == []


def test_hills_on_pieces_that_are_not_joined_are_two():
    strip = np.array([[0, 1, 2], [3, 4, 5]])
    values = np.array([0.0, 1.0, 0.5, 0.2, 0.1, 2.0])
    assert peaks(values, strip, np.full(6, 0.1), 5) == [5, 1]
