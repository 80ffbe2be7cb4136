"""Ellipses as point and line conics, their images, and the distance of points from them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sldvexp.geometry import conic

#: Ellipses of a few dozen steps, thousands of steps from the origin.
CENTRES = st.floats(-5000.0, 5000.0)
AXES = st.floats(10.0, 200.0)


def numbers(x: float, y: float, a: float, b: float, turn: float) -> np.ndarray:
    """Five numbers of an ellipse by its centre, semi-axes and the direction of the first."""
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    shape = rotation @ np.diag([a**2, b**2]) @ rotation.T
    return np.array([x, y, shape[0, 0], shape[1, 1], shape[0, 1]])


ELLIPSES = st.builds(numbers, CENTRES, CENTRES, AXES, AXES, st.floats(0.0, np.pi))
ELLIPSE = numbers(-900.0, 1100.0, 65.0, 40.0, 0.4)
TURN = np.linspace(0.0, 2 * np.pi, 40, endpoint=False)


@given(ELLIPSES)
def test_points_of_the_boundary_fulfil_the_point_conic(ellipse: np.ndarray) -> None:
    points, _ = conic.boundary(ellipse, TURN)
    places = np.column_stack([points, np.ones(len(points))])
    terms = places[:, :, None] * conic.point_conic(ellipse) * places[:, None, :]
    assert np.abs(terms.sum(axis=(1, 2))).max() <= 1e-13 * np.abs(terms).max() + 1e-9


def test_points_of_the_boundary_fulfil_equation_4_17() -> None:
    points, _ = conic.boundary(ELLIPSE, TURN)
    a, b, c, d, e = conic.coefficients(ELLIPSE)
    x, y = points.T
    terms = np.stack([a * x**2, b * y**2, c * x * y, d * x, e * y, np.ones_like(x)])
    assert np.abs(terms.sum(axis=0)).max() <= 1e-14 * np.abs(terms).max()


@given(ELLIPSES)
def test_tangents_of_the_boundary_fulfil_the_line_conic(ellipse: np.ndarray) -> None:
    points, normals = conic.boundary(ellipse, TURN)
    lines = np.column_stack([normals, -(points * normals).sum(axis=1)])
    form = np.einsum("ni,ij,nj->n", lines, conic.line_conic(ellipse), lines)
    assert np.abs(form).max() <= 1e-11 * np.square(ellipse[:2]).sum() + 1e-9


@given(ELLIPSES)
def test_conics_of_any_scale_give_their_numbers_back(ellipse: np.ndarray) -> None:
    size = np.array([1.0, 1.0, 1e3, 1e3, 1e3])
    for back in (
        conic.from_line_conic(-3.0 * conic.line_conic(ellipse)),
        conic.from_point_conic(7e-4 * conic.point_conic(ellipse)),
    ):
        assert np.abs(back - ellipse) / size == pytest.approx(np.zeros(5), abs=1e-6)
    product = conic.line_conic(ellipse) @ conic.point_conic(ellipse)
    assert product == pytest.approx(np.eye(3), abs=1e-5)


def test_axes_and_angle() -> None:
    ellipse = conic.Ellipse(numbers(3.0, 4.0, 20.0, 50.0, 0.3), np.eye(5))
    assert ellipse.centre == pytest.approx([3.0, 4.0])
    assert ellipse.semi_axes == pytest.approx([50.0, 20.0])
    assert ellipse.angle == pytest.approx(0.3 - np.pi / 2)


def test_standard_errors_of_the_axes_follow_from_the_covariance() -> None:
    a, b, turn = 50.0, 20.0, 0.3
    step = np.array([0.02, 0.01])
    by_axis = np.stack(
        [
            (numbers(3, 4, a + 1e-4, b, turn) - numbers(3, 4, a - 1e-4, b, turn)) / 2e-4,
            (numbers(3, 4, a, b + 1e-4, turn) - numbers(3, 4, a, b - 1e-4, turn)) / 2e-4,
        ]
    )
    covariance = by_axis.T @ np.diag(step**2) @ by_axis
    ellipse = conic.Ellipse(numbers(3, 4, a, b, turn), covariance)
    assert ellipse.semi_axes_std == pytest.approx(step, rel=1e-6)


def test_hyperbola_and_parabola_are_no_ellipses() -> None:
    assert conic.is_ellipse(ELLIPSE)
    hyperbola = conic.from_point_conic(np.diag([1.0, -1.0, -1.0]))
    parabola = conic.from_point_conic(np.array([[1.0, 0, 0], [0, 0, -0.5], [0, -0.5, 0]]))
    imaginary = conic.from_point_conic(np.eye(3))
    assert not conic.is_ellipse(np.stack([hyperbola, parabola, imaginary])).any()


def test_image_of_an_ellipse_holds_the_images_of_its_points() -> None:
    homography = np.array([[1.1, 0.2, 30.0], [-0.1, 0.9, 5.0], [1e-5, -2e-5, 1.0]])
    points, _ = conic.boundary(ELLIPSE, TURN)
    mapped = np.column_stack([points, np.ones(len(points))]) @ homography.T
    image = conic.transformed(ELLIPSE, homography)
    distance, _ = conic.signed_distance(mapped[:, :2] / mapped[:, 2:], image)
    assert np.abs(distance).max() < 1e-9


@given(ELLIPSES, st.floats(-0.8, 3.0), st.floats(0.0, 2 * np.pi))
def test_distance_is_that_along_the_normal(ellipse: np.ndarray, d: float, turn: float) -> None:
    """Inside, a normal is the shortest way as far as the least radius of curvature reaches."""
    points, normals = conic.boundary(ellipse, [turn])
    longer, shorter = conic.semi_axes(ellipse)
    d = d * shorter**2 / longer
    distance, normal = conic.signed_distance(points + d * normals, ellipse)
    assert distance[0] == pytest.approx(d, abs=1e-8)
    assert normal[0] == pytest.approx(normals[0], abs=1e-6)


def test_distance_of_points_on_the_axes_and_at_the_centre() -> None:
    ellipse = numbers(0.0, 0.0, 50.0, 20.0, 0.0)
    places = np.array([[60.0, 0.0], [0.0, 25.0], [0.0, 0.0], [49.0, 0.0]])
    distance, normal = conic.signed_distance(places, ellipse)
    assert distance == pytest.approx([10.0, 5.0, -20.0, -1.0])
    assert np.linalg.norm(normal, axis=1) == pytest.approx(np.ones(4))


def difference(function, ellipse: np.ndarray) -> np.ndarray:  # type: ignore[no-untyped-def]
    """Central differences by the five numbers, along the last axis."""
    columns = []
    for step in np.diag([1e-3, 1e-3, 0.1, 0.1, 0.1]):
        change = function(ellipse + step) - function(ellipse - step)
        columns.append(change / (2 * step.sum()))
    return np.stack(columns, axis=-1)


def test_derivative_of_the_distance() -> None:
    points, normals = conic.boundary(ELLIPSE, TURN)
    points = points + np.linspace(-8.0, 8.0, len(TURN))[:, None] * normals
    _, normal = conic.signed_distance(points, ELLIPSE)
    expected = difference(lambda p: conic.signed_distance(points, p)[0], ELLIPSE)
    assert conic.distance_jacobian(normal, ELLIPSE) == pytest.approx(expected, abs=1e-7)


def test_derivative_of_the_coefficients() -> None:
    expected = difference(conic.coefficients, ELLIPSE)
    error = np.abs(conic.coefficients_jacobian(ELLIPSE) - expected)
    assert (error / np.abs(expected).max(axis=1, keepdims=True)).max() < 1e-6


def test_curvature_of_a_circle_and_at_the_ends_of_the_axes() -> None:
    circle = numbers(5.0, 6.0, 40.0, 40.0, 0.0)
    _, normals = conic.boundary(circle, TURN)
    assert conic.curvature(normals, circle) == pytest.approx(np.full(len(TURN), 1 / 40.0))
    ends = conic.curvature(np.eye(2), numbers(0.0, 0.0, 50.0, 20.0, 0.0))
    assert ends == pytest.approx([50.0 / 20.0**2, 20.0 / 50.0**2])


def test_three_steps_find_the_foot_of_an_edge(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of points a hundredth of the axes beside the curve, as edges of circles are."""
    rng = np.random.default_rng(3)
    ellipse = np.array([100.0, -300.0, 1600.0, 900.0, 200.0])
    points, normals = conic.boundary(ellipse, rng.uniform(0.0, 2 * np.pi, 200))
    points = points + rng.uniform(-0.4, 0.4, (200, 1)) * normals
    found = conic.signed_distance(points, ellipse)
    monkeypatch.setattr("sldvexp.geometry.conic.FOOT_ITERATIONS", 3)
    again = conic.signed_distance(points, ellipse)
    for least, whole in zip(again, found, strict=True):
        np.testing.assert_allclose(least, whole, rtol=0.0, atol=1e-12)
