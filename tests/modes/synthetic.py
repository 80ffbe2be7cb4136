"""Velocity images of a structure whose modes are known."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from sldvexp import dataset, modes

LINE = np.arange(55.0, 1331.0, 5.0)
FREQUENCY = np.array([197.0, 439.0, 545.0, 787.0, 842.0])
DAMPING = np.full(5, 0.01)


def responses(line, frequency, damping, shape, above=0.0, below=0.0):
    """Compute the lines of modes with peak velocities ``shape`` (pixel, mode) at resonance."""
    r = np.asarray(line, float)[:, None] / np.asarray(frequency, float)
    damped = 2j * np.asarray(damping) * r
    modal = damped / (1 - r**2 + damped)
    omega = 2 * np.pi * np.asarray(line, float)
    rest = 1j * omega / omega.max() * np.reshape(above, (-1, 1))
    rest = rest + omega.min() / (1j * omega) * np.reshape(below, (-1, 1))
    return np.asarray(shape) @ modal.T + rest


def image(line, velocity, noise: ArrayLike, rng=None, flags=None, **more):
    """Make the group ``image/<view>`` of lines of pixels, with noise of the given std."""
    std = np.broadcast_to(np.asarray(noise, float), np.shape(velocity))
    seen = np.array(velocity, complex)
    if rng is not None:
        seen += std * (rng.normal(size=seen.shape) + 1j * rng.normal(size=seen.shape))
    pixels = len(seen)
    return dataset.group(
        "image",
        {"pixel": np.arange(pixels), "frequency": line},
        velocity=seen,
        velocity_std=std,
        dac=np.zeros((pixels, 2)),
        flags=np.zeros(pixels, int) if flags is None else flags,
        **more,
    )


def plate_shapes(pixels: int, modes: int, seed: int = 0):
    """Make real shapes of a strip, sines, at places by chance."""
    place = np.random.default_rng(seed).uniform(0.05, 0.95, pixels)
    return 1e-3 * np.sin(np.pi * np.outer(place, np.arange(1, modes + 1)))


def session(seed, ratio, pixels=300, frequency=FREQUENCY, damping=DAMPING, line=LINE):
    """Make one view whose noise is `ratio` of the r.m.s. of its lines, on average."""
    rng = np.random.default_rng(seed)
    shape = plate_shapes(pixels, len(frequency), seed)
    above, below = 2e-5 * rng.normal(size=(2, pixels))
    seen = responses(line, frequency, damping, shape, above, below)
    rms = np.sqrt(np.mean(np.abs(seen) ** 2))
    noise = ratio * rms * rng.uniform(0.5, 1.5, (pixels, 1))
    return image(line, seen, noise, rng), shape


@cache
def quiet():
    """Make a view of little noise, and find its modes; nobody changes them."""
    view, shape = session(1, 0.01)
    return view, shape, identified(view)


def identified(*views, **settings):
    """Find the modes of some views."""
    named = {f"view{k}": view for k, view in enumerate(views)}
    return modes.estimate_modes(named, modes.MostLikelyModes(**settings))
