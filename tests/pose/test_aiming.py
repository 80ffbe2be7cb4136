"""Marks while they are taken: where the next ones lie, how well that is known, which is wrong."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sldvexp.errors import UserError
from sldvexp.geometry import KnownPose, euler_from_rotation, rotation_from_vector, rotation_towards
from sldvexp.laser import Mirror, TwoMirror
from sldvexp.pose import Aiming, AimingPlace
from sldvexp.targets import Circle, Circles
from sldvexp.units import AngleUnit
from sldvexp.virtual_lab import VirtualLab
from sldvexp.virtual_lab.calibration_scene import CalibrationScene

LASER = TwoMirror(mirror_offset=0.03)
#: Corners of a plate, two marks on posts before it, and two more in its plane; m.
PLACES = np.array([[0, 0, 0], [0.3, 0, 0], [0.3, 0.3, 0], [0, 0.3, 0],
                   [0.1, 0.1, 0.06], [0.2, 0.2, 0.06], [0.05, 0.2, 0], [0.25, 0.1, 0]])  # fmt: skip
#: Circles that the virtual lab wants to have; nobody aims at them here.
OBJECT = Circles(circles={k: Circle(0.1 * k, 0.1 * k * k, 0.02) for k in (1, 2, 3)})
NAMES = [f"mark {k}" for k in range(1, len(PLACES) + 1)]


class View:
    """A virtual lab that stands anywhere in front of the places, rolled by some degrees."""

    def __init__(self, rng, laser=LASER, places=PLACES, std=0.0, roll=3.0):
        self.rng, self.laser, self.std = rng, laser, std
        origin = rng.uniform([-0.7, -0.5, 1.2], [1.0, 0.8, 2.0])
        turn = rotation_from_vector([0, 0, np.radians(roll) * rng.standard_normal()])
        rotation = turn @ rotation_towards(origin, [0.15, 0.15, 0.0])
        pose = KnownPose(euler_from_rotation(rotation).tolist(), origin.tolist())
        self.origin = origin
        self.lab = VirtualLab(CalibrationScene(views={"a": pose}), laser, OBJECT, 0)
        self.true = self.lab.true_dac(places)
        self.known = places + std * rng.standard_normal(places.shape)

    def aiming(self, marks=(), steps=None):
        """Take some marks by the eye's error, and whole steps."""
        every = [
            AimingPlace(name, p, np.full(3, self.std))
            for name, p in zip(NAMES, self.known, strict=True)
        ]
        aiming = Aiming(self.laser, every)
        steps = self.seen() if steps is None else steps
        for k in marks:
            aiming.take(NAMES[k], steps[k])
        return aiming

    def seen(self):
        """Steps of all marks by a person whose eye errs by one step, rounding with it."""
        return np.rint(self.true + 0.957 * self.rng.standard_normal(self.true.shape))


def views(seed, count, **how):
    rng = np.random.default_rng(seed)
    return [View(rng, **how) for _ in range(count)]


def test_a_mark_that_repeats_its_prediction_changes_nothing_but_what_is_open():
    (view,) = views(7, 1)
    aiming = view.aiming([0, 1, 2, 4], view.seen())
    before = aiming.poses[0], aiming.residual("mark 1").std, aiming.predict("mark 6").dac
    predicted = aiming.predict("mark 4").steps
    aiming.take("mark 4", predicted, unmoved=True)
    assert (aiming.unmoved, "mark 4" in aiming.open) == (["mark 4"], False)
    assert aiming.poses[0].cost == before[0].cost
    np.testing.assert_array_equal(aiming.poses[0].covariance, before[0].covariance)
    np.testing.assert_array_equal(aiming.residual("mark 1").std, before[1])
    np.testing.assert_array_equal(aiming.predict("mark 6").dac, before[2])
    aiming.take("mark 4", predicted)  # by hand
    assert aiming.unmoved == []
    assert (aiming.residual("mark 1").std < before[1]).all()
    assert (aiming.undo(), aiming.unmoved) == ("mark 4", ["mark 4"])
    assert (aiming.undo(), aiming.unmoved) == ("mark 4", [])


def require_unit_variance(z):
    """Deviations over their standard deviations, one a trial, have a mean square of one."""
    z = np.asarray(z)
    assert np.mean(z**2) == pytest.approx(1, abs=4 * np.sqrt(2 / len(z)))
    assert np.mean(z) == pytest.approx(0, abs=4 / np.sqrt(len(z)))


@pytest.mark.one_in(12)
@pytest.mark.parametrize("trials", [20, 60])
@pytest.mark.parametrize("count", [4, 5, 7])
@pytest.mark.parametrize("std", [0.0, 0.0006])
def test_predictions_err_as_much_as_they_say(count, std, trials):
    z = []
    for view in views(7 * count, trials, std=std):
        place = view.aiming(range(count)).predict("mark 8")
        z.append((place.dac - view.true[7]) / place.std)
    require_unit_variance(np.array(z)[:, 0])
    require_unit_variance(np.array(z)[:, 1])


