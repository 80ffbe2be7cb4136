"""Where the mirrors really stand: jitter, hysteresis, drift, and noise by distance."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import ConfigError
from sldvexp.instrument import Acquisition
from sldvexp.laser import TwoMirror
from sldvexp.virtual_lab.pointing import MirrorPath, PointingTerms, Scanner, errors_along
from sldvexp.virtual_lab.scene import OpticalDistance

SIGMA = 4.5
STILL = np.zeros((1, 2))


def errors(terms, dac, line=0, mirrors=None):
    """Errors of both mirrors at the pixels of a line, without jitter."""
    dac = np.asarray(dac, float)
    return MirrorPath(terms, mirrors or TwoMirror(), line).error(dac, np.zeros(dac.shape))


def test_hysteresis_depends_on_where_a_mirror_comes_from():
    """From step 0 up, further up, down; the other mirror rests, and keeps where it came from."""
    found = errors(PointingTerms(hysteresis=1e-3), [[10, -5], [20, -5], [15, -5], [15, 0]])
    np.testing.assert_allclose(found / 0.5e-3, [[-1, 1], [-1, 1], [1, 1], [1, -1]], atol=1e-12)
    # A mirror that has not moved since step 0 came from nowhere.
    np.testing.assert_array_equal(errors(PointingTerms(hysteresis=1e-3), [[0, 0]]), STILL)


def test_hysteresis_is_that_of_the_angle():
    """A mirror that is wired the other way round turns down when its steps go up."""
    mirrors = TwoMirror()
    mirrors.up_down.gain = -25.0
    found = errors(PointingTerms(hysteresis=1e-3), [[10, 10]], mirrors=mirrors)
    np.testing.assert_allclose(found, [[0.5e-3, -0.5e-3]])


def test_ways_together_are_those_one_by_one():
    """To the bit; a line goes on in the next block, and every line begins by itself."""
    terms, rng = PointingTerms(jitter=1e-5, hysteresis=3e-5, drift=1e-4), np.random.default_rng(1)
    apart, along = ([MirrorPath(terms, TwoMirror(), n) for n in (4, 5, 6)] for _ in range(2))
    for pixels in ([7, 1, 3], [2, 5, 4]):
        dac = rng.integers(-3, 4, (sum(pixels), 2))
        normal, ends = rng.normal(size=dac.shape), np.cumsum(pixels)[:-1]
        parts = zip(apart, np.split(dac, ends), np.split(normal, ends), strict=True)
        each = [path.error(*of) for path, *of in parts]
        np.testing.assert_array_equal(
            errors_along(along, dac, normal, pixels), np.concatenate(each)
        )


def test_drift_grows_from_line_to_line():
    terms = PointingTerms(drift=2e-3)
    np.testing.assert_array_equal(errors(terms, [[5, 5]], line=0), STILL)
    np.testing.assert_allclose(errors(terms, [[5, 5], [6, 6]], line=50), 1e-3)


def middle_of_plate(lab):
    """Whole steps onto the nodal line of the plate's second mode, and the same to its left."""
    return np.rint(lab.true_dac(lab.plate.position([[0.15, 0.125]]))).astype(int)[0]


def steps(quiet, phasors, pixels, *settings):
    """By how many steps of the left-right mirror the beam is off, which is sent to one place.

    Read off the velocity across the nodal line of the plate's second mode, where it changes by a
    known amount each step.
    """
    right, wrong = quiet("plate"), quiet("plate", *settings)
    for lab in (right, wrong):
        lab.configure(Acquisition(10000.0, 500, (443.0,)))
    centre = middle_of_plate(right)
    v = phasors(right.scan(centre + np.array([[0, -40], [0, 0], [0, 40]])), 443.0)
    beside, middle, further = v[:, 0] / v[:, 1]
    found = phasors(wrong.scan(np.tile(centre, (pixels, 1))), 443.0)
    return (80 * (found[:, 0] / found[:, 1] - middle) / (further - beside)).real


