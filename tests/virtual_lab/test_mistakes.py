"""Mistakes in single views, wrong targets and wrong pixels: each by itself, in its stated size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.errors import ConfigError, UserError
from sldvexp.geometry import rotation_from_vector
from sldvexp.instrument import Acquisition, Status
from sldvexp.laser import project
from sldvexp.units import LengthUnit
from sldvexp.virtual_lab.mistakes import ViewMistakes
from sldvexp.virtual_lab.modes import Mode
from sldvexp.virtual_lab.plate import Hole, Plate, VibratingPlate

#: Beside the resonance of 439 Hz, where the plate lags behind its excitation.
FREQUENCY = 443.0
#: A count of the converter in 1 V, twice averaged.
COUNTS = 1e-4
SIGMA = 4.5


def on_plate(lab):
    """Whole steps onto the plate, away from its edges."""
    along, across = np.meshgrid(np.linspace(0.04, 0.26, 6), np.linspace(0.04, 0.21, 5))
    places = np.stack([along.ravel(), across.ravel()], axis=1)
    return np.rint(lab.true_dac(lab.plate.position(places))).astype(int)


def spoiled(lab, **mistakes):
    """Make these mistakes in a lab's views, which are named by numbers; it stands in view 4."""
    lab.scene = replace(
        lab.scene, mistakes={k.strip("_"): ViewMistakes(**m) for k, m in mistakes.items()}
    )
    lab.configure(Acquisition(10000.0, 2000, (FREQUENCY,)))
    lab.use_view("4")
    return lab


@pytest.fixture
def image(quiet, phasors):
    """Velocity over reference of view 4, V per V, with mistakes; the same pixels always."""
    correct = spoiled(quiet("plate"))
    dac = on_plate(correct)

    def take(played=FREQUENCY, _2=None, **mistakes):
        lab = spoiled(quiet("plate"), _4=mistakes, _2=_2 or {})
        lab.configure(Acquisition(10000.0, 2000, (played,)))
        found = phasors(lab.scan(dac), played)
        return found[:, 0] / found[:, 1]

    return take


def test_a_lab_without_mistakes_is_the_same_to_the_bit(lab):
    plain, told = lab("plate"), spoiled(lab("plate"), _4={"gain": 2.0})
    plain.configure(Acquisition(10000.0, 2000, (FREQUENCY,)))
    for ours in (plain, told):
        ours.use_view("3")
    dac = on_plate(plain)
    assert (plain.scan(dac, stream=1).counts == told.scan(dac, stream=1).counts).all()
    told.use_view("4")
    plain.use_view("4")
    assert (plain.scan(dac, stream=1).counts != told.scan(dac, stream=1).counts).mean() > 0.4


@pytest.mark.one_in(7)
@pytest.mark.parametrize(
    ("mistakes", "recorded"),
    [
        ({"gain": 1.03}, lambda v: 1.03 * v),
        ({"sign": -1}, lambda v: -v),
        ({"conjugate": True}, np.conj),
        ({"rms": True}, lambda v: v / np.sqrt(2)),
        ({"phase": 0.17}, lambda v: v * np.exp(0.17j)),
        ({"delay": 50e-6}, lambda v: v * np.exp(-2j * np.pi * FREQUENCY * 50e-6)),
        (
            {"sign": -1, "gain": 0.5, "conjugate": True, "phase": 0.2},
            lambda v: -0.5 * np.exp(0.2j) * v.conj(),
        ),
    ],
)
def test_what_is_recorded_of_a_velocity(image, mistakes, recorded):
    right, wrong = image(), image(**mistakes)
    assert np.abs(right.imag).max() > 0.1 * np.abs(right).max()  # else nothing is conjugated
    np.testing.assert_allclose(wrong, recorded(right), atol=COUNTS)
    assert np.abs(wrong - right).max() > 20 * COUNTS


def test_a_delay_turns_every_frequency_by_its_own_angle():
    velocity = np.array([[1.0 + 1.0j, 2.0 - 1.0j]])
    frequency = np.array([100.0, 300.0])
    turned = ViewMistakes(delay=1e-3, phase=0.1).recorded(velocity, frequency)
    np.testing.assert_allclose(
        np.angle(turned / velocity), [[0.1 - 0.2 * np.pi, 0.1 - 0.6 * np.pi]], atol=1e-14
    )


@pytest.mark.whole
def test_a_view_of_another_frequency(image):
    """It says 443 Hz and shows what moves at 1.1 times that."""
    elsewhere = image(1.1 * FREQUENCY)
    np.testing.assert_allclose(image(frequency=1.1), elsewhere, atol=COUNTS)


