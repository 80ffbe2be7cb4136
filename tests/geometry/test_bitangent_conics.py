"""All four bitangents of two ellipses: exact, projective, with their covariance, or refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from sldvexp.errors import UserError
from sldvexp.geometry import bitangents, circles, conic
from sldvexp.geometry.bitangent import MIRRORED, bitangent_jacobian, bitangent_points
from sldvexp.geometry.circles import LINES, SIDES


def numbers(x: float, y: float, a: float, b: float, turn: float) -> np.ndarray:
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    shape = rotation @ np.diag([a**2, b**2]) @ rotation.T
    return np.array([x, y, shape[0, 0], shape[1, 1], shape[0, 1]])


PLACE = st.floats(-4000.0, 4000.0)
AXIS = st.floats(10.0, 150.0)
ELLIPSES = st.builds(numbers, PLACE, PLACE, AXIS, AXIS, st.floats(0.0, 3.1))
CIRCLES = st.builds(lambda x, y, r: np.array([x, y, r]), PLACE, PLACE, AXIS)

A = numbers(-900.0, 1100.0, 70.0, 50.0, 0.4)
B = numbers(300.0, -500.0, 60.0, 45.0, 1.2)


def apart(a: np.ndarray, b: np.ndarray, margin: float = 1.01) -> bool:
    """Whether circles around two ellipses stand apart, and clearly so."""
    reach = conic.semi_axes(a)[0] + conic.semi_axes(b)[0]
    return float(np.linalg.norm(a[:2] - b[:2])) > margin * reach


def of_circle(circle: np.ndarray) -> np.ndarray:
    x, y, r = circle
    return np.array([x, y, r**2, r**2, 0.0])


@given(CIRCLES, CIRCLES)
@settings(deadline=None)
def test_circles_have_the_bitangents_of_the_closed_form(a: np.ndarray, b: np.ndarray) -> None:
    assume(apart(of_circle(a), of_circle(b)))
    found = bitangent_points(of_circle(a), of_circle(b))
    assert found == pytest.approx(circles.bitangent_points(a, b), abs=1e-6)


@given(ELLIPSES, ELLIPSES)
@settings(deadline=None)
def test_each_line_touches_both_ellipses_on_the_sides_of_its_name(
    a: np.ndarray, b: np.ndarray
) -> None:
    assume(apart(a, b))
    points = bitangent_points(a, b)
    ahead = points[:, 1] - points[:, 0]
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) / np.linalg.norm(ahead, axis=1)[:, None]
    for k, ellipse in enumerate((a, b)):
        outward = SIDES[:, k, None] * left
        distance, normal = conic.signed_distance(points[:, k], ellipse)
        assert np.abs(distance).max() < 1e-6
        assert normal == pytest.approx(outward, abs=1e-6)


@given(
    ELLIPSES,
    ELLIPSES,
    st.floats(0, 6.3),
    st.floats(0.3, 2.0),
    st.floats(-0.5, 0.5),
    st.floats(-6e-5, 6e-5),
    st.floats(-6e-5, 6e-5),
    st.booleans(),
)
@settings(deadline=None)
def test_bitangents_are_projective(
    a: np.ndarray,
    b: np.ndarray,
    turn: float,
    stretch: float,
    shear: float,
    tilt_x: float,
    tilt_y: float,
    mirrored: bool,
) -> None:
    """Bitangent points of the images are the images of the bitangent points."""
    assume(apart(a, b))
    c, s = np.cos(turn), np.sin(turn)
    flip = np.diag([1.0, -1.0 if mirrored else 1.0])
    homography = np.eye(3)
    homography[:2, :2] = np.array([[c, -s], [s, c]]) @ [[1.0, shear], [0.0, stretch]] @ flip
    homography[2, :2] = tilt_x, tilt_y
    images = [conic.transformed(e, homography) for e in (a, b)]
    points = bitangent_points(a, b)
    mapped = np.concatenate([points, np.ones((4, 2, 1))], axis=-1) @ homography.T
    # the plane's line at infinity must not run between the ellipses: it would tear the image
    assume(mapped[..., 2].min() > 0.3 and all(conic.is_ellipse(e) for e in images))
    expected = mapped[..., :2] / mapped[..., 2:]
    found = bitangent_points(*images)
    assert found == pytest.approx(expected[MIRRORED] if mirrored else expected, abs=1e-5)


@pytest.mark.parametrize(
    ("a", "b"),
    [
        (numbers(0, 0, 50, 50, 0), numbers(400, 0, 50, 50, 0)),
        (numbers(0, 0, 50, 30, 0), numbers(400, 0, 50, 30, 0)),
        (numbers(0, 0, 50, 30, 0), numbers(0, 400, 50, 30, 0)),
        (numbers(0, 0, 50, 30, 0.7), numbers(300, 300, 50, 30, 0.7)),
        (numbers(4e3, -4e3, 50, 30, 0.7), numbers(3.8e3, -3.9e3, 50, 30, 0.7)),
        (numbers(-3e4, 3e4, 50, 30, 0.7), numbers(3e4, 3e4, 20, 90, 1.7)),
        (numbers(0, 0, 1, 1, 0), numbers(3.0, 4.0, 20, 2.4, 2.2)),
    ],
    ids=["equal circles", "along", "across", "oblique", "far off", "far apart", "around"],
)
def test_special_positions(a: np.ndarray, b: np.ndarray) -> None:
    points = bitangent_points(a, b)
    scale = np.abs(np.stack([a, b])[:, :2]).max()
    for k, ellipse in enumerate((a, b)):
        distance, _ = conic.signed_distance(points[:, k], ellipse)
        assert np.abs(distance).max() < 1e-11 * max(scale, 1.0) + 1e-9
    assert points[[0, 1, 2, 3]] == pytest.approx(bitangent_points(b, a)[[1, 0, 2, 3]][:, ::-1])


def test_equal_ellipses_have_parallel_external_bitangents() -> None:
    a = numbers(100, 200, 50, 30, 0.3)
    points = bitangent_points(a, a + np.array([300, 40, 0, 0, 0]))
    assert points[:2, 1] - points[:2, 0] == pytest.approx(np.tile([300.0, 40.0], (2, 1)))


@pytest.mark.parametrize(
    "b",
    [
        numbers(60, 0, 50, 50, 0),
        numbers(5, 5, 10, 10, 0),
        numbers(0, 0, 200, 150, 0.3),
        numbers(0, 0, 50, 30, 0),
        numbers(10, 0, 60, 20, 1.0),
    ],
    ids=["overlaps", "within", "around", "itself", "crosses"],
)
def test_ellipses_that_are_not_apart_give_nan(b: np.ndarray) -> None:
    a = numbers(0, 0, 50, 30, 0)
    assert np.isnan(bitangent_points(a, b)).all()
    assert not np.isnan(bitangent_points(np.stack([a, A]), np.stack([b, B]))[1]).any()


def test_nearly_touching_ellipses_are_told_from_overlapping_ones() -> None:
    a = numbers(0, 0, 50, 30, 0)
    assert np.isfinite(bitangent_points(a, numbers(90.0001, 0, 40, 60, 0))).all()
    assert np.isnan(bitangent_points(a, numbers(89.9999, 0, 40, 60, 0))).all()


def test_derivative_by_the_ten_numbers() -> None:
    analytic = bitangent_jacobian(A, B, bitangent_points(A, B))
    for i, step in enumerate([1e-2, 1e-2, 1.0, 1.0, 1.0] * 2):
        change = np.zeros(10)
        change[i] = step
        high, low = (bitangent_points(A + s * change[:5], B + s * change[5:]) for s in (1.0, -1.0))
        expected = (high - low) / (2 * step)
        assert analytic[..., i] == pytest.approx(expected, abs=2e-7)


def test_covariance_is_that_of_repeats() -> None:
    """Of three ellipses, so that points on one ellipse of two pairs move together."""
    rng = np.random.default_rng(1)
    count = 4000
    c = numbers(900.0, 1500.0, 55.0, 50.0, 0.0)
    scale = np.array([0.1, 0.1, 10.0, 10.0, 5.0])
    spread = 0.5 * np.diag(scale**2) + 0.1 * np.outer(scale, scale)
    ellipses = [conic.Ellipse(e, spread) for e in (A, B, c)]
    pairs = [(0, 1), (1, 2), (2, 0)]
    found = bitangents(ellipses, pairs, ["1", "2", "3"])
    root = np.linalg.cholesky(spread)
    noisy = [e.parameters + rng.normal(size=(count, 5)) @ root.T for e in ellipses]
    drawn = np.stack([bitangent_points(noisy[i], noisy[j]) for i, j in pairs], axis=1)
    stated = found.covariance.reshape(48, 48)
    deviation = np.sqrt(np.diag(stated))
    seen = np.cov(drawn.reshape(count, 48).T) / np.outer(deviation, deviation)
    correlation = stated / np.outer(deviation, deviation)
    # a correlation r has the standard error (1 - r^2) / sqrt(n), a variance sqrt(2 / n); of 1176
    bounds = 5.0 * np.sqrt((1.0 + correlation**2) / count)
    assert np.all(np.abs(seen - correlation) < bounds)
    assert np.linalg.matrix_rank(stated, tol=1e-9 * stated.max()) == 15


def test_overlapping_circles_are_named() -> None:
    near = conic.Ellipse(A + np.array([30.0, 0, 0, 0, 0]), np.eye(5))
    with pytest.raises(
        UserError,
        match=r"the ellipses of circle 1 and circle 4 overlap or lie one inside the other: their "
        r"centres are 30 steps apart with semi-axes of 70 x 50 and 70 x 50 steps; four bitangents "
        r"need ellipses that stand apart, so look whether both are edges of the same circle",
    ):
        bitangents([conic.Ellipse(A, np.eye(5)), near], [(0, 1)], ["circle 1", "circle 4"])


def test_lines_of_a_mirror_image_change_sides() -> None:
    assert [LINES[k] for k in MIRRORED] == [
        "external right",
        "external left",
        "internal right-left",
        "internal left-right",
    ]
