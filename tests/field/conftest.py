"""Volumes, views around them, and views whose every sample is a pixel of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.sparse import csr_array

from sldvexp.field import SampleVisibility, View, VolumeVisibility
from sldvexp.image.interpolation.base import Located
from sldvexp.laser import Mirror, TwoMirror, project
from sldvexp.volume import Prisms, SampleRule, extruded, tensor_rule

LASER = TwoMirror(mirror_offset=0.045, up_down=Mirror(25), left_right=Mirror(25))
#: Where the instrument stands, m; the volume is around the origin.
STANDS = np.array(
    [
        [0.0, -0.5, 1.6],
        [0.6, 0.5, 1.5],
        [0.3, 0.3, 1.6],
        [-0.5, 0.4, 1.5],
        [0.6, -0.2, 1.5],
        [-0.3, -0.1, 1.7],
        [0.0, 0.1, 1.8],
        [-0.6, -0.5, 1.6],
        [0.2, -0.6, 1.7],
        [0.1, 0.7, 1.6],
        [-0.4, 0.1, 1.9],
        [0.45, 0.0, 1.4],
    ]
)
#: Half the size of the volume, m.
HALF = 0.2


def plate(
    shape: tuple[int, int] = (6, 5), layers: int = 4, thickness: float = 0.02, radius: float = 0.0
) -> Prisms:
    """A grid of triangles, flat or bent to a cylinder about y, with layers along its normals."""
    x, y = np.meshgrid(*(np.linspace(-HALF, HALF, n) for n in shape), indexing="ij")
    x, y = x.ravel(), y.ravel()
    angle = x / radius if radius else 0 * x
    surface = np.stack([x, y, 0 * x], axis=1)
    if radius:
        surface = np.stack([radius * np.sin(angle), y, radius * (np.cos(angle) - 1)], axis=1)
    zero, one, s, c = 0 * angle, 1 + 0 * angle, np.sin(angle), np.cos(angle)
    rows = [[c, zero, -s], [zero, one, zero], [s, zero, c]]
    frame = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
    i = (np.arange(shape[0] - 1)[:, None] * shape[1] + np.arange(shape[1] - 1)).ravel()
    n = shape[1]
    triangles = np.concatenate(
        [np.stack([i, i + n, i + 1], axis=1), np.stack([i + n, i + n + 1, i + 1], axis=1)]
    )
    return extruded(surface, triangles, frame, np.linspace(-thickness / 2, thickness / 2, layers))


def rotation_towards(origin: np.ndarray) -> np.ndarray:
    """World to laser, the beam's rest position through the world's origin."""
    z = -origin / np.linalg.norm(origin)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def views_around(
    count: int,
    pixels: int = 20,
    frequencies: int = 1,
    std: float = 1e-3,
    covariance: np.ndarray | None = None,
) -> list[View]:
    """Lattices of pixels around the volume's image, without any velocity."""
    found = []
    for k, origin in enumerate(STANDS[:count]):
        rotation = rotation_towards(origin)
        corner = np.array([[i, j, m] for i in (-1, 1) for j in (-1, 1) for m in (-1.3, 0.1)])
        in_laser = (corner * [HALF, HALF, 0.05] - origin) @ rotation.T
        dac = LASER.dac_from_angle(project(in_laser, LASER.mirror_offset))
        margin = 0.05 * np.ptp(dac, axis=0)
        axes = np.linspace(dac.min(axis=0) - margin, dac.max(axis=0) + margin, pixels).T
        lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        total = pixels**2
        velocity = np.zeros((total, frequencies), complex)
        flags, noise = np.zeros(total, int), np.full(total, std)
        shape = (pixels, pixels)
        view = View(
            str(k + 1), rotation, origin, covariance, lattice, velocity, noise, flags, shape
        )
        found.append(view)
    return found


@dataclass(eq=False)
class EverySample(VolumeVisibility):
    """Looks whose pixels are the samples themselves: nothing is interpolated.

    Parameters
    ----------
    seen : ndarray of bool, shape (sample, view)
        Which view sees which sample.
    """

    seen: np.ndarray | None = None

    def at(self, triangles: np.ndarray) -> SampleVisibility:
        look = super().at(triangles)
        prisms, points = self.prisms, self.rule.points
        count = len(prisms.triangles)
        prism = np.arange(prisms.gaps)[:, None] * count + triangles
        sample = (prism.reshape(-1, 1) * points + np.arange(points)).ravel()
        total = prisms.gaps * count * points
        each = []
        for k, s in enumerate(look.by_view):
            valid = np.ones(len(sample), bool) if self.seen is None else self.seen[sample, k]
            indptr = np.concatenate([[0], np.cumsum(valid)])
            weights = csr_array(
                (np.ones(valid.sum()), sample[valid], indptr), shape=(len(sample), total)
            )
            nowhere = Located(*(a[:0] for a in s.located[:3]), *s.located[3:])
            each.append(replace(s, valid=valid, weights=weights, located=nowhere))
        return replace(look, by_view=tuple(each))


def every_sample(
    prisms: Prisms,
    rule: SampleRule,
    count: int,
    nodal: np.ndarray,
    *,
    local: bool = False,
    seen: np.ndarray | None = None,
    noise: np.ndarray | None = None,
) -> EverySample:
    """Views that see a field of the element space, exactly or with noise.

    Parameters
    ----------
    nodal : ndarray, shape (node, 3 or 4, frequency)
        Components in the world or along the frames, and perhaps an intercept.
    noise : ndarray, shape (view, sample, frequency), optional
    """
    from sldvexp.volume import shape_matrix

    views = views_around(count)
    everywhere = VolumeVisibility(views, LASER, prisms, rule).at(np.arange(len(prisms.triangles)))
    directions = everywhere.directions
    if local:
        directions = directions @ np.swapaxes(everywhere.frame, 1, 2)
    basis = shape_matrix(prisms, rule)
    u = (basis @ nodal.reshape(len(nodal), -1)).reshape(-1, *nodal.shape[1:])
    velocity = np.einsum("ski,sif->ksf", directions, u[:, :3])
    velocity = velocity + (u[:, 3] if nodal.shape[1] == 4 else 0)
    velocity = velocity + (0 if noise is None else noise)
    samples = len(u)
    pixels = [
        replace(
            view,
            dac=np.stack([np.arange(samples), np.arange(samples) ** 2 % 7], axis=1).astype(float),
            velocity=velocity[k].astype(complex),
            std=np.full(samples, 1e-3),
            flags=np.zeros(samples, int),
            shape=None,
        )
        for k, view in enumerate(views)
    ]
    looks = EverySample(views, LASER, prisms, rule, seen=seen)
    looks.views = pixels
    return looks


@pytest.fixture
def laser() -> TwoMirror:
    return LASER


@pytest.fixture
def make_plate() -> Callable[..., Prisms]:
    return plate


@pytest.fixture
def make_views() -> Callable[..., list[View]]:
    return views_around


@pytest.fixture
def make_every_sample() -> Callable[..., EverySample]:
    return every_sample


@pytest.fixture
def six_points() -> SampleRule:
    return tensor_rule(3, 2)
