"""Labs made from the configuration files, as a run makes them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from omegaconf import OmegaConf

from sldvexp.instrument import Acquisition, RawSamples
from sldvexp.virtual_lab import VirtualLab, calibration_scene, plate  # noqa: F401 (registers them)
from tests.composing import part

#: No noise at all, and every mirror where its calibration says.
QUIET = (
    "scene.pointing=ideal",
    "scene.vibrometer.noise=0",
    "scene.vibrometer.drop_out=0",
    "scene.vibrometer.harmonics=[]",
    "scene.vibrometer.hum=0",
    "scene.digitizer.reference_noise=0",
    "scene.machine_error=false",
)

LabMaker = Callable[..., VirtualLab]


@pytest.fixture
def lab() -> LabMaker:
    """Make a lab: its scene, overrides of the configuration, then target, laser and seed."""

    def make(scene, *overrides, target="dissertation", laser="ometron", seed=0, frequency=(450.0,)):
        chosen = [f"+scene={scene}", f"+laser={laser}"]
        chosen += [f"+target={target}"] if target else []
        made = OmegaConf.to_object(part(*chosen, *overrides))
        lab = VirtualLab(made["scene"], made["laser"], made.get("target"), seed)
        lab.configure(Acquisition(10000.0, 512, frequency))
        return lab

    return make


@pytest.fixture
def quiet(lab: LabMaker) -> LabMaker:
    """The same without noise."""
    return lambda scene, *overrides, **more: lab(scene, *QUIET, *overrides, **more)


@pytest.fixture
def phasors() -> Callable[[RawSamples, float], np.ndarray]:
    """Phasors of exp(+i w t) at one frequency, V, shape (pixel, channel), by least squares."""

    def fit(samples: RawSamples, *frequencies: float) -> np.ndarray:
        volts = samples.counts * samples.volts_per_count[:, None]
        time = np.arange(volts.shape[-1]) / samples.rate
        angle = 2 * np.pi * np.outer(time, frequencies)
        columns = [np.cos(angle), np.sin(angle), np.ones((len(time), 1))]
        parts = np.linalg.lstsq(np.hstack(columns), volts.reshape(-1, len(time)).T, rcond=None)[0]
        n = len(frequencies)
        complex_parts = (parts[:n] - 1j * parts[n : 2 * n]).T.reshape(*volts.shape[:2], n)
        return complex_parts[..., 0] if n == 1 else complex_parts

    return fit
