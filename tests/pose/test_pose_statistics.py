"""Standard errors and intervals of a pose: against the Cramer-Rao bound over many repeats."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from sldvexp.geometry import euler_from_rotation, rotation_from_vector, vector_from_rotation
from sldvexp.laser import project
from sldvexp.pose import PoseSolution, half_width, solve_points, standard_error
from sldvexp.pose.least_squares import cross_matrix, turned
from sldvexp.pose.uncertainty import cofactor, euler_standard_error

STEP = np.full(2, np.radians(25) / 4096)
REPEATS = 4000

#: The 16 bitangent points of Figure 4.28, x and y in inch.
BITANGENT_POINTS = [
    [2.3490, 3.2156],
    [2.1653, 2.4277],
    [7.5578, 2.0048],
    [7.3725, 1.2100],
    [7.0696, 1.7066],
    [7.8611, 1.5078],
    [9.1017, 9.8073],
    [9.8976, 9.6075],
    [9.5079, 9.2973],
    [9.4905, 10.1177],
    [1.5890, 9.1396],
    [1.5721, 9.9408],
    [1.9797, 9.5806],
    [1.1823, 9.5003],
    [2.6598, 2.8623],
    [1.8549, 2.7813],
]
OBJECT = np.column_stack([np.multiply(BITANGENT_POINTS, 0.0254), np.zeros(16)])

# The object's z axis points to the instrument, 1.7 m away; 30 deg of tilt, some roll.
ROTATION = (
    rotation_from_vector(np.radians([30.0, 0.0, 0.0]))
    @ np.diag([1.0, -1.0, -1.0])
    @ rotation_from_vector([0.0, 0.0, 0.4])
)
ORIGIN = OBJECT.mean(axis=0) - ROTATION.T @ np.array([0.05, 0.1, 1.7])
OFFSET = 0.045
EXACT = project((OBJECT - ORIGIN) @ ROTATION.T, OFFSET)


def solve(angles: np.ndarray, **options: object) -> PoseSolution:
    return solve_points(OBJECT, angles, step=STEP, mirror_offset=OFFSET, **options)


@pytest.fixture(scope="module")
def repeats() -> PoseSolution:
    noise = np.random.default_rng(4000).normal(size=(REPEATS, 16, 2))
    return solve(EXACT + noise * STEP)


@pytest.fixture(scope="module")
def errors(repeats: PoseSolution) -> np.ndarray:
    """Of the six parameters, (repeats, 6): true values less estimates."""
    vector = vector_from_rotation(ROTATION @ repeats.rotation.swapaxes(1, 2))
    return np.column_stack([vector, ORIGIN - repeats.origin])


@pytest.fixture(scope="module")
def bound() -> PoseSolution:
    """The pose of exact angles with the true noise: its covariance is the Cramer-Rao bound."""
    return solve(EXACT, std=1.0)


def test_estimates_scatter_as_the_cramer_rao_bound_says(
    repeats: PoseSolution, errors: np.ndarray, bound: PoseSolution
) -> None:
    assert repeats.converged.all()
    ratio = errors.std(axis=0, ddof=1) / standard_error(bound.covariance)
    # A standard deviation of 4,000 repeats is known to 1.1 %.
    assert ((ratio > 0.95) & (ratio < 1.05)).all(), ratio
    bias = errors.mean(axis=0) / standard_error(bound.covariance) * math.sqrt(REPEATS)
    assert (np.abs(bias) < 4).all(), bias


def test_correlations_are_those_of_the_bound(errors: np.ndarray, bound: PoseSolution) -> None:
    error = standard_error(bound.covariance)
    expected = bound.covariance / np.outer(error, error)
    # The standard error of a correlation r is (1 - r^2) / sqrt(repeats).
    limit = 5 * (1 - expected**2) / math.sqrt(REPEATS) + 1e-9
    assert (np.abs(np.corrcoef(errors.T) - expected) < limit).all()


def test_intervals_cover_as_often_as_they_say(repeats: PoseSolution, errors: np.ndarray) -> None:
    for confidence, low, high in [(0.95, 0.935, 0.965), (0.5, 0.46, 0.54)]:
        inside = np.abs(errors) <= half_width(
            standard_error(repeats.covariance), repeats.covariance_dof, confidence
        )
        cover = inside.mean(axis=0)
        assert ((cover > low) & (cover < high)).all(), cover


def test_euler_angles_have_bounds_of_their_own(repeats: PoseSolution, bound: PoseSolution) -> None:
    error = euler_from_rotation(repeats.rotation) - euler_from_rotation(ROTATION)
    ratio = error.std(axis=0, ddof=1) / euler_standard_error(bound.rotation, bound.covariance)
    assert ((ratio > 0.95) & (ratio < 1.05)).all(), ratio
    inside = np.abs(error) <= half_width(
        euler_standard_error(repeats.rotation, repeats.covariance), repeats.covariance_dof, 0.95
    )
    assert ((inside.mean(axis=0) > 0.935) & (inside.mean(axis=0) < 0.965)).all()


def test_the_estimated_noise_is_the_noise(repeats: PoseSolution) -> None:
    assert (repeats.dof == 26).all()
    # The mean of 4,000 variances with 26 degrees of freedom, 4 standard errors.
    assert np.mean(repeats.s**2) == pytest.approx(1, abs=4 * math.sqrt(2 / 26 / REPEATS))


def test_euler_angles_are_unknown_where_they_are_not_determined() -> None:
    in_front = solve_points(
        OBJECT,
        project((OBJECT - [0.1, 0.1, -1.0]) @ np.eye(3), 0.0),
        step=STEP,
        std=1.0,
    )
    assert np.isinf(euler_standard_error(in_front.rotation, in_front.covariance)).all()
    assert np.isfinite(standard_error(in_front.covariance)).all()


def test_factors_of_intervals() -> None:
    error = np.ones((3, 2))
    few = SimpleNamespace(covariance_dof=np.array([26.0, np.inf, 0.0]))
    width = half_width(error, few.covariance_dof, 0.95)
    np.testing.assert_allclose(width[:, 0], [2.0555, 1.9600, np.inf], atol=1e-4)


def test_bounds_are_infinite_if_the_covariance_is() -> None:
    three = solve_points(OBJECT[:3], EXACT[:3], step=STEP)
    assert np.isinf(standard_error(three.covariance)).all()
    assert np.isinf(euler_standard_error(three.rotation, three.covariance)).all()
    assert np.isinf(half_width(standard_error(three.covariance), three.covariance_dof, 0.95)).all()


def test_a_singular_information_matrix_names_its_direction() -> None:
    root = np.random.default_rng(1).normal(size=(2, 4, 9)) * np.array([1, 10, 100, 1e3])[:, None]
    root[1, 3] = 7 * root[1, 0]
    information = root @ root.swapaxes(1, 2)
    inverse, share = cofactor(information)
    np.testing.assert_allclose(inverse[0] @ information[0], np.eye(4), atol=1e-9)
    assert not share[0].any()
    np.testing.assert_allclose(share[1], [math.sqrt(0.5), 0, 0, math.sqrt(0.5)], atol=1e-7)


def test_the_retraction_is_a_rotation_by_the_vector() -> None:
    rng = np.random.default_rng(2)
    vector = rng.normal(size=(20, 3))
    rotation = rotation_from_vector(rng.normal(size=(20, 3)))
    moved = turned(rotation, vector)
    np.testing.assert_allclose(
        moved @ moved.swapaxes(1, 2), np.tile(np.eye(3), (20, 1, 1)), atol=1e-14
    )
    np.testing.assert_allclose(np.linalg.det(moved), 1.0)
    small = turned(rotation, 1e-4 * vector)
    np.testing.assert_allclose(small, rotation_from_vector(1e-4 * vector) @ rotation, atol=1e-11)
    a, b = rng.normal(size=(2, 3))
    np.testing.assert_allclose(cross_matrix(a) @ b, np.cross(a, b))
