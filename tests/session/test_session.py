"""A session of scan lines: what is kept, what is repeated, what a camera sees."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.instrument import Acquisition, RawSamples
from sldvexp.session import Journal

ACQUISITION = Acquisition(25600.0, 64, (450.0,))


def line(seed: int) -> tuple[np.ndarray, RawSamples]:
    rng = np.random.default_rng(seed)
    dac = rng.integers(-100, 100, (5, 2))
    counts = rng.integers(-3000, 3000, (5, 2, 64)).astype(np.int16)
    return dac, RawSamples(counts, np.array([3e-4, 2e-4]), 25600.0, np.zeros(5, np.uint8))


class Measured:
    """Counts how often it was asked."""

    def __init__(self, samples: RawSamples) -> None:
        self.samples, self.times = samples, 0

    def __call__(self) -> RawSamples:
        self.times += 1
        return self.samples


def test_a_kept_line_is_not_measured_again(tmp_path):
    dac, samples = line(0)
    measure = Measured(samples)
    first = Journal(tmp_path / "1").line("a", dac, ACQUISITION, measure)
    again = Journal(tmp_path / "1").line("a", dac, ACQUISITION, measure)
    assert measure.times == 1
    for found in (first, again):
        np.testing.assert_array_equal(found.counts, samples.counts)
        np.testing.assert_array_equal(found.volts_per_count, samples.volts_per_count)
        assert found.rate == samples.rate


@pytest.mark.parametrize("keep", [0, 10, 200])
def test_a_damaged_line_is_measured_again(tmp_path, keep):
    dac, samples = line(1)
    measure = Measured(samples)
    Journal(tmp_path).line("a", dac, ACQUISITION, measure)
    path = tmp_path / "a.npz"
    path.write_bytes(path.read_bytes()[:keep])
    found = Journal(tmp_path).line("a", dac, ACQUISITION, measure)
    assert measure.times == 2
    np.testing.assert_array_equal(found.counts, samples.counts)


def test_a_line_of_another_configuration_is_refused(tmp_path):
    dac, samples = line(2)
    Journal(tmp_path).line("a", dac, ACQUISITION, lambda: samples)
    for other in ((dac + 1, ACQUISITION), (dac, Acquisition(25600.0, 64, (500.0,)))):
        with pytest.raises(UserError, match="belongs to another configuration"):
            Journal(tmp_path).line("a", *other, lambda: samples)


def test_a_line_that_fails_leaves_nothing(tmp_path):
    def fail() -> RawSamples:
        raise OSError("the cable is out")

    with pytest.raises(OSError, match="cable"):
        Journal(tmp_path / "1").line("a", line(3)[0], ACQUISITION, fail)
    assert not (tmp_path / "1").exists()
