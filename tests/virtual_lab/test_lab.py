"""The lab as an instrument: reproducible, whole, and clear about what it cannot do."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from sldvexp.errors import ConfigError, UserError
from sldvexp.instrument import Acquisition, Instrument, InstrumentError, RawSamples
from sldvexp.laser import TwoMirror
from sldvexp.targets import Circle, Circles
from sldvexp.virtual_lab import VirtualLab, calibration_scene, plate
from sldvexp.virtual_lab.calibration_scene import CalibrationScene
from sldvexp.virtual_lab.lab import BLOCK


def lines(n=6, pixels=25):
    """Scan lines across the object."""
    rng = np.random.default_rng(0)
    starts = rng.integers(-600, 600, (n, 1, 2))
    return starts + np.arange(pixels)[:, None] * [0, 1]


def same(a: RawSamples, b: RawSamples) -> bool:
    return bool((a.counts == b.counts).all() and (a.status == b.status).all())


@pytest.mark.one_in(3)
@pytest.mark.parametrize("scene", ["calibration", "plate"])
@pytest.mark.parametrize("target", ["dissertation", "two_planes"])
@pytest.mark.parametrize("laser", ["ometron", "ometron_16bit"])
def test_every_view_sees_everything(lab, phasors, scene, target, laser):
    """The acceptance test of a scene: its objects move, within reach of the mirrors."""
    ours: Instrument = lab(scene, target=target, laser=laser)
    for view in ours.scene.views:
        ours.use_view(view)
        points = ours.calibration_object.center
        if scene == "plate":
            points = np.concatenate([points, ours.plate.position([[0.07, 0.12], [0.2, 0.05]])])
        dac = np.rint(ours.true_dac(points)).astype(int)
        s = ours.scan(dac)
        assert s.counts.shape == (len(points), 2, 512)
        assert s.counts.dtype == np.int16
        assert s.status.dtype == np.uint8
        assert s.rate == 10000.0
        seen = np.abs(phasors(s, 450.0))
        assert (seen[s.status == 0, 0] > 0.1).all()
        np.testing.assert_allclose(seen[:, 1], 1.0, atol=1e-3)


def test_an_instrument_of_the_lab_looks_where_it_is_said_to_look(lab):
    place = "{origin: [500, 300, 1600], look_at: [150, 150, 0], unit: mm, roll: 5, angle_unit: deg}"
    ours = lab("calibration", f"scene.views={{front: {place}}}")
    ours.use_view("front")
    np.testing.assert_allclose(ours.true_dac([0.15, 0.15, 0.0]), 0.0, atol=1e-9)
    above = ours.true_dac([0.15, 0.16, 0.0])  # rolled clockwise: what is above lies to the left
    assert np.arctan2(above[1], above[0]) == pytest.approx(np.deg2rad(5), abs=0.02)


def test_the_same_seed_makes_the_same_lab(lab):
    first, again, other = (lab("plate", seed=s).scan(lines()[0]) for s in (1, 1, 2))
    assert same(first, again)
    assert (first.counts != other.counts).mean() > 0.9


@pytest.mark.one_in(2)
@pytest.mark.parametrize("scene", ["calibration", "plate"])
def test_how_a_list_is_split_makes_no_difference(lab, scene):
    """Also across the blocks in which the lab computes."""
    dac = np.concatenate(lines(12, 33))
    assert len(dac) > 3 * BLOCK
    whole = lab(scene).scan(dac)
    ours = lab(scene)
    cuts = [0, 1, 2, 9, BLOCK - 3, BLOCK, 2 * BLOCK + 5, 390, len(dac)]
    parts = [ours.scan(dac[a:b]) for a, b in pairwise(cuts)]
    assert (np.concatenate([p.counts for p in parts]) == whole.counts).all()
    assert (np.concatenate([p.status for p in parts]) == whole.status).all()


def test_pixel_by_pixel_is_the_same_as_a_list(lab):
    dac, ours = lines()[0][:5], lab("calibration")
    listed = lab("calibration").scan(dac)
    for i, pixel in enumerate(dac):
        ours.move(pixel.tolist())
        assert (ours.acquire().counts[0] == listed.counts[i]).all()


@pytest.mark.whole
def test_a_resumed_session_repeats_its_lines_to_the_bit(lab):
    """Whatever was measured before, in whatever order: a line's number decides its noise."""
    first = lab("plate")
    whole = [first.scan(line, stream=i) for i, line in enumerate(lines())]
    for trial in range(5):
        order = np.random.default_rng(trial).permutation(6)[trial:]
        ours = lab("plate")
        for line in order:
            assert same(ours.scan(lines()[line], stream=int(line)), whole[line])
            ours.acquire()


