"""Velocity images of a structure whose modes are known."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sldvexp import dataset


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
    """Make real shapes of a strip, sines, with a phase of 0."""
    place = np.random.default_rng(seed).uniform(0.05, 0.95, pixels)
    return 1e-3 * np.sin(np.pi * np.outer(place, np.arange(1, modes + 1)))
