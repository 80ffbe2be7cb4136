"""Five views of a square plate, which the benchmarks of fields look at."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from sldvexp.field import View, VolumeVisibility
from sldvexp.laser import Mirror, TwoMirror, project
from sldvexp.volume import Grid

LASER = TwoMirror(mirror_offset=0.045, up_down=Mirror(25), left_right=Mirror(25))
STANDS = [[0.0, -0.5, 1.6], [0.6, 0.5, 1.5], [0.3, 0.3, 1.6], [-0.5, 0.4, 1.5], [0.6, -0.2, 1.5]]
#: Of the plate, m; of the noise, m/s; of the poses, rad and m; how many modes the plate has.
SIDE, STD, POSE_STD, MODES = 0.4, 1e-3, 1e-4, 6


def view(name: str, origin: np.ndarray, rng: np.random.Generator, size: tuple[int, int]) -> View:
    """A lattice of pixels over the plate that sees some modes, and noise.

    Parameters
    ----------
    size : pair of int
        Pixels along a side, and frequencies.
    """
    pixels, frequencies = size
    z = -origin / np.linalg.norm(origin)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z])
    corner = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-0.1, 0.1)])
    in_laser = (1.1 * SIDE / 2 * corner - origin) @ rotation.T
    dac = LASER.dac_from_angle(project(in_laser, LASER.mirror_offset))
    axes = np.linspace(dac.min(axis=0), dac.max(axis=0), pixels).T
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    shapes = np.cos(lattice @ (1e-3 * np.arange(1, 2 * MODES + 1).reshape(2, MODES)))
    lines = np.linspace(0.0, MODES, frequencies)
    response = 1 / (np.arange(MODES)[:, None] + 0.5 - lines + 0.05j)
    noise = STD * rng.normal(size=(len(lattice), frequencies, 2)).view(complex)[..., 0]
    covariance = np.diag([POSE_STD] * 6) ** 2
    std, flags = np.full(len(lattice), STD), np.zeros(len(lattice), int)
    velocity = shapes @ response + noise
    return View(name, rotation, origin, covariance, lattice, velocity, std, flags, (pixels, pixels))


def looks_at(
    shape: tuple[int, int],
    pixels: int,
    frequencies: int = 1,
    stands: Sequence[Sequence[float]] = STANDS,
) -> VolumeVisibility:
    """The views of a volume of seven layers with so many nodes, six samples in each prism."""
    rng = np.random.default_rng(29)
    size = (pixels, frequencies)
    views = [view(str(k + 1), np.array(stand), rng, size) for k, stand in enumerate(stands)]
    volume = Grid(size=[SIDE, SIDE], shape=list(shape), layers=7, thickness=0.024)
    return VolumeVisibility(views, LASER, volume.prisms(), volume.rule())


@pytest.fixture(scope="session")
def make_looks() -> Callable[..., VolumeVisibility]:
    return looks_at
