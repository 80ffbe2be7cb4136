"""Groups that the small session does not leave: points, spectra, repeats, a sweep."""

from __future__ import annotations

import numpy as np
import xarray as xr

from sldvexp import dataset

HERTZ = np.array([120.0, 450.0])


def point(seed: int, frequencies: int = 2) -> xr.Dataset:
    """A point's velocity, in m/s."""
    rng = np.random.default_rng(seed)
    shape = (3, frequencies)
    velocity = 0.01 * (rng.normal(size=shape) + 1j * rng.normal(size=shape))
    std = 1e-4 * rng.uniform(1.0, 2.0, shape)
    hertz = HERTZ if frequencies == 2 else np.linspace(50.0, 500.0, frequencies)
    return dataset.group(
        "point",
        {"frequency": hertz},
        velocity=velocity,
        velocity_std=std,
        confidence=2.0 * std,
    )


def points() -> xr.Dataset:
    """Velocities of five points at two frequencies, in m/s."""
    rng = np.random.default_rng(5)
    shape = (5, 3, 2)
    velocity = 0.01 * (rng.normal(size=shape) + 1j * rng.normal(size=shape))
    names = ["1", "2", "7", "9", "12"]
    return dataset.group(
        "point",
        {"point": names, "frequency": HERTZ},
        velocity=velocity,
        confidence=1e-4 * rng.uniform(1.0, 2.0, shape),
    )


def joined() -> xr.Dataset:
    """Where these points are: a square of two triangles, a fifth point, and lines."""
    return dataset.group(
        "line_of_sight",
        {"point": ["1", "2", "7", "9", "12"]},
        position=np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [2.0, 1, 1]]) / 10,
        triangle=np.array([[0, 1, 2], [1, 3, 2]]),
        line=np.array([[0, 1], [1, 3], [3, 4]]),
    )


def repeats(dac: np.ndarray, count: int = 4) -> dict[str, xr.Dataset]:
    """A view's image points, shape (point, 2), that scatter by 0.1 DAC steps."""
    rng = np.random.default_rng(3)
    scattered = dac + rng.normal(scale=0.1, size=(count, *dac.shape))
    numbers = np.arange(1, len(dac) + 1)
    views = [f"scan {k}" for k in range(1, count + 1)]
    std = scattered.std(axis=0, ddof=1)
    return {
        "registration": dataset.group(
            "registration", {"view": views, "point": numbers}, dac=scattered
        ),
        "examined/again": dataset.group(
            "examined/repeatability", {"point": numbers}, dac_std=std, largest=std.max()
        ),
    }


def sweep() -> xr.Dataset:
    """Two methods by three seeds, one of the runs failed."""
    rng = np.random.default_rng(4)
    velocity = 0.01 + 1e-3 * rng.normal(size=(2, 3, 3)) + 0j
    velocity[1, 2] = np.nan
    state = np.full((2, 3), "done", object)
    state[1, 2] = "failed"
    keys = ("reconstruction", "seed")
    units = {"units": "m/s"}
    return xr.Dataset(
        {
            "point.velocity": ((*keys, "component"), velocity, units),
            "point.velocity_std": ((*keys, "component"), 1e-4 * np.abs(velocity) / 0.01, units),
            "state": (keys, state.astype(str)),
            "seconds": (keys, np.ones((2, 3))),
        },
        coords={
            "reconstruction": ["absolute", "relative"],
            "seed": [1, 2, 3],
            "component": ["x", "y", "z"],
        },
        attrs={"keys": list(keys), "ranked_by": "point.velocity"},
    )
