"""The virtual lab's person errs by what the scene says, and by nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2, kstest

from sldvexp.errors import ConfigError, UserError
from sldvexp.geometry import rigid_transform, rotation_from_euler
from sldvexp.instrument.person import Mark
from sldvexp.virtual_lab.scene import SceneOperator

#: Chance of a false alarm of one statistical test.
RARE = 1e-5
INCH = 0.0254
BOUND = INCH / 64


def marks(count, std=0.0):
    places = np.random.default_rng(1).uniform([0, 0, -0.05], [0.28, 0.28, 0.05], (count, 3))
    return [Mark(n, place, np.full(3, std)) for n, place in enumerate(places, 1)]


def aimed(lab, those):
    return np.array([lab.person.aim(mark, (0, 0)) for mark in those])


@pytest.mark.whole
def test_pointing_errs_by_its_part_of_the_spot_and_whole_steps(lab):
    made = lab("plate", "scene.operator.mark_error=false", target=None)
    those = marks(2000)
    places = np.array([m.position for m in those])
    distance = np.linalg.norm(places - made.true_pose("1")[1], axis=1)
    radius = 0.0003 * np.hypot(1, (distance - 1.7) / 0.45)
    error = aimed(made, those) - made.true_dac(places)
    expected = np.hypot(0.29 * radius[:, None] / distance[:, None] / made.mirrors.step, 12**-0.5)
    # 2000 marks; the standard error of a mean square of them is sqrt(2 / 2000) of it, or less.
    square = ((error / expected) ** 2).mean(axis=0)
    np.testing.assert_allclose(square, 1, atol=5 * np.sqrt(2 / 2000))
    np.testing.assert_allclose(error.mean(axis=0), 0, atol=5 * expected.max() / np.sqrt(2000))


def test_a_steady_hand_and_true_marks_leave_whole_steps_only(lab):
    made = lab("plate", "scene.operator={pointing: 0, mark_error: false}", target=None)
    those = marks(50, std=0.001)
    true = made.true_dac([m.position for m in those])
    np.testing.assert_array_equal(aimed(made, those), np.rint(true))
    assert made.position == tuple(np.rint(true[-1]))


def test_marks_stand_anywhere_within_their_accuracy_and_in_every_view_there(lab):
    made = lab("plate", target=None)
    those = marks(1000, std=BOUND / np.sqrt(3))
    off = np.array([made.person.true_position(m) - m.position for m in those])
    assert kstest(off.ravel() / BOUND, "uniform", args=(-1, 2)).pvalue > RARE
    made.use_view("3")
    again = np.array([made.person.true_position(m) - m.position for m in those])
    np.testing.assert_array_equal(off, again)
    other = lab("plate", target=None, seed=1).person.true_position(those[0])
    assert not np.array_equal(other, those[0].position + off[0])


def test_a_view_has_its_own_errors_which_come_back(lab):
    made = lab("plate", "scene.operator.mark_error=false", target=None)
    those = marks(30)
    error = {}
    for view in ("1", "2", "1"):
        made.use_view(view)
        found = aimed(made, those) - made.true_dac([m.position for m in those])
        if view in error:
            np.testing.assert_array_equal(found, error[view])
        error[view] = found
    assert abs(np.corrcoef(error["1"].ravel(), error["2"].ravel())[0, 1]) < 0.6


def test_the_digitizer_measures_the_spot(lab):
    made = lab("plate", target=None)
    made.move((100, -700))
    spot = made.spot()
    assert spot[2] == pytest.approx(0.0015)  # the plate's surface
    np.testing.assert_allclose(made.true_dac(spot), (100, -700), atol=1e-9)
    count = 3000
    error = np.array(made.person.digitise(1, count)) - spot
    low, high = chi2.ppf([RARE, 1 - RARE], count)
    square = ((error / 0.0026) ** 2).sum(axis=0)
    assert (low < square).all()
    assert (square < high).all()
    np.testing.assert_allclose(error.mean(axis=0), 0, atol=5 * 0.0026 / np.sqrt(count))
    assert made.person.digitise(1, 2) == made.person.digitise(1, 2)
    assert made.person.digitise(1, 2) != made.person.digitise(2, 2)
    made.use_view("2")
    other = np.array(made.person.digitise(1, count)) - made.spot()
    assert abs(np.corrcoef(error.ravel(), other.ravel())[0, 1]) < 5 / np.sqrt(3 * count)


def test_a_beam_beside_everything_has_no_spot(lab):
    made = lab("plate", target=None)
    made.move((4000, 4000))
    with pytest.raises(UserError, match=r"the beam at \(4000, 4000\) falls on nothing"):
        made.spot()


def test_the_digitizer_scatters_a_pose_as_the_print_says():
    """Table 4.2: seven samples of three corners and three posts, standard deviations of each."""
    printed = np.array([0.0243, 0.0214, 0.0059])
    rotation = rotation_from_euler([-1.077, 2.639, 2.018])
    origin = np.array([0.685, 0.497, 1.621])
    corners = 11 * INCH * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0]])
    posts = np.array([[0, -0.1, 0], [0.1, 0, 0], [-0.05, 0.1, -0.02]])
    rng, repeats, error = np.random.default_rng(0), 4000, SceneOperator().digitizer
    seen = posts @ rotation + origin, corners
    dug = [p + error * rng.standard_normal((repeats, 3, 3)) for p in seen]
    (to_laser, laser_shift), (to_world, world_shift) = (
        rigid_transform(d, known) for d, known in zip(dug, (posts, corners), strict=True)
    )
    turned = to_laser @ to_world.swapaxes(1, 2)
    found = world_shift - np.einsum("kji,kj->ki", turned, laser_shift)
    # Where seven samples of the simulated spread lie, 99 times of 100.
    low, high = np.sqrt(chi2.ppf([0.005, 0.995], 6) / 6)
    ratio = printed / found.std(axis=0)
    assert (low < ratio).all()
    assert (ratio < high).all()
    # All three together are known better, and decide the value.
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("key", ["pointing", "digitizer"])
def test_nobody_errs_by_less_than_nothing(lab, key):
    with pytest.raises(ConfigError, match=f"operator.{key}: must be zero or a positive number"):
        lab("plate", f"scene.operator.{key}=-1", target=None)