def test_streams_views_and_sample_numbers_have_noise_of_their_own(quiet):
    ours = quiet("plate", "scene.vibrometer.noise=0.005", "scene.speaker.velocity=0")
    dac = np.full((4, 2), 3000)
    base = ours.scan(dac, stream=7).counts[:, 0, :100]
    other_stream = ours.scan(dac, stream=8).counts[:, 0, :100]
    next_pixels = ours.scan(dac).counts[:, 0, :100]
    ours.use_view("2")
    other_view = ours.scan(dac, stream=7).counts[:, 0, :100]
    ours.use_view("1")
    again = ours.scan(dac, stream=7).counts[:, 0, :100]
    ours.configure(Acquisition(10000.0, 100, ()))
    fewer = ours.scan(dac, stream=7).counts[:, 0, :100]
    assert (again == base).all()
    for other in (other_stream, next_pixels, other_view, fewer):
        assert (other != base).mean() > 0.9


def test_leaving_sends_the_mirrors_home_and_turns_the_generator_off(quiet):
    ours = quiet("calibration")
    with ours:
        ours.move([100, -200])
        assert np.abs(ours.acquire().counts[0, 1]).max() > 1000
    assert ours.position == (0, 0)
    assert (ours.acquire().counts == 0).all()


def test_a_scan_ends_where_its_list_ends(quiet):
    ours = quiet("calibration")
    assert len(ours.scan(np.zeros((0, 2), int)).counts) == 0
    ours.scan(lines()[0])
    assert ours.position == tuple(lines()[0][-1])


@pytest.mark.one_in(4)
@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("scene.views.1.origin=[1, 2]", "views.1.origin: must be three numbers, not 2"),
        ("scene.views.1.euler=[0, 0, nan]", "views.1.euler: must be finite, not nan"),
        ("scene.views.1.euler_std=[1, 1, 1]", "views.1: is a true pose: it has no standard dev"),
        ("scene.mirrors.up_down.gain=inf", "mirrors.up_down.gain: must be finite, not inf"),
        ("scene.spot.rayleigh=0", "spot.rayleigh: must be a positive number, not 0"),
        ("scene.vibrometer.drop_out=1.2", "drop_out: must be a probability from 0 to 1, not 1.2"),
        ("scene.vibrometer.harmonics=[0.1, -1]", r"harmonics\[1\]: must be zero or a positive"),
        ("scene.digitizer.velocity_range=-5", "velocity_range: must be a positive number"),
        ("scene.generator_error=-1", "generator_error: must be a finite number above -1"),
        ("scene.washer=-1", "washer: must be zero or a positive number, not -1"),
        ("scene.speaker.velocity=-1", "speaker.velocity: must be zero or a positive number"),
        ("scene.plate.size=[0.1, 0]", "plate.size: must be a positive number, not 0"),
        ("scene.plate.radius=0.04", "plate.radius: must be finite and beyond .*, not 0.04"),
        ("scene.plate.modes.bending_1_1.x=0", "bending_1_1.x: must be 1 or more half waves"),
        ("scene.plate.modes.stretch_x.x=0", "stretch_x: has no half waves: a rigid motion"),
        ("scene.plate.modes.bending_1_1.damping=0", "damping: must be a positive number, not 0"),
    ],
)
def test_impossible_scenes_are_refused(lab, setting, message):
    with pytest.raises(ConfigError, match=message) as error:
        lab("plate", setting)
    assert len(error.value.problems) == 1


def test_a_scene_needs_a_view():
    with pytest.raises(UserError, match=r"scene\.views: give at least one view, where"):
        VirtualLab(CalibrationScene(), TwoMirror())


def test_scenes_that_do_not_fit_the_target(lab):
    with pytest.raises(UserError, match="needs circles, but target is null; choose target="):
        lab("calibration", target=None)
    with pytest.raises(UserError, match="needs circles, but target is points"):
        lab("calibration", target="fiducials")
    with pytest.raises(UserError, match=r"scene.speakers.9: .* has no circle 9; .*Valid: 1, 2, 3"):
        lab("calibration", "+scene.speakers={9: {velocity: 0}}")
    with pytest.raises(UserError, match=r"scene.mirrors makes true mirrors that cannot be: .*gain"):
        lab("calibration", "scene.mirrors.left_right.gain=-1")
    plain = lab("plate", target="fiducials")
    with pytest.raises(UserError, match="has no calibration object; choose a target of circles"):
        plain.true_edge(1, [0.0])
    with pytest.raises(UserError, match="has no plate; choose scene=plate"):
        _ = lab("calibration").plate
    with pytest.raises(UserError, match="the scene has no view 7; Valid: 1, 2, 3, 4, 5"):
        plain.use_view("7")


