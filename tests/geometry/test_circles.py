"""Bitangents of two circles: what defines them, and their derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sldvexp.geometry.circles import (
    LINES,
    SIDES,
    bitangent_jacobian,
    bitangent_normals,
    bitangent_points,
)

radius = st.floats(0.1, 2)


@st.composite
def pairs(draw):
    """Two circles that lie outside each other, anywhere and in any direction."""
    ra, rb = draw(radius), draw(radius)
    gap, turn = draw(st.floats(0.05, 10)), draw(st.floats(-np.pi, np.pi))
    x, y = draw(st.floats(-10, 10)), draw(st.floats(-10, 10))
    distance = ra + rb + gap
    a = np.array([x, y, ra])
    return a, np.array([x + distance * np.cos(turn), y + distance * np.sin(turn), rb])


@given(pairs())
def test_lines_touch_both_circles_on_their_sides(pair):
    a, b = pair
    normals, points = bitangent_normals(a, b), bitangent_points(a, b)
    ahead = (b - a)[:2]
    for normal, touching, sides in zip(normals, points, SIDES, strict=True):
        assert np.linalg.norm(normal) == pytest.approx(1)
        assert ahead[0] * normal[1] - ahead[1] * normal[0] > 0  # the normal points left
        assert normal @ touching[0] == pytest.approx(normal @ touching[1], abs=1e-9)  # one line
        for circle, point, side in zip((a, b), touching, sides, strict=True):
            # Perpendicular to the radius: the line is a tangent there, with the circle to its
            # right if it touches the circle's left.
            np.testing.assert_allclose(point - circle[:2], side * circle[2] * normal, atol=1e-9)


def test_order_of_lines():
    points = bitangent_points([0, 0, 1], [10, 0, 1])
    assert LINES[:2] == ("external left", "external right")
    np.testing.assert_allclose(points[0], [[0, 1], [10, 1]])
    np.testing.assert_allclose(points[1], [[0, -1], [10, -1]])
    assert LINES[2] == "internal left-right"
    assert points[2, 0, 1] > 0 > points[2, 1, 1]
    assert LINES[3] == "internal right-left"
    assert points[3, 0, 1] < 0 < points[3, 1, 1]


@given(pairs())
def test_the_other_order_swaps_left_and_right(pair):
    a, b = pair
    forth, back = bitangent_points(a, b), bitangent_points(b, a)[:, ::-1]
    np.testing.assert_allclose(forth[[1, 0, 2, 3]], back, atol=1e-9)


def test_vectorised():
    rng = np.random.default_rng(3)
    a = rng.uniform([0, 0, 0.1], [1, 1, 1], (4, 5, 3))
    b = rng.uniform([5, 5, 0.1], [6, 6, 1], (4, 5, 3))
    points, jacobian = bitangent_points(a, b), bitangent_jacobian(a, b)
    assert points.shape == (4, 5, 4, 2, 2)
    assert jacobian.shape == (4, 5, 4, 2, 2, 6)
    np.testing.assert_array_equal(points[2, 3], bitangent_points(a[2, 3], b[2, 3]))
    np.testing.assert_array_equal(jacobian[2, 3], bitangent_jacobian(a[2, 3], b[2, 3]))


def test_circles_that_overlap_have_no_internal_tangents():
    points = bitangent_points([0, 0, 1], [1.5, 0, 1])
    assert np.isfinite(points[:2]).all()
    assert np.isnan(points[2:]).all()


@given(pairs())
def test_jacobian_is_the_derivative(pair):
    numbers = np.concatenate(pair)
    step = 1e-5
    differences = np.empty((4, 2, 2, 6))
    for k, e in enumerate(step * np.eye(6)):
        up, down = numbers + e, numbers - e
        differences[..., k] = bitangent_points(up[:3], up[3:]) - bitangent_points(
            down[:3], down[3:]
        )
    # Central differences err by step^2 times the third derivative, large for a narrow gap.
    np.testing.assert_allclose(
        bitangent_jacobian(*pair), differences / (2 * step), rtol=1e-5, atol=1e-6
    )
