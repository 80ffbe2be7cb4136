"""Scan lines in files: read alike whoever wrote the archive, and not at all where it is damaged."""

from __future__ import annotations

import errno

import numpy as np
import pytest

from sldvexp import writing
from sldvexp.errors import UserError
from sldvexp.instrument import Acquisition, RawSamples, recording
from sldvexp.instrument.recording import read_line, read_pixels, write_line

ACQUISITION = Acquisition(rate=1000.0, samples=5, excitation=(50.0,))
DAC = np.array([[1, 2], [3, 4], [5, 6]])
SAMPLES = RawSamples(
    np.arange(30, dtype=np.int16).reshape(3, 2, 5),
    np.array([1e-4, 2e-4]),
    1000.0,
    np.array([0, 1, 2], np.uint8),
)


@pytest.fixture
def line(tmp_path):
    path = tmp_path / "line.npz"
    write_line(path, DAC, ACQUISITION, SAMPLES)
    return path


def by_ours(path):
    pass


def by_numpy(path, save=np.savez):
    with np.load(path) as kept:
        arrays = dict(kept)
    save(path, **arrays)


def compressed(path):
    by_numpy(path, np.savez_compressed)


@pytest.mark.parametrize("at_once", [recording.AT_ONCE, 0])
@pytest.mark.parametrize("write", [by_ours, by_numpy, compressed])
def test_a_line_is_read_whoever_wrote_it(line, monkeypatch, write, at_once):
    write(line)
    monkeypatch.setattr(recording, "AT_ONCE", at_once)
    dac, how, samples = read_line(line)
    np.testing.assert_array_equal(dac, DAC)
    assert how.tolist() == [1000.0, 5.0, 1.0, 50.0]
    np.testing.assert_array_equal(samples.counts, SAMPLES.counts)
    np.testing.assert_array_equal(samples.volts_per_count, SAMPLES.volts_per_count)
    np.testing.assert_array_equal(samples.status, SAMPLES.status)
    assert samples.rate == SAMPLES.rate
    np.testing.assert_array_equal(read_pixels(line)[0], DAC)


@pytest.mark.parametrize("at_once", [recording.AT_ONCE, 0])
def test_a_damaged_line_is_none(line, monkeypatch, at_once):
    monkeypatch.setattr(recording, "AT_ONCE", at_once)
    whole = line.read_bytes()
    place = whole.index(SAMPLES.counts.tobytes())
    line.write_bytes(whole[:place] + b"\x7f" + whole[place + 1 :])
    assert read_line(line) is None
    line.write_bytes(whole[:place])
    assert read_line(line) is None
    assert read_pixels(line) is None


def test_a_line_does_not_follow_a_link_that_was_put_in_its_way(line):
    """Nor does what is left beside it stop it: the next one takes its place."""
    name = f"{line.stem}.{writing._here()}{line.suffix}"
    elsewhere = line.with_name("elsewhere")
    elsewhere.write_text("mine")
    for put in (lambda way: way.symlink_to(elsewhere), lambda way: way.write_text("half")):
        put(line.with_name(f".{name}"))
        write_line(line, DAC[::-1], ACQUISITION, SAMPLES)
        np.testing.assert_array_equal(read_pixels(line)[0], DAC[::-1])
        assert elsewhere.read_text() == "mine"
        assert sorted(p.name for p in line.parent.iterdir()) == ["elsewhere", line.name]


def test_a_line_that_is_not_whole_leaves_the_one_before(line, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(recording, "write_arrays", full)
    with pytest.raises(UserError, match=r"line\.npz: cannot be written: No space left on device"):
        write_line(line, DAC[::-1], ACQUISITION, SAMPLES)
    np.testing.assert_array_equal(read_pixels(line)[0], DAC)
    assert [p.name for p in line.parent.iterdir()] == [line.name]
