"""Cross-ratios: the example of Section 4.4.3.8 and projective invariance."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from sldvexp.errors import UserError
from sldvexp.geometry import cross_ratio
from sldvexp.laser import project

# Section 4.4.3.8, row vectors: P_wcs = P_lcs T.
P_LCS = np.array([[1, 1, 100], [5, 5, 100], [11, 11, 100], [20, 20, 100]], float)
LCS_TO_WCS = np.array(
    [
        [0.7855, 0.4456, 0.4295],
        [-0.5707, 0.7899, 0.2243],
        [-0.2393, -0.4213, 0.8748],
        [12.0, -7.0, -74.0],
    ]
)
P_WCS = np.array(
    [
        [-11.71, -47.89, 14.13],
        [-10.85, -42.95, 16.74],
        [-9.56, -35.53, 20.67],
        [-7.63, -24.41, 26.55],
    ]
)
EXPECTED = 25 / 19


def test_dissertation_points():
    world = np.column_stack([P_LCS, np.ones(4)]) @ LCS_TO_WCS
    np.testing.assert_allclose(world, P_WCS, atol=0.0101)  # T's digits times 100, and two decimals
    np.testing.assert_allclose(cross_ratio.from_points([P_LCS, world]), EXPECTED, rtol=1e-12)


def test_dissertation_slopes_and_angles():
    slopes = P_LCS[:, 1] / P_LCS[:, 2]
    assert cross_ratio.from_slopes(slopes) == pytest.approx(EXPECTED, rel=1e-12)
    assert cross_ratio.from_slopes([0.01, 0.05, 0.11, 0.20]) == pytest.approx(EXPECTED, rel=1e-12)
    assert cross_ratio.from_angles(np.arctan(slopes)) == pytest.approx(EXPECTED, rel=1e-12)


def test_dissertation_left_right_slopes():
    # Eq 4.16 prints slopes times 100 to four decimals.
    printed = [0.4982, 2.4911, 5.4805, 9.9645]
    assert cross_ratio.from_slopes(printed) == pytest.approx(EXPECTED, abs=5e-4)


coordinate = st.floats(-10, 10)
four = st.lists(coordinate, min_size=4, max_size=4).map(np.array)


def spread(values, least=0.1):
    return np.diff(np.sort(values)).min() > least


@given(four, st.floats(-0.08, 0.08), st.floats(0.5, 2), st.floats(-5, 5))
def test_invariant_under_a_projectivity_of_the_line(x, c, scale, shift):
    assume(spread(x))
    image = (scale * x + shift) / (1 + c * x)  # the vanishing point stays outside [-10, 10]
    determinant = scale - c * shift
    assume(abs(determinant) > 0.1)
    np.testing.assert_allclose(
        cross_ratio.from_coordinates(image), cross_ratio.from_coordinates(x), rtol=1e-8
    )


@pytest.mark.whole
@given(four, st.integers(2, 5), st.integers(0, 2**32 - 1))
def test_points_of_any_dimension_agree_with_their_coordinates(x, dimensions, seed):
    assume(spread(x))
    start, along = np.random.default_rng(seed).normal(size=(2, dimensions))
    points = start + x[:, None] * along / np.linalg.norm(along)
    np.testing.assert_allclose(
        cross_ratio.from_points(points), cross_ratio.from_coordinates(x), rtol=1e-9
    )


@pytest.mark.whole
@given(four, st.floats(0.5, 20), st.floats(-1, 1), st.floats(-1, 1), st.floats(0, 0.06))
def test_up_down_mirror_keeps_the_cross_ratio(x, distance, slant, tilt, offset):
    """Any line: the up-down mirror's planes all pass through its axis (Section 4.4.3.8)."""
    assume(spread(x))
    points = np.stack([slant * x, x, 12 + distance + tilt * x], axis=-1)
    up_down = project(points, offset)[:, 0]
    expected = cross_ratio.from_points(points)
    np.testing.assert_allclose(cross_ratio.from_angles(up_down), expected, rtol=1e-7)
    np.testing.assert_allclose(cross_ratio.from_slopes(np.tan(up_down)), expected, rtol=1e-7)


@given(four, st.floats(0.5, 20), st.floats(-1, 1), st.floats(-1, 1), st.floats(0, 0.06))
def test_left_right_mirror_keeps_the_cross_ratio(x, distance, up_down, tilt, offset):
    """Lines in the plane of one up-down angle, also where the mirrors are apart (4.4.3.9)."""
    assume(spread(x))
    reach = 12 + distance + tilt * x
    points = np.stack([x, reach * np.sin(up_down), reach * np.cos(up_down)], axis=-1)
    left_right = project(points, offset)[:, 1]
    expected = cross_ratio.from_points(points)
    np.testing.assert_allclose(cross_ratio.from_angles(left_right), expected, rtol=1e-7)
    np.testing.assert_allclose(cross_ratio.from_slopes(np.tan(left_right)), expected, rtol=1e-7)


def test_points_beside_the_line_are_refused():
    bent = P_LCS.copy()
    bent[2, 0] += 1e-3
    with pytest.raises(UserError, match=r"must lie on one line: they stand up to 0\.00\d+ beside"):
        cross_ratio.from_points(bent)
    # Printed coordinates are collinear to their rounding only.
    with pytest.raises(UserError, match="must lie on one line"):
        cross_ratio.from_points(P_WCS)
    assert cross_ratio.from_points(P_WCS, tolerance=1e-3) == pytest.approx(EXPECTED, abs=2e-3)


@pytest.mark.parametrize("x", [[1, 2, 2, 3], [1, 2, 3, 1], [1, 2, 3, np.nan], [1, 2, 3, np.inf]])
def test_undetermined_ratios_are_refused(x):
    for function in (
        cross_ratio.from_coordinates,
        cross_ratio.from_slopes,
        cross_ratio.from_angles,
    ):
        with pytest.raises(UserError, match="needs four finite elements A, B, C and D"):
            function(x)
    with pytest.raises(UserError, match="needs four finite elements A, B, C and D"):
        cross_ratio.from_points(np.column_stack([x, x]))
