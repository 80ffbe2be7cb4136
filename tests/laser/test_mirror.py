"""DAC steps to angles and back, saturation, and calibrations that are refused."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from omegaconf import OmegaConf

from sldvexp.errors import ConfigError, UserError
from sldvexp.laser import (
    Board,
    Mirror,
    TwoMirror,
    direction_cosines,
    project,
    project_with_directions,
)
from sldvexp.pose.rough_pose import predicted_steps
from sldvexp.session.outline import _dac as outline_steps
from sldvexp.units import AngleUnit
from tests.composing import part


def test_points_are_projected_with_their_directions() -> None:
    """As by the angles, before the mirrors, behind them and on their axes."""
    p = np.random.default_rng(3).normal(size=(50, 3))
    p[:3] = [[0, 0, 0], [0.3, 0, 0], [-0.1, 0, 2]]
    for offset in (0.0, 0.045):
        angles, directions = project_with_directions(p, offset)
        np.testing.assert_allclose(angles, project(p, offset), atol=1e-15)
        np.testing.assert_allclose(directions, direction_cosines(angles), atol=2e-15)


def test_a_straight_line_needs_no_search() -> None:
    straight, bent = (
        TwoMirror(up_down=Mirror(24, 0.3, few), left_right=Mirror(-23, -0.2, few))
        for few in ([], [0.0])
    )
    low, high = straight.reach
    angle = low + np.random.default_rng(4).random((200, 2)) * (high - low)
    steps = straight.dac_from_angle(angle)
    np.testing.assert_allclose(steps, bent.dac_from_angle(angle), rtol=1e-13, atol=1e-11)
    np.testing.assert_allclose(straight.angle_from_dac(steps), angle, atol=1e-15)


@st.composite
def mirrors(draw):
    """Monotonic calibrations: the slope gain + 2 a u + 3 b u^2 keeps its sign for |u| <= 1."""
    gain = draw(st.floats(1, 40)) * draw(st.sampled_from([-1, 1]))
    a, b = (draw(st.floats(-1, 1)) for _ in range(2))
    zero, bend = draw(st.floats(-5, 5)), draw(st.floats(0, 0.19))
    return Mirror(gain, zero, [bend * gain * a, bend * gain * b])


@pytest.mark.whole
@given(mirrors(), mirrors(), st.sampled_from(Board), st.integers(0, 2**32 - 1))
def test_there_and_back(up_down, left_right, board, seed):
    laser = TwoMirror(board=board, up_down=up_down, left_right=left_right)
    low, high = board.value
    dac = np.random.default_rng(seed).uniform(low, high, (50, 2))
    dac[0], dac[1], dac[2] = low, high, 0
    back = laser.dac_from_angle(laser.angle_from_dac(dac))
    # An angle of 45 deg rounds at 1e-16 rad; divided by the least slope, 0.05 gain, that is 1e-13.
    assert np.abs(back - dac).max() <= 1e-12 * high


@pytest.mark.whole
@given(mirrors(), st.sampled_from(Board))
def test_whole_steps_come_back_whole(mirror, board):
    laser = TwoMirror(board=board, up_down=mirror, left_right=mirror)
    dac = np.array([[board.value[0], 17], [-1023, board.value[1]]])
    np.testing.assert_array_equal(np.rint(laser.dac_from_angle(laser.angle_from_dac(dac))), dac)


@pytest.mark.parametrize(("name", "steps"), [("ometron", 4096), ("ometron_16bit", 32767)])
def test_configured_lasers(name, steps):
    laser = OmegaConf.to_object(part(f"+laser={name}"))["laser"]
    np.testing.assert_allclose(laser.angle_from_dac([steps, steps]), np.radians(25))
    # Figure 4.29 prints one deviation as 0.0055 deg and as 0.9039 of the 12-bit board's steps.
    printed = 0.0055 / 0.9039 * 4096 / steps
    np.testing.assert_allclose(np.degrees(laser.step), printed, rtol=0.00005 / 0.0055)


@pytest.mark.parametrize(("board", "high"), [(Board.bits_12_sign, 4096), (Board.bits_16, 32767)])
def test_linear_calibration(board, high):
    laser = TwoMirror(board=board, left_right=Mirror(gain=-20, zero=1))
    angle = np.degrees(laser.angle_from_dac([[high, high], [0, 0], [high / 2, high / 4]]))
    np.testing.assert_allclose(angle, [[25, -19], [0, 1], [12.5, -4]], atol=1e-12)
    np.testing.assert_allclose(laser.step, np.radians([25, 20]) / high)


def test_polynomial_in_radians():
    mirror = Mirror(gain=0.4, zero=0.01, polynomial=[0.02, -0.03], unit=AngleUnit.rad)
    laser = TwoMirror(up_down=mirror)
    u = 0.5
    expected = 0.01 + 0.4 * u + 0.02 * u**2 - 0.03 * u**3
    assert laser.angle_from_dac([2048, 0])[0] == pytest.approx(expected, rel=1e-15)


@pytest.mark.parametrize(
    ("polynomial", "low", "high"),
    [
        ([0, 25], -25, 25),  # almost flat in the middle: Newton's steps are slow there
        ([0, 20, -30, 12], -62, 2.05),  # flat, steep, flat: Newton alone leaves the range
    ],
)
def test_hard_calibrations_converge_to_the_last_bits(polynomial, low, high):
    laser = TwoMirror(up_down=Mirror(gain=0.05, polynomial=polynomial))
    angle = np.radians(np.column_stack([np.linspace(low, high, 501), np.zeros(501)]))
    back = laser.angle_from_dac(laser.dac_from_angle(angle))
    np.testing.assert_allclose(back, angle, rtol=0, atol=1e-15)


@pytest.mark.parametrize("board", Board)
def test_leading_dimensions_and_limits(board):
    laser = TwoMirror(board=board)
    low, high = board.value
    dac = np.zeros((3, 4, 2))
    dac[1, 2] = low, high
    angle = laser.angle_from_dac(dac)
    assert angle.shape == dac.shape
    # A limit that a conversion of units has rounded still passes, and does not leave the board.
    back = laser.dac_from_angle(np.radians(np.degrees(angle)) * (1 + 4e-16))
    assert back.min() == low
    assert back.max() == high


def numbered(message, call, *arguments):
    with pytest.raises(UserError) as error:
        call(*arguments)
    assert str(error.value) == message


ADVICE = "; move the instrument or check the calibration of the laser"


@pytest.mark.parametrize(
    ("angle", "labels", "message"),
    [
        (
            [[0, 0], [0, 26]],
            [7, 9],
            "point 9: the left_right angle of 26 deg is not within the mirror's range of "
            "-25 to 25 deg",
        ),
        (
            [[0, 0], [-25.01, 0]],
            None,
            "point 1: the up_down angle of -25.01 deg is not within the mirror's range of "
            "-25 to 25 deg",
        ),
        (
            [[np.nan, 0]],
            ["3 of view east"],
            "point 3 of view east: the up_down angle of nan deg is not within the mirror's range "
            "of -25 to 25 deg",
        ),
    ],
)
def test_saturated_angles(angle, labels, message):
    numbered(message + ADVICE, TwoMirror().dac_from_angle, np.radians(angle), labels)


@pytest.mark.parametrize(
    ("board", "dac", "message"),
    [
        (
            Board.bits_12_sign,
            [[0, 0], [0, 4097]],
            "point b: the left_right DAC step 4097 is not within the mirror's range of "
            "-4096 to 4096",
        ),
        (
            Board.bits_16,
            [[-32769, 0], [0, 0]],
            "point a: the up_down DAC step -32769 is not within the mirror's range of "
            "-32768 to 32767",
        ),
        (
            Board.bits_16,
            [[0, np.inf], [0, 0]],
            "point a: the left_right DAC step inf is not within the mirror's range of "
            "-32768 to 32767",
        ),
    ],
)
def test_saturated_steps(board, dac, message):
    numbered(message + ADVICE, TwoMirror(board=board).angle_from_dac, dac, ["a", "b"])


def test_points_of_views_are_named_by_both():
    angle = np.zeros((2, 3, 2))
    angle[1, 2, 0] = 1
    with pytest.raises(UserError, match="point 1, 2: the up_down angle of 57"):
        TwoMirror().dac_from_angle(angle)


@pytest.mark.parametrize(
    ("mirror", "message"),
    [
        ({"gain": 0}, "left_right.gain: must not be zero: the mirror would not move"),
        ({"gain": float("nan")}, "left_right.gain: must be finite, not nan"),
        ({"polynomial": [float("inf")]}, "left_right.polynomial: must be finite, not inf"),
        (
            {"polynomial": [20.0]},
            "left_right.polynomial: the angle must grow or shrink over the whole range of the "
            "board, but turns back at step -4096",
        ),
        (
            {"polynomial": [0.0, -10.0]},
            "left_right.polynomial: the angle must grow or shrink over the whole range of the "
            "board, but turns back at step -4096",
        ),
        (
            {"unit": AngleUnit.rad},
            "left_right.gain: full scale reaches 1432.39 deg; a mirror stays below 90 deg "
            "(unit is rad)",
        ),
    ],
)
def test_refused_calibrations(mirror, message):
    with pytest.raises(ConfigError) as error:
        TwoMirror(left_right=Mirror(**mirror))
    assert str(error.value) == message


def test_turning_point_inside_the_range_is_found():
    # The slope 21 (u + 0.991)(u + 0.961) is negative between its roots only.
    with pytest.raises(ConfigError, match="turns back at step -4055"):
        TwoMirror(up_down=Mirror(gain=19.999371, polynomial=[20.496, 7]))


def test_problems_of_both_mirrors_are_told_at_once():
    with pytest.raises(ConfigError) as error:
        TwoMirror(mirror_offset=-1, up_down=Mirror(gain=0), left_right=Mirror(gain=100))
    fields = [problem.field for problem in error.value.problems]
    assert fields == ["mirror_offset", "up_down.gain", "left_right.gain"]


def test_deviations_are_one_stated_error_each():
    mirror = Mirror(25, 1.0, [0.5, 0.2], gain_std=0.1, polynomial_std=[0.0, 0.01])
    (more, less), (bent, straight) = mirror.deviations(straight=True)
    assert (more.gain, less.gain) == (25.1, 24.9)
    assert bent.polynomial == pytest.approx([0.5, 0.21])
    assert straight.polynomial == pytest.approx([0.5, 0.19])
    assert len(list(mirror.deviations(straight=False))) == 1
    assert list(Mirror().deviations(straight=True)) == []


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"gain_std": -1.0}, "gain_std"),
        ({"polynomial_std": [0.1]}, "must have as many numbers as polynomial, 0, or none, not 1"),
    ],
)
def test_stated_errors_that_cannot_be_are_refused(given, message):
    with pytest.raises(ConfigError, match=message):
        TwoMirror(up_down=Mirror(25, **given))


def test_all_who_ask_what_the_mirrors_reach_get_the_same_ends():
    """The ends of the board are within reach, and what rounding puts beyond them."""
    laser = TwoMirror(board=Board.bits_16)
    low, high = laser.reach
    ends = np.array([low, high, np.nextafter(low, -1), np.nextafter(high, 1)])
    beyond = np.array([np.add(low, [0, -1e-9]), np.add(high, [1e-9, 0]), [np.nan, 0.0]])
    angles = np.concatenate([ends, beyond])
    reached = [True] * 4 + [False] * 3
    assert laser.reaches(angles).tolist() == reached
    within = laser.steps_within(angles, laser.reach)
    assert np.isfinite(within).all(axis=1).tolist() == reached
    np.testing.assert_array_equal(within[:2], laser.dac_from_angle(ends)[:2])
    np.testing.assert_allclose(laser.dac_from_angle(ends)[:2], [[-32768] * 2, [32767] * 2])
    for angle in beyond:
        with pytest.raises(UserError):
            laser.dac_from_angle(angle)
    covariance = np.zeros((len(angles), 2, 2))
    pose = SimpleNamespace(angles=lambda *_: (angles, covariance), probability=1.0)
    steps, _ = predicted_steps([pose], np.zeros((len(angles), 3)), laser)
    assert np.isfinite(steps).all(axis=1).tolist() == reached
    dac, _ = outline_steps(angles[:-1] / laser.step, np.ones((len(angles) - 1, 2)), laser)
    assert len(dac) == sum(reached)


def test_steps_beyond_the_board_are_told_with_their_side():
    laser = TwoMirror(left_right=Mirror(-25.0))
    angle = laser.angle_from_dac([[4096, -4096]]) + laser.step * [3.0, 5.0]
    np.testing.assert_allclose(laser.steps_beyond(angle), [[3, 5]], atol=1e-9)
    assert laser.steps_beyond(laser.angle_from_dac([[-4096, 100]])).tolist() == [[0, 0]]