def test_what_the_instrument_refuses(lab):
    ours = lab("calibration")
    with pytest.raises(InstrumentError, match=r"pixel 1 asks for left_right step -4097, but the"):
        ours.scan([[0, 0], [5, -4097]])
    with pytest.raises(InstrumentError, match=r"whole DAC steps .* not an array of float64"):
        ours.move([0.5, 1])
    with pytest.raises(InstrumentError, match=r"shape \(1, 3\)"):
        ours.move([1, 2, 3])
    with pytest.raises(InstrumentError, match="rate and samples must be positive"):
        ours.configure(Acquisition(0.0, 512, ()))
    with pytest.raises(InstrumentError, match="frequencies must be positive"):
        ours.configure(Acquisition(1e4, 512, (-450.0,)))
    circles = Circles(circles={1: Circle(0, 0, 0.02), 2: Circle(0.1, 0, 0.02)})
    fresh = VirtualLab(ours.scene, ours.mirrors, circles)
    with pytest.raises(InstrumentError, match="not configured; call configure first"):
        fresh.acquire()


#: What a beam may meet on its way, so that all random numbers of a pixel are drawn.
WHOLE = ("scene.pointing=chapter_4", "scene.vibrometer.unflagged=0.2")


def counted(ours):
    """Blocks that a lab computes from now on."""
    blocks, usual = [], ours._block

    def block(*what):
        blocks.append(what)
        return usual(*what)

    ours._block = ours._announced._block = block
    return blocks


@pytest.mark.one_in(2)
@pytest.mark.parametrize("scene", ["calibration", "plate"])
def test_lines_that_are_announced_are_the_same_to_the_bit(lab, scene):
    """Short ones share blocks: 9 and 11 lines of 25 pixels are 2 and 3. A long one has its own."""
    every = [(line, k + 7) for k, line in enumerate(lines(20))]
    every.insert(9, (lines(1, 3 * BLOCK)[0], 99))
    told, alone = lab(scene, *WHOLE), lab(scene, *WHOLE)
    blocks = counted(told)
    for line, number in every:
        told.expect(every)
        assert same(told.scan(line, stream=number), alone.scan(line, stream=number))
        assert told.position == alone.position
        assert same(told.scan(line[:3]), alone.scan(line[:3]))  # the line goes on
    assert len(blocks) - len(every) == 2 + 3 + 3


def test_what_was_announced_may_come_otherwise(lab):
    """In another order, again, with other pixels, in another view, or never."""
    every = [(line, k) for k, line in enumerate(lines(8))]
    told, alone = lab("plate", *WHOLE), lab("plate", *WHOLE)
    other = (every[3][0] + 1, 3)
    beyond = (every[0][0] + 10**6, 8)
    told.expect([*every, beyond])
    order = [every[5], every[0], every[0], every[1], other, every[2], every[7]]
    for k, (line, number) in enumerate(order):
        assert same(told.scan(line, stream=number), alone.scan(line, stream=number))
        if k == 4:
            for ours in (told, alone):
                ours.use_view("2")
        if k == 5:
            for ours in (told, alone):
                ours.configure(Acquisition(10000.0, 512, (700.0,)))
    with pytest.raises(InstrumentError, match="the board has"):
        told.scan(*beyond)


@pytest.mark.parametrize("elsewhere", [10.0, -10.0])
def test_what_a_block_of_beams_does_not_meet_is_not_looked_at(lab, monkeypatch, elsewhere):
    """Neither the parts of spots nor the motion of modes; they are looked at where they are met."""
    ours, looked = lab("plate"), []
    for module, name in ((calibration_scene, "part_inside"), (plate.VibratingPlate, "_motion")):
        usual = getattr(module, name)

        def counted(*args, usual=usual, name=name):
            looked.append(name)
            return usual(*args)

        monkeypatch.setattr(module, name, counted)
    middle = np.rint(ours.true_dac(ours.calibration_object.center[:1])).astype(int)
    ours.scan(np.tile(middle, (3, 1)))
    assert "part_inside" in looked
    looked.clear()
    ours.scan(np.full((3, 2), int(400 * elsewhere)))
    assert not looked