@pytest.mark.whole
def test_the_beam_falls_where_hysteresis_puts_it(quiet):
    """Five steps short of where it is sent, from whatever side it comes."""
    step = TwoMirror().step[1]
    right, wrong = quiet("plate"), quiet("plate", f"scene.mirrors.hysteresis={10 * step}")
    line = middle_of_plate(right) + np.array([[12, -40], [21, -10], [30, 30], [-6, 0]])
    turned = np.sign(np.diff(line, axis=0, prepend=0))
    assert set(turned[:, 0]) == set(turned[:, 1]) == {-1, 1}
    assert_same(wrong.scan(line, stream=0), right.scan(line - 5 * turned, stream=0))
    assert (wrong.scan(line).counts != right.scan(line).counts).mean() > 0.1


def test_the_beam_drifts(quiet):
    """By eight steps in a hundred lines."""
    step = TwoMirror().step[1]
    right, wrong = quiet("plate"), quiet("plate", f"scene.mirrors.drift={8 * step}")
    line = middle_of_plate(right) + np.array([[0, -40], [9, -10], [9, 30]])
    for number, moved in ((0, 0), (50, 4), (100, 8)):
        assert_same(wrong.scan(line, stream=number), right.scan(line + moved, stream=number))


def assert_same(one, other):
    """Compare counts but for what rounds differently."""
    difference = np.abs(one.counts.astype(int) - other.counts)
    assert difference.max() <= 1
    assert (difference > 0).mean() < 1e-3


def test_jitter_is_new_at_every_pixel(quiet, phasors):
    """Its size, its mean, and none of it is left at the next pixel."""
    step, n = TwoMirror().step[1], 400
    found = steps(quiet, phasors, n, f"scene.mirrors.jitter={2 * step}")
    assert abs(found.mean()) < SIGMA * 2 / np.sqrt(n)
    assert found.std() == pytest.approx(2, rel=SIGMA / np.sqrt(2 * n))
    assert abs(np.corrcoef(found[1:], found[:-1])[0, 1]) < SIGMA / np.sqrt(n)


def test_jitter_moves_each_mirror_by_itself():
    normal = np.random.default_rng(0).standard_normal((100, 2))
    found = MirrorPath(PointingTerms(jitter=3e-5), TwoMirror(), 0).error(np.zeros((100, 2)), normal)
    np.testing.assert_allclose(found, 3e-5 * normal)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("pointing", ["modern", "chapter_4"])
def test_how_a_list_is_split_makes_no_difference_to_where_it_points(lab, pointing, swapped):
    settings = [f"scene.pointing={pointing}", f"scene.mirrors.swapped={swapped}"]
    dac = np.random.default_rng(1).integers(-900, 900, (300, 2))
    ours = lab("plate", *settings, "scene.mirrors.drift=0.001", "scene.mirrors.hysteresis=0.001")
    whole = ours.scan(dac, stream=7)
    parts = [ours.scan(dac[:65], stream=7), ours.scan(dac[65:66]), ours.scan(dac[66:])]
    assert (np.concatenate([p.counts for p in parts]) == whole.counts).all()
    ours.acquire()
    assert (ours.scan(dac, stream=7).counts == whole.counts).all()


def test_terms_that_are_zero_leave_the_lab_as_it_is(lab):
    """To the bit; and the scanner's own terms do not move what the noise is."""
    dac = np.random.default_rng(1).integers(-900, 900, (100, 2))
    zero = [f"scene.mirrors.{term}=0" for term in ("jitter", "hysteresis", "drift")]
    plain = lab("plate", "scene.pointing=ideal").scan(dac)
    none = lab("plate", "scene.pointing=chapter_4", "scene.vibrometer.distance.worst=1", *zero)
    assert (none.scan(dac).counts == plain.counts).all()
    other = lab("plate", "scene.pointing=modern").scan(dac)
    same = (plain.counts == other.counts).all(axis=(1, 2))
    assert same.any()  # where nothing moves, the noise is what it was
    assert not same.all()