@pytest.mark.whole
def test_a_view_of_another_field(quiet, image):
    """Without its strongest mode the others are left; twice that mode adds it again."""
    right = image()
    without = image(modes={"bending_2_1": 0.0})
    twice = image(modes={"bending_2_1": 2.0})
    assert np.abs(without).max() < 0.3 * np.abs(right).max()
    np.testing.assert_allclose(twice - right, right - without, atol=2 * COUNTS)


@pytest.mark.whole
def test_two_views_that_are_exchanged(quiet, phasors, image):
    """Each is seen from where the other one is said to stand."""
    exchanged = image(seen_from="2", _2={"seen_from": "4"})
    lab = quiet("plate")
    lab.configure(Acquisition(10000.0, 2000, (FREQUENCY,)))
    lab.use_view("4")
    dac = on_plate(lab)
    lab.use_view("2")
    found = phasors(lab.scan(dac), FREQUENCY)
    np.testing.assert_allclose(exchanged, found[:, 0] / found[:, 1], atol=COUNTS)
    assert np.abs(exchanged - image()).max() > 100 * COUNTS


def test_a_knocked_tripod_sees_the_structure_from_elsewhere(quiet, phasors):
    """The plate as from the knocked pose, the circles as from the one that was calibrated."""
    turned, moved = [0.003, -0.002, 0.001], [0.01, -0.02, 0.005]
    right, wrong = quiet("plate"), quiet("plate")
    spoiled(right)
    spoiled(wrong, _4={"turned": turned, "moved": moved})
    rotation, origin = right.true_pose("4")
    points = right.plate.position([[0.1, 0.1], [0.2, 0.05], [0.05, 0.2]])
    in_laser = (points - origin - moved) @ (rotation_from_vector(turned) @ rotation).T
    aimed = right.mirrors.dac_from_angle(project(in_laser, right.mirrors.mirror_offset))
    assert np.abs(aimed - right.true_dac(points)).min() > 5
    found = phasors(wrong.scan(np.rint(aimed).astype(int)), FREQUENCY)
    direction = origin + moved - points
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    expected = (right.plate.velocity(points, FREQUENCY) * direction).sum(1) * 100
    # Half a step is 0.1 mm of a wave of 0.3 m.
    np.testing.assert_allclose(found[:, 0] / found[:, 1], expected, atol=0.004)
    rim = np.rint(right.true_edge(1, np.linspace(0, 6, 20))).astype(int)
    assert (right.scan(rim, stream=1).counts == wrong.scan(rim, stream=1).counts).all()


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    ("view", "mistake", "told"),
    [
        ("6", {}, r"mistakes.6: the scene has no view 6; Valid: 1, 2, 3, 4, 5"),
        ("4", {"seen_from": "9"}, r"mistakes.4.seen_from: the scene has no view 9; Valid"),
        ("4", {"sign": 2}, r"mistakes.4.sign: must be 1 or -1, not 2"),
        ("4", {"gain": 0.0}, r"mistakes.4.gain: must be a positive number, not 0"),
        ("4", {"frequency": 0.0}, r"mistakes.4.frequency: must be a positive number, not 0"),
        ("4", {"delay": np.inf}, r"mistakes.4.delay: must be finite, not inf"),
        ("4", {"turned": [1.0, 2.0]}, r"mistakes.4.turned: must be three numbers, not 2"),
        ("4", {"modes": {"bending_1_3": 0.0}}, r"4.modes: the scene has no mode bending_1_3; did"),
    ],
)
def test_mistakes_that_cannot_be_made(lab, view, mistake, told):
    with pytest.raises(ConfigError, match=told) as error:
        spoiled(lab("plate"), **{view: mistake})
    assert len(error.value.problems) == 1


def test_circles_have_no_modes(lab):
    with pytest.raises(ConfigError, match="the scene has no mode bending_1_1; there are none"):
        spoiled(lab("calibration"), _1={"modes": {"bending_1_1": 0.0}})


def test_velocities_that_speckle_makes_random_ones(quiet, phasors):
    """As many as stated, of the stated size, at every frequency; nothing in the status."""
    share, size, tones = 0.05, 0.02, (450.0, 700.0)
    settings = [
        f"scene.vibrometer.unflagged={share}",
        f"scene.vibrometer.unflagged_velocity={size}",
    ]
    lab, right = quiet("calibration", *settings), quiet("calibration")
    dac = np.stack([np.full(2000, 3000), np.arange(2000)], axis=1)  # beside the object: at rest
    for ours in (lab, right):
        ours.configure(Acquisition(5000.0, 100, tones))
    s = lab.scan(dac)
    assert (s.status == Status.good).all()
    velocity = phasors(s, *tones)[:, 0] / 100
    wrong = np.abs(velocity[:, 0]) > 1e-4
    assert abs(wrong.sum() - 2000 * share) < SIGMA * np.sqrt(2000 * share * (1 - share))
    power = np.mean(np.abs(velocity[wrong]) ** 2) / size**2
    assert power == pytest.approx(1, abs=SIGMA / np.sqrt(2 * wrong.sum()))
    parts = velocity[wrong]
    correlation = np.vdot(parts[:, 0], parts[:, 1]) / np.vdot(parts, parts).real * 2
    assert abs(correlation) < SIGMA / np.sqrt(wrong.sum())
    good = right.scan(dac)
    assert (s.counts[~wrong] == good.counts[~wrong]).all()