@pytest.mark.whole
def test_three_marks_tell_poses_of_which_one_is_right():
    """Up to four fit; bounds reach to the others, and the likeliest is right in most views."""
    right, within, close = 0, 0, 0
    for view in views(3, 80):
        aiming = view.aiming([0, 1, 2])
        place = aiming.predict("mark 4")
        within += np.all(np.abs(place.dac - view.true[3]) < 3 * place.std)
        right += np.linalg.norm(aiming.pose.origin - view.origin) < 0.2
        off = [np.abs(steps - view.true[3]).max() for steps in (place.dac, *place.others)]
        close += min(off) < 25
    assert within >= 76
    assert right >= 48
    assert close >= 76


@pytest.mark.whole
def test_residuals_of_right_marks_err_as_much_as_they_say():
    z = []
    for view in views(11, 60):
        found = view.aiming(range(6)).residual("mark 3")
        z.append(found.steps / found.std)
    require_unit_variance(np.array(z)[:, 0])
    require_unit_variance(np.array(z)[:, 1])


@pytest.mark.whole
def test_three_marks_leave_no_pose_out():
    """The right one is always among those that fit, however the instrument is turned."""
    rng = np.random.default_rng(5)
    for view in views(8, 150, roll=60):
        marks = rng.choice(8, 3, replace=False)
        found = view.aiming(marks, np.rint(view.true)).poses
        assert min(np.linalg.norm(pose.origin - view.origin) for pose in found) < 0.3


@pytest.mark.whole
def test_right_marks_seldom_contradict():
    told = [view.aiming(range(n)).contradiction() for n in (4, 5, 8) for view in views(n, 30)]
    rough = [view.aiming(range(6)).contradiction() for view in views(13, 30, std=0.001)]
    assert sum(map(bool, told + rough)) <= 2


def test_poses_of_the_same_marks_are_found_once_and_of_others_anew():
    view = views(25, 1)[0]
    steps = view.seen()
    one, other = (view.aiming(range(5), steps).pose for _ in range(2))
    assert one is other
    assert view.aiming(range(4), steps).pose is not one
    steps[2] += [1, 0]
    assert view.aiming(range(5), steps).pose is not one


def test_a_wrong_mark_names_itself():
    for count in (5, 6, 8):
        for view in views(20 + count, 1):
            steps = view.seen()
            steps[2] += [25, -30]
            aiming = view.aiming(range(count), steps)
            assert aiming.residual("mark 3").beside
            assert aiming.contradiction().startswith("mark 3 lies ")
            assert aiming.contradiction().endswith(" where the others put it: take it again")
            np.testing.assert_allclose(aiming.residual("mark 3").steps, [25, -30], atol=15)


@pytest.mark.whole
def test_exchanged_marks_are_named():
    for count in (5, 6, 8):
        for view in views(30 + count, 5):
            steps = view.seen()
            steps[[1, 4]] = steps[[4, 1]]
            told = view.aiming(range(count), steps).contradiction()
            assert told.startswith("marks 2 and 5 seem to be exchanged"), told


def test_four_marks_cannot_tell_which_is_wrong():
    steps = (view := views(41, 1)[0]).seen()
    steps[2] += [25, -30]
    aiming = view.aiming(range(4), steps)
    told = aiming.contradiction()
    assert told.endswith(": mark 1, 2, 3 or 4 is wrong, and one more tells which")
    for name in aiming.open:
        aiming.hide(name)
    assert aiming.contradiction() == told.replace(", and one more tells which", ": take them again")


def test_marks_in_a_plane_are_seen_from_behind_when_two_are_exchanged():
    steps = (view := views(42, 1)[0]).seen()
    steps[[1, 3]] = steps[[3, 1]]
    told = view.aiming(range(4), steps).contradiction()
    assert told.startswith("marks 1, 2, 3 and 4 are seen from behind")


@pytest.mark.whole
def test_invented_places_contradict():
    rng = np.random.default_rng(43)
    for _ in range(20):
        aiming = View(rng).aiming(range(5), rng.integers(-1500, 1500, (8, 2)))
        assert aiming.contradiction()


def test_one_place_is_not_two_marks():
    view = views(44, 1)[0]
    steps = view.seen()
    steps[1] = steps[0] + 1
    told = view.aiming([0, 1], steps).contradiction()
    assert told.startswith("mark 1 and mark 2 were taken at the same place, ")


