"""Points of the world in DAC steps, and rough poses that found points correct."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.geometry import KnownPose, rotation_from_vector, vector_from_rotation
from sldvexp.laser import (
    Board,
    Mirror,
    TwoMirror,
    beyond_told,
    corrected_pose,
    dac_jacobian,
    dac_of_points,
)
from sldvexp.laser.aiming import ROUGH

POSE = KnownPose(origin=[0.9, 0.5, 1.5], look_at=[0.1, 0.1, 0.0], roll=0.05)
LASERS = {
    "plain": TwoMirror(),
    "bent": TwoMirror(
        mirror_offset=0.045,
        board=Board.bits_16,
        up_down=Mirror(gain=-20.0, zero=0.5, polynomial=[0.3, 0.8]),
        left_right=Mirror(gain=22.0, polynomial=[-0.4]),
    ),
}
POINTS = np.array([[0.05, 0.07, 0.0], [0.19, 0.04, 0.0], [0.24, 0.25, 0.01], [0.04, 0.24, 0.0]])
NAMES = [f"circle {k}" for k in range(1, 5)]


def steps(rotation, origin, laser, points=POINTS):
    return dac_of_points(points, rotation, origin, laser, [f"p{i}" for i in range(len(points))])


@pytest.mark.parametrize("laser", LASERS.values(), ids=LASERS)
def test_derivatives_are_those_of_the_steps(laser):
    rotation, origin = POSE.rotation, POSE.place
    found = dac_jacobian(POINTS, rotation, origin, laser)
    h = 1e-6
    for k in range(3):
        turn = rotation_from_vector(h * np.eye(3)[k])
        by_turn = (
            steps(turn @ rotation, origin, laser) - steps(turn.T @ rotation, origin, laser)
        ) / (2 * h)
        shift = h * np.eye(3)[k]
        by_shift = (
            steps(rotation, origin + shift, laser) - steps(rotation, origin - shift, laser)
        ) / (2 * h)
        scale = np.abs(found).max()
        np.testing.assert_allclose(found[..., k], by_turn, atol=1e-5 * scale)
        np.testing.assert_allclose(found[..., 3 + k], by_shift, atol=1e-5 * scale)


@pytest.mark.parametrize("laser", LASERS.values(), ids=LASERS)
def test_found_points_correct_a_pose_that_is_wrong_by_degrees_and_centimetres(laser):
    rng = np.random.default_rng(1)
    rough = rotation_from_vector(ROUGH[:3] * rng.standard_normal(3)) @ POSE.rotation
    place = POSE.place + ROUGH[3:] * rng.standard_normal(3)
    true = steps(POSE.rotation, POSE.place, laser)
    before = np.abs(steps(rough, place, laser) - true).max()
    rotation, origin = corrected_pose(POINTS, true, rough, place, laser, NAMES)
    assert before > 100
    assert np.abs(steps(rotation, origin, laser) - true).max() < 3
    assert np.linalg.norm(origin - POSE.place) < 0.3 * np.linalg.norm(place - POSE.place)
    turned = np.linalg.norm(vector_from_rotation(rotation @ POSE.rotation.T))
    assert turned < 0.3 * np.linalg.norm(vector_from_rotation(rough @ POSE.rotation.T))


def test_one_point_shifts_a_rough_pose_as_far_as_needed_and_no_other_point_gets_lost():
    laser = LASERS["plain"]
    rough = rotation_from_vector([0.0, 0.02, 0.0]) @ POSE.rotation
    true = steps(POSE.rotation, POSE.place, laser)
    rotation, origin = corrected_pose(POINTS[:1], true[:1], rough, POSE.place, laser, NAMES)
    missed = steps(rotation, origin, laser) - true
    assert np.abs(missed[0]).max() < 1
    assert np.abs(missed).max() < 0.1 * np.abs(steps(rough, POSE.place, laser) - true).max()


def test_point_that_no_correction_can_explain_is_named():
    behind = np.array([[0.0, 0.0, 2.0], [0.0, 0.1, -2.0]])
    pose = np.eye(3), np.zeros(3)
    with pytest.raises(UserError, match=r"^circle 7 lies behind the instrument"):
        corrected_pose(behind, np.zeros((2, 2)), *pose, TwoMirror(), ["circle 3", "circle 7"])


@pytest.mark.parametrize(
    ("point", "told"),
    [
        (
            [3.0, 3.0, 3.0],
            "^mark 2 lies behind the instrument; correct the pose of the view, or the",
        ),
        (
            [-1.5, 0.1, 0.0],
            "^mark 2 is out of reach: the left_right angle of .* deg is not within the",
        ),
    ],
)
def test_points_that_no_beam_reaches_are_named(point, told):
    with pytest.raises(UserError, match=told):
        dac_of_points(
            [POINTS[0], point], POSE.rotation, POSE.place, TwoMirror(), ["mark 1", "mark 2"]
        )


@pytest.mark.parametrize("beyond", [1e-7, 5e-7, 0.2, 3.0])
def test_what_the_mirrors_do_not_reach_is_told_to_be_beyond_them_by_however_little(beyond):
    laser = TwoMirror()
    _, high = laser.reach
    told = beyond_told(high + np.array([0.0, beyond * laser.step[1]]), laser)
    assert told.startswith(f"{max(round(beyond), 1)} step")
    assert "left-right" in told
    assert "up-down" not in told