@pytest.mark.whole
def test_one_setting_chooses_the_scanner(lab):
    assert lab("plate", "scene.pointing=ideal").scene.pointing_terms == PointingTerms()
    chosen = lab("plate", "scene.pointing=chapter_4", "scene.mirrors.hysteresis=2e-5").scene
    own = Scanner.chapter_4.value
    assert chosen.pointing_terms == PointingTerms(own.jitter, 2e-5, 0.0, own.worst)
    less = lab("plate", "scene.pointing=modern", "scene.mirrors.jitter=0").scene
    assert less.pointing_terms == PointingTerms(0.0, Scanner.modern.value.hysteresis)
    step = TwoMirror().step[0]
    assert 0.2 * step < own.jitter < 0.5 * step
    assert Scanner.modern.value.jitter == 1e-5


def test_noise_by_distance():
    optics = OpticalDistance(best=1.8, period=0.2)
    factor = optics.factor(np.array([1.8, 2.0, 1.7, 1.75, np.inf]), 9.0)
    np.testing.assert_allclose(factor, [1, 1, 9, 3, 1])


def test_a_circle_at_a_poor_distance_has_more_noise(quiet):
    """The same pixels, their noise multiplied by what the distance makes of it."""
    settings = ["scene.vibrometer.noise=0.005", "scene.speaker.velocity=0"]
    plain, poor = (
        quiet("calibration", *settings, f"scene.vibrometer.distance.worst={worst}")
        for worst in (1, 4)
    )
    centres = plain.calibration_object.center
    dac = np.rint(plain.true_dac(centres)).astype(int)
    noise = [lab.scan(dac).counts[:, 0].std(axis=1) for lab in (plain, poor)]
    distance = np.linalg.norm(centres - plain.true_pose("1")[1], axis=1)
    expected = OpticalDistance().factor(distance, 4.0)
    assert expected[2] > 3.9  # circle 3 of Figure 4.29's pose
    assert np.delete(expected, 2).max() < 1.7
    np.testing.assert_allclose(noise[1] / noise[0], expected, rtol=0.01)


@pytest.mark.whole
def test_the_pointing_noise_grows_with_the_other(quiet, phasors):
    jitter = f"scene.mirrors.jitter={TwoMirror().step[1]}"
    lab = quiet("plate")
    target = lab.plate.position([[0.15, 0.125]])[0]
    far = np.linalg.norm(target - lab.true_pose("1")[1])
    poor = ["scene.vibrometer.distance.worst=3", f"scene.vibrometer.distance.best={far + 0.1}"]
    one, three = (steps(quiet, phasors, 400, jitter, *more) for more in ((), poor))
    np.testing.assert_allclose(three.std() / one.std(), 3, rtol=0.01)  # the same random numbers


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("scene.mirrors.jitter=-1", "mirrors.jitter: must be zero or a positive number, not -1"),
        ("scene.mirrors.drift=inf", "mirrors.drift: must be finite, not inf"),
        ("scene.vibrometer.distance.worst=0.5", "distance.worst: must be 1 or more, not 0.5"),
        ("scene.vibrometer.distance.period=0", "distance.period: must be a positive number"),
        ("scene.vibrometer.unflagged=2", "unflagged: must be a probability from 0 to 1, not 2"),
        ("+scene.plate.holes={a: {size: [1]}}", r"holes.a.size: must be 2 numbers, not 1"),
        ("scene.scale=0", "scale: must be a positive number, not 0"),
        ("+scene.circle_errors={1: {x: inf}}", "circle_errors.1.x: must be finite, not inf"),
    ],
)
def test_impossible_terms_are_refused(lab, setting, told):
    with pytest.raises(ConfigError, match=told) as error:
        lab("plate", setting)
    assert len(error.value.problems) == 1