def test_wrong_pixels_belong_to_the_line(lab):
    """A line that is measured again has the same ones, however it is split."""
    ours = lab("plate", "scene.vibrometer.unflagged=0.2", "scene.pointing=chapter_4")
    dac = np.concatenate([on_plate(ours)] * 5)
    whole = ours.scan(dac, stream=3)
    parts = [ours.scan(dac[:70], stream=3), ours.scan(dac[70:])]
    assert (np.concatenate([p.counts for p in parts]) == whole.counts).all()
    assert (ours.scan(dac, stream=4).counts != whole.counts).mean() > 0.9


@pytest.mark.parametrize("radius", [None, 400.0])
def test_a_hole_is_not_there(radius):
    hole = Hole(center=[30.0, -20.0], size=[40.0, 20.0])
    modes = {"bending": Mode(2, 1, 400.0)}
    ours = Plate(LengthUnit.mm, size=[300, 250], thickness=3, radius=radius, modes=modes)
    whole = VibratingPlate.built(ours)
    ours.holes = {"one": hole}
    cut = VibratingPlate.built(ours)
    aside = np.array([[0.0, 0.0], [0.019, 0.009], [0.021, 0.0], [0.0, 0.011], [-0.021, -0.011]])
    points = whole.position(aside + np.array([0.18, 0.105]))
    inside = [True, True, False, False, False]
    found, known = cut.velocity(points, 410.0), whole.velocity(points, 410.0)
    assert np.isnan(found).all(axis=1).tolist() == inside
    np.testing.assert_array_equal(found[2:], known[2:])


@pytest.mark.whole
def test_behind_a_hole_something_rests_or_nothing(quiet, phasors):
    hole = "+scene.plate.holes={one: {center: [0.03, 0.02]}}"
    whole, backed, empty = (
        quiet("plate", *settings) for settings in ((), (hole,), (hole, "scene.backdrop=false"))
    )
    places = np.array([[0.18, 0.145], [0.165, 0.16], [0.205, 0.145], [0.18, 0.17]])
    dac = np.rint(whole.true_dac(whole.plate.position(places))).astype(int)
    s = [lab.scan(dac) for lab in (whole, backed, empty)]
    assert (s[1].status == Status.good).all()
    assert (s[2].status == Status.dropped_out).tolist() == [True, True, False, False]
    moving = np.abs(phasors(s[1], 450.0)[:, 0])
    assert moving[:2].max() < 1e-3
    assert (s[0].counts[2:] == s[1].counts[2:]).all()
    assert np.abs(phasors(s[0], 450.0)[:, 0]).min() > 0.05


def test_a_circle_that_differs_from_its_description(quiet):
    error = "{6: {x: 0.001, y: -0.002, height: 0.003, diameter: 0.0004}}"
    plain, wrong = (
        quiet("calibration", *settings, target="two_planes").calibration_object
        for settings in ((), (f"+scene.circle_errors={error}",))
    )
    i = plain.number.tolist().index(6)
    moved = (wrong.center[i] - plain.center[i]) @ plain.axes[i].T
    np.testing.assert_allclose(moved, [0.001, -0.002, 0.003], atol=1e-15)
    np.testing.assert_allclose(wrong.radius[i] - plain.radius[i], 0.0002, atol=1e-15)
    others = np.arange(len(plain.number)) != i
    np.testing.assert_array_equal(wrong.center[others], plain.center[others])


def test_a_target_of_another_size(quiet):
    plain, scaled = (
        quiet("calibration", f"scene.scale={scale}").calibration_object for scale in (1.0, 1.02)
    )
    np.testing.assert_allclose(scaled.center, 1.02 * plain.center, atol=1e-15)
    np.testing.assert_allclose(scaled.radius, 1.02 * plain.radius, atol=1e-15)


def test_a_circle_error_needs_its_circle(lab):
    with pytest.raises(UserError, match=r"scene.circle_errors.9: .* has no circle 9; .*Valid: 1"):
        lab("calibration", "+scene.circle_errors={9: {x: 0.001}}")
