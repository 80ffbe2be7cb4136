"""Sample points of the triangle and the line."""

from __future__ import annotations

import itertools
from math import factorial

import numpy as np
import pytest

from sldvexp.volume import SampleSettings, tensor_rule
from sldvexp.volume.base import TRIANGLE_COUNTS
from sldvexp.volume.samples import TRIANGLE_POINTS, triangle_points


def test_the_counts_that_a_configuration_may_choose():
    assert tuple(TRIANGLE_POINTS) == TRIANGLE_COUNTS


@pytest.mark.parametrize("count", TRIANGLE_COUNTS)
def test_points_lie_inside_and_prefer_no_corner(count):
    points = triangle_points(count)
    assert points.shape == (count, 3)
    np.testing.assert_allclose(points.sum(axis=1), 1.0, rtol=1e-14)
    assert points.min() > 0.01
    rounded = {tuple(p) for p in points.round(10).tolist()}
    assert len(rounded) == count
    for turn in itertools.permutations(range(3)):
        assert {tuple(p) for p in points[:, turn].round(10).tolist()} == rounded


@pytest.mark.parametrize(("count", "degree"), [(1, 1), (3, 2), (6, 4), (7, 5), (12, 6)])
def test_points_are_those_of_gauss(count, degree):
    powers = [p for p in itertools.product(range(degree + 1), repeat=3) if sum(p) == degree]
    values = np.array([np.prod(triangle_points(count) ** np.array(p), axis=1) for p in powers])
    # The mean of xi1^i xi2^j xi3^k over the triangle.
    means = [2 * np.prod([factorial(n) for n in p]) / factorial(degree + 2) for p in powers]
    weights = np.linalg.lstsq(values, np.array(means, float), rcond=None)[0]
    np.testing.assert_allclose(values @ weights, means, atol=1e-14)
    assert weights.min() > 0.01


def test_points_through_the_thickness_are_those_of_gauss():
    np.testing.assert_allclose(tensor_rule(3, 2).line, [-1 / np.sqrt(3), 1 / np.sqrt(3)])
    assert tensor_rule(3, 1).line == [0.0]


def test_given_parameters_are_taken_as_they_are():
    given = [[1, 0, 0, -1], [0.2, 0.3, 0.5, 0.25]]
    rule = SampleSettings(parameters=given).rule()
    np.testing.assert_array_equal(rule.parameter, given)
    assert rule.triangle is None
    assert rule.line is None
