"""Modes of many pixels and lines: how long they take, and how much memory.

Run with ``pytest tests/benchmarks/test_modes_speed.py --benchmark-enable`` for the times.
"""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from sldvexp import dataset, modes

LINE = np.arange(55.0, 1331.0, 5.0)


def views(count, pixels):
    """Images of five modes of a strip, 2 % of noise."""
    rng, found = np.random.default_rng(0), {}
    natural = np.array([197.0, 439.0, 545.0, 787.0, 842.0])
    r = LINE[:, None] / natural
    response = (0.02j * r / (1 - r**2 + 0.02j * r)).T
    for k in range(count):
        place = rng.uniform(0.05, 0.95, pixels)
        seen = np.sin(np.pi * np.outer(place, np.arange(1, 6))) @ response
        noise = rng.normal(scale=0.004, size=(2, *seen.shape))
        found[f"view{k}"] = dataset.group(
            "image",
            {"pixel": np.arange(pixels), "frequency": LINE},
            velocity=seen + noise[0] + 1j * noise[1],
            velocity_std=np.full(seen.shape, 0.004),
            dac=np.zeros((pixels, 2)),
            flags=np.zeros(pixels, int),
        )
    return found


def test_five_thousand_pixels_with_256_lines(benchmark):
    """Some hundred of them if nothing is timed."""
    images = views(5, 1000 if benchmark.enabled else 60)
    found = benchmark(modes.estimate_modes, images, modes.MostLikelyModes())
    assert found.modes.sizes["mode"] == 5
    if benchmark.enabled:
        assert benchmark.stats["mean"] < 6.0


@pytest.mark.whole
def test_one_view_is_in_memory_at_a_time():
    """Beside the images there is one view, whitened and split, however many there are."""
    peaks = {}
    for count in (1, 3, 9):  # the first loads libraries
        images = views(count, 300)
        tracemalloc.start()
        modes.estimate_modes(images, modes.MostLikelyModes())
        peaks[count] = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    one = next(iter(images.values()))["velocity"].nbytes
    assert peaks[9] - peaks[3] < one
