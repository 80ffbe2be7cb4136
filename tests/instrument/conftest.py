"""Virtual labs and connections to them, as a run makes them."""

from __future__ import annotations

import functools
from collections.abc import Callable

import numpy as np
import pytest

from sldvexp.config.experiment import Experiment
from sldvexp.instrument import RawSamples
from sldvexp.virtual_lab import VirtualLab
from tests import composing


@pytest.fixture
def experiment() -> Callable[..., Experiment]:
    """The plugins of a configuration."""
    return lambda *overrides: built(overrides)


@functools.cache
def built(overrides: tuple[str, ...]) -> Experiment:
    """A lab with the calibration object, changed."""
    chosen = ["~experiment", "scene=calibration", "target=dissertation", *overrides]
    return composing.experiment(*chosen)


@pytest.fixture
def lab(experiment: Callable[..., Experiment]) -> Callable[..., VirtualLab]:
    """The virtual lab of a configuration."""

    def made(*overrides: str) -> VirtualLab:
        e = experiment(*overrides)
        return VirtualLab(e.scene, e.laser, e.target, e.seed)

    return made


@pytest.fixture
def line() -> np.ndarray:
    """A short scan line over the calibration object."""
    return np.stack([np.full(8, -150), np.arange(-300, -220, 10)], axis=1)


@pytest.fixture
def same() -> Callable[[RawSamples, RawSamples], bool]:
    """Whether two blocks of samples are the same to the last bit."""

    def compare(a: RawSamples, b: RawSamples) -> bool:
        parts = ((a.counts, b.counts), (a.volts_per_count, b.volts_per_count), (a.status, b.status))
        alike = all(x.dtype == y.dtype and np.array_equal(x, y) for x, y in parts)
        return alike and a.rate == b.rate

    return compare
