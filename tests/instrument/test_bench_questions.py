"""Questions of a person at the bench, to instruments that can answer and to those that cannot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.instrument import Acquisition, RawSamples, Status, bench
from sldvexp.instrument.profile_file import load_profile, profile_path
from sldvexp.instrument.visa import Visa
from sldvexp.virtual_lab.console import experiment
from sldvexp.virtual_lab.lab import VirtualLab
from sldvexp.virtual_lab.server import LabServer

SAMPLING = Acquisition(25600.0, 64, (450.0,))


@pytest.fixture(scope="module")
def parts():
    return experiment(["experiment=plate"])


@pytest.fixture
def lab(parts):
    return VirtualLab(parts.scene, parts.laser, parts.target, 0)


@pytest.fixture
def far(lab):
    """The lab behind a socket, asked as its profile says."""
    with LabServer(lab) as server, Visa(resource=server.resource, timeout=5.0).open() as opened:
        opened.configure(SAMPLING)
        yield opened


class Plain:
    """An instrument that can scan and nothing else."""

    def __init__(self):
        self.told = []

    def configure(self, acquisition):
        self.told.append(("configure", acquisition.excitation))

    def move(self, dac):
        self.told.append(("move", tuple(dac)))


def pixel(status):
    return RawSamples(np.zeros((1, 2, 4), np.int16), np.ones(2), 1.0, np.array([status], np.uint8))


def test_instrument_that_cannot_tell_stands_where_it_was_sent_and_has_its_light():
    plain = Plain()
    assert bench.read_position(plain, (3, 4)) == (3, 4)
    assert bench.light_level(plain, pixel(Status.good)) == 1.0
    assert bench.light_level(plain, pixel(Status.dropped_out)) == 0.0
    assert bench.picture(plain) is None


def test_instrument_is_made_safe_with_what_every_one_can():
    plain = Plain()
    bench.make_safe(plain, SAMPLING)
    assert plain.told == [("configure", ()), ("move", (0, 0))]


def test_mirrors_go_home_even_if_the_generator_is_not_switched_off():
    class Stubborn(Plain):
        def configure(self, acquisition):
            raise OSError("no")

    plain = Stubborn()
    with pytest.raises(OSError, match="no"):
        bench.make_safe(plain, SAMPLING)
    assert plain.told == [("move", (0, 0))]


def test_profile_says_how_place_light_and_picture_are_asked_for(far, lab):
    far.move((-371, 1322))
    assert bench.read_position(far, (0, 0)) == (-371, 1322)
    assert bench.light_level(far, pixel(Status.good)) == pytest.approx(lab.light_level())
    np.testing.assert_array_equal(bench.picture(far), lab.picture())


def test_profile_without_these_questions_has_none_of_it(lab, tmp_path):
    text = profile_path("virtual_lab").read_text()
    path = tmp_path / "plain.yaml"
    path.write_text(text[: text.index("\nbench:")])
    with LabServer(lab) as server:
        instrument = Visa(resource=server.resource, profile=str(path), timeout=5.0)
        with instrument.open() as opened:
            assert bench.read_position(opened, (1, 2)) == (1, 2)
            assert bench.light_level(opened, pixel(Status.good)) == 1.0
            assert bench.picture(opened) is None


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ("bench: {device: nobody}", "bench.device addresses the unknown device nobody"),
        ("bench: {}", "bench.device must be given"),
        ("bench: {device: lab, picture: X}", "bench.picture_size must be rows and columns"),
        ("bench: {device: lab, picture: X, picture_size: [0, 5]}", "bench.picture_size"),
        ("bench: {device: lab, picture: X, picture_size: [9, 99999]}", "up to 2000 each"),
        ("bench: {device: lab, where: X}", "bench.where is not a known setting"),
        ("bench: [1]", "bench must be a table"),
    ],
)
def test_wrong_questions_are_told_by_their_keys(tmp_path, wrong, told):
    text = profile_path("virtual_lab").read_text()
    path = tmp_path / "mine.yaml"
    path.write_text(f"{text[: text.index(chr(10) + 'bench:')]}\n{wrong}\n")
    with pytest.raises(UserError, match=told):
        load_profile(str(path))


def test_asking_changes_no_bit_of_a_scan(far, lab, parts):
    line = np.array([[0, 0], [10, 10], [-371, 1322]])
    before = far.scan(line, stream=3).counts
    bench.picture(far)
    bench.light_level(far, far.acquire())
    bench.read_position(far, (0, 0))
    np.testing.assert_array_equal(far.scan(line, stream=3).counts, before)


def test_spot_is_in_the_picture_where_the_beam_falls(lab):
    lab.move((0, 0))
    middle = np.argwhere(lab.picture() == 255).mean(axis=0)
    np.testing.assert_allclose(middle, (np.array(lab.picture().shape) - 1) / 2, atol=1)
    lab.move((800, 0))
    up = np.argwhere(lab.picture() == 255).mean(axis=0)
    lab.move((0, 800))
    left = np.argwhere(lab.picture() == 255).mean(axis=0)
    assert up[0] < middle[0] - 5
    assert left[1] < middle[1] - 5


def test_closed_shutter_gives_neither_light_nor_spot(parts):
    dark = VirtualLab(replace(parts.scene, shutter_open=False), parts.laser, parts.target, 0)
    assert dark.light_level() == 0.0
    assert dark.picture().max() < 255


def test_quick_look_is_no_longer_than_the_scan():
    assert bench.quick(replace(SAMPLING, samples=512)).samples == 228
    assert bench.quick(SAMPLING) == SAMPLING
    assert bench.quick(replace(SAMPLING, excitation=())).samples == 32