def test_a_weak_pose_is_told():
    view = views(45, 1)[0]
    line = np.array([[0, 0, 0], [0.1, 0, 0], [0.3, 0, 0], [0.2, 0.2, 0], *PLACES[4:]])
    view = View(view.rng, places=line)
    told = view.aiming([0, 1, 2]).weakness()
    assert told == (
        "marks 1, 2 and 3 lie in a line, which leaves the pose open: take one beside it"
    )
    assert "fit 2 poses, at " in view.aiming([0, 1, 3]).weakness()
    assert view.aiming([0, 1]).weakness() == view.aiming(range(6)).weakness() == ""
    narrow = views(45, 1, places=PLACES * [1.0, 0.045, 0.0])[0]
    told = "lie in one plane and leave the instrument's place uncertain by "
    assert told in narrow.aiming(range(8)).weakness()


BEYOND = r"behind the instrument|\d+ steps .* deg\) beyond the .* mirror's reach.*"


def test_nothing_is_predicted_too_early_or_out_of_reach():
    view = views(46, 1)[0]
    with pytest.raises(UserError, match=r"three marks that are not in a line tell .*; 1 is taken"):
        view.aiming([0]).predict("mark 5")
    aiming = view.aiming(range(5))
    assert view.aiming(range(3)).residual("mark 1") is None
    aiming.places["corner 9"] = AimingPlace("corner 9", np.array([30.0, 0.0, 0.0]))
    aiming.places["corner 10"] = AimingPlace("corner 10", view.origin * [1, 1, 3])
    for name in ("corner 9", "corner 10"):
        with pytest.raises(UserError, match=f"{name} is ({BEYOND}), as far as is known"):
            aiming.predict(name)
    with pytest.raises(UserError, match="there is no place mrak 3; did you mean mark 3"):
        aiming.take("mrak 3", (0, 0))
    with pytest.raises(UserError, match="point mark 6: the up_down DAC step 5000 is not within"):
        aiming.take("mark 6", (5000, 0))
    dac, std = aiming.steps_at(np.array([[30.0, 0, 0], PLACES[7]]))
    np.testing.assert_array_equal(np.isnan(dac), [[True, True], [False, False]])
    np.testing.assert_allclose(dac[1], aiming.predict("mark 8").dac)
    assert np.all(std[1] < 5)
    assert np.isnan(view.aiming([0]).steps_at(PLACES)[0]).all()


def test_a_prediction_does_not_depend_on_the_order_of_the_marks():
    view = views(47, 1)[0]
    steps = view.seen()
    one = view.aiming([0, 1, 2, 3, 5], steps).predict("mark 8")
    other = view.aiming([5, 2, 0, 3, 1], steps).predict("mark 8")
    np.testing.assert_allclose(one.dac, other.dac, atol=1e-4)
    np.testing.assert_allclose(one.std, other.std, rtol=1e-4)


def test_crooked_mirrors_and_an_instrument_on_its_head():
    """A calibration that is bent and wired the other way is what steps are predicted with."""
    deg = AngleUnit.deg
    bent = TwoMirror(
        0.02, up_down=Mirror(-25.0, 0.5, [0.8], deg), left_right=Mirror(22.0, 0.0, [0, -1.0], deg)
    )
    for view in views(48, 5, laser=bent, roll=0.0):
        place = view.aiming(range(5), np.rint(view.true)).predict("mark 8")
        np.testing.assert_allclose(place.dac, view.true[7], atol=3)
    for view in views(49, 5, roll=180.0):
        place = view.aiming(range(5), np.rint(view.true)).predict("mark 8")
        np.testing.assert_allclose(place.dac, view.true[7], atol=3)


ACTIONS = st.lists(
    st.tuples(st.sampled_from(["take", "hide", "repeat"]), st.integers(0, 7), st.integers(0, 9)),
    max_size=12,
)


@settings(max_examples=60)
@given(actions=ACTIONS)
def test_everything_can_be_undone(actions):
    """Undoing all gives what was before each, by name."""
    aiming = Aiming(LASER, [AimingPlace(n, p) for n, p in zip(NAMES, PLACES, strict=True)])
    states = []
    for action, mark, step in actions:
        before = (aiming.taken, aiming.hidden, aiming.open)
        if action == "take":
            aiming.take(NAMES[mark], (100 * mark, step))
        elif action == "hide":
            aiming.hide(NAMES[mark])
        else:
            said = NAMES[mark] not in aiming.open
            assert aiming.repeat(NAMES[mark]) == before[0].get(NAMES[mark])
            if not said:
                continue
        assert sorted([*aiming.taken, *aiming.hidden, *aiming.open]) == NAMES
        states.append((NAMES[mark], before))
    for name, before in reversed(states):
        assert aiming.undo() == name
        assert (aiming.taken, aiming.hidden, aiming.open) == before
    assert aiming.undo() is None
