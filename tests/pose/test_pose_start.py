"""The closed-form start: beams as planes, the object-space form, the grid, the mirror image."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.geometry import rotation_from_vector, vector_from_rotation
from sldvexp.laser import project, rays
from sldvexp.pose.initial_pose import (
    ObjectSpaceForm,
    beam_planes,
    flipped,
    lift,
    lowest_on_grid,
    object_space_form,
    rotation_grid,
    start_poses,
)

# A close object and a large mirror offset: x appears stretched by a tenth.
OFFSET = np.array([[0.05]])
CENTRE = np.array([0.04, -0.05, 0.5])


def scene(
    depth: float, rotation: np.ndarray, centre: np.ndarray = CENTRE
) -> tuple[np.ndarray, np.ndarray]:
    """Points (1, 3, N) about their centroid and exact angles (1, 2, N)."""
    points = np.random.default_rng(7).uniform(-0.1, 0.1, (3, 12)) * [[1], [1], [depth]]
    points -= points.mean(axis=1, keepdims=True)
    angles = project((rotation @ points).T + centre, OFFSET[0, 0])
    return points[None], angles.T[None]


def test_a_beam_lies_in_both_its_planes() -> None:
    angles = np.random.default_rng(1).uniform(-0.4, 0.4, (2, 9))
    normal, distance = beam_planes(angles, OFFSET[0])
    origin, direction = rays(angles.T, OFFSET[0, 0])
    for along in (-1.0, 0.5, 2.0):
        beam = (origin + along * direction).T
        np.testing.assert_allclose(np.einsum("amn,an->mn", normal, beam), distance, atol=1e-15)
    gram = np.einsum("amn,akn->nmk", normal, normal)
    np.testing.assert_allclose(gram, np.tile(np.eye(2), (9, 1, 1)), atol=1e-15)


def test_the_form_is_the_sum_of_squared_distances_from_the_beams() -> None:
    points, angles = scene(1.0, rotation_from_vector([0.4, 0.1, 0.2]))
    form = object_space_form(points, *beam_planes(angles, OFFSET))
    origin, direction = rays(angles[0].T, OFFSET[0, 0])

    def squared_distances(rotation: np.ndarray, centre: np.ndarray) -> float:
        away = (rotation @ points[0]).T + centre - origin
        return float((np.cross(away, direction) ** 2).sum())

    rotation = rotation_from_vector([-0.3, 0.9, 2.0])
    lifted = lift(rotation[None])
    centre = form.centre(lifted)[0]
    assert form.error(lifted)[0] == pytest.approx(squared_distances(rotation, centre))
    for shift in np.vstack([np.eye(3), -np.eye(3)]) * 1e-4:
        assert squared_distances(rotation, centre + shift) > form.error(lifted)[0]


def test_no_rotation_is_far_from_the_grid() -> None:
    grid, _, _ = rotation_grid()
    wanted = rotation_from_vector(np.random.default_rng(2).normal(size=(300, 3)) * 2)
    trace = np.einsum("gij,wij->wg", grid, wanted).max(axis=1)
    assert np.degrees(np.arccos((trace - 1) / 2)).max() < 30


@pytest.mark.parametrize("depth", [0.0, 1.0])
def test_the_grid_is_searched_in_front_of_the_instrument_only(depth: float) -> None:
    points, angles = scene(depth, rotation_from_vector([0.4, 0.1, 0.2]))
    form = object_space_form(points, *beam_planes(angles, OFFSET))
    candidates = lowest_on_grid(form)[0]
    centres = ObjectSpaceForm(form.quadratic, form.translation).centre(lift(candidates))
    assert (centres[:, 2] > 0).all()


def test_the_mirror_image_shows_a_small_plane_object_in_the_same_place() -> None:
    rotation, normal = rotation_from_vector([0.6, -0.3, 1.0]), np.array([0.0, 0.0, 1.0])
    other = flipped(rotation, CENTRE, normal)
    np.testing.assert_allclose(other @ other.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(other) == pytest.approx(1)
    assert np.linalg.norm(vector_from_rotation(other @ rotation.T)) > 0.5
    points = np.random.default_rng(3).uniform(-1e-4, 1e-4, (20, 3)) * [1, 1, 0]
    seen, too = (project(points @ r.T + CENTRE) - project(CENTRE) for r in (rotation, other))
    np.testing.assert_allclose(seen, too, atol=2e-3 * np.abs(seen).max())


@pytest.mark.parametrize("depth", [0.0, 1e-3, 1.0])
def test_exact_angles_start_at_the_pose_itself(depth: float) -> None:
    for vector in np.random.default_rng(4).normal(size=(20, 3)):
        towards = rotation_from_vector(vector * [0.5, 0.5, 2.0])
        points, angles = scene(depth, towards)
        rotation, centre = start_poses(points, np.array([[0.0, 0.0, 1.0]]), angles, OFFSET)
        away = np.linalg.norm(vector_from_rotation(rotation[0] @ towards.T), axis=-1)
        assert away.min() < 0.02
        np.testing.assert_allclose(centre[0, np.argmin(away)], CENTRE, atol=2e-3)
