"""A plate of the virtual lab, its modal images with noise, and finite element models of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sldvexp.dataset import group
from sldvexp.geometry import rotation_from_euler, rotation_from_vector
from sldvexp.laser import TwoMirror, project
from sldvexp.models import FiniteElementModel
from sldvexp.pose import pose_to_dataset
from sldvexp.virtual_lab.attached import PointMass
from sldvexp.virtual_lab.beam import Spot, beams
from sldvexp.virtual_lab.modes import Mode
from sldvexp.virtual_lab.plate import Plate, VibratingPlate

LASER = TwoMirror(mirror_offset=0.03)
CENTER = np.array([0.42, 0.14, 0.0])
A, B, THICKNESS = 0.3, 0.25, 0.003
ORDERS = ((1, 1), (2, 1), (1, 2), (2, 2), (3, 1))
PLACES = (
    ([0.024, 2.910, -3.117], [0.290, 0.530, 1.655]),
    ([-0.955, 2.695, 2.139], [0.899, 0.564, 1.533]),
    ([-0.927, 2.913, 2.202], [0.608, 0.372, 1.656]),
    ([2.075, 2.988, -1.072], [0.073, 0.015, 1.680]),
    ([-1.749, 2.790, 1.403], [0.876, 0.036, 1.596]),
)
#: Peak modal velocities at antinodes, m/s, and the noise of a pixel per part.
VELOCITY, NOISE = (0.02, 0.02, -0.015, 0.01, 0.01), 6e-5
#: Standard errors of a good pose, rad and m.
POSE_STD = np.array([5e-5] * 3 + [2e-5] * 3)


def true_plate(mass: float = 0.0, E: float = 70e9, thickness: float = THICKNESS) -> VibratingPlate:
    """Make the plate of the lab, with a mass at a quarter point, kg."""
    modes = {
        f"bending_{m}_{n}": Mode(m, n, None, velocity=v)
        for (m, n), v in zip(ORDERS, VELOCITY, strict=True)
    }
    masses = {"washer": PointMass([-A / 4, -B / 4], mass)} if mass else {}
    return VibratingPlate.built(
        Plate(center=CENTER.tolist(), modes=modes, masses=masses, E=E, thickness=thickness)
    )


def aimed(
    pose: tuple[np.ndarray, np.ndarray], shape: Sequence[int] = (17, 19), beside: float = 0.0
) -> np.ndarray:
    """DAC steps of a grid of pixels on the plate, or so far beside it, m, shape (pixel, 2)."""
    rotation, origin = pose
    x, y = (np.linspace(-0.46, 0.46, n) * side for n, side in zip(shape, (A, B), strict=True))
    grid = np.stack([*(g.ravel() for g in np.meshgrid(x, y)), np.zeros(x.size * y.size)], axis=1)
    seen = (grid + CENTER + [beside, 0.0, 0.0] - origin) @ rotation.T
    return np.round(LASER.dac_from_angle(project(seen, LASER.mirror_offset)))


def true_poses() -> list[tuple[np.ndarray, np.ndarray]]:
    """Poses of the lab's five views."""
    return [(rotation_from_euler(euler), np.array(origin)) for euler, origin in PLACES]


class Measured:
    """Modal images of the lab's plate without noise, to which noise is added seed by seed."""

    def __init__(self, plate: VibratingPlate, views: int = 5, shape: Sequence[int] = (11, 13)):
        self.plate, self.poses = plate, true_poses()[:views]
        self.dac = [aimed(pose, shape) for pose in self.poses]
        self.frequency = np.array(plate.modes.frequency)
        self.damping = np.array(plate.modes.damping)
        self.velocity = []
        for (rotation, origin), dac in zip(self.poses, self.dac, strict=True):
            sent = beams(LASER, dac, rotation, origin, Spot(waist=0.0))
            own = []
            for name, f in zip(plate.mode_names, self.frequency, strict=True):
                alone = plate.in_modes({n: float(n == name) for n in plate.mode_names})
                own.append(alone.seen(sent, np.array([f]))[1][:, 0])
            self.velocity.append(np.stack(own, axis=-1))

    def tree(self, seed: int, noise: float = NOISE, pose_std: np.ndarray | None = None) -> dict:
        """Make the groups of a run; poses are off by errors of `pose_std`."""
        rng = np.random.default_rng(seed)
        names = [str(k + 1) for k in range(len(self.poses))]
        std = np.zeros(6) if pose_std is None else pose_std
        off = rng.normal(size=(len(names), 6)) * std
        rotation = [
            rotation_from_vector(e[:3]) @ r for e, (r, _) in zip(off, self.poses, strict=True)
        ]
        origin = [o + e[3:] for e, (_, o) in zip(off, self.poses, strict=True)]
        unknown = np.full((6, 6), np.nan) if pose_std is None else np.diag(std**2)
        tree = {
            "pose": pose_to_dataset(
                names, rotation, origin, [unknown] * len(names), [np.inf] * len(names), 0.95
            )
        }
        measured = self.frequency * (1 + 3e-6 * rng.normal(size=len(self.frequency)))
        for name, dac, velocity in zip(names, self.dac, self.velocity, strict=True):
            parts = noise * rng.normal(size=(2, *velocity.shape))
            tree[f"modes/image/{name}"] = group(
                "image",
                {"pixel": np.arange(len(dac)), "frequency": measured},
                velocity=velocity + parts[0] + 1j * parts[1],
                velocity_std=np.full(velocity.shape, noise),
                dac=dac,
                angle=LASER.angle_from_dac(dac),
                flags=np.zeros(len(dac), int),
            )
        return tree | {"modes": self.modes(measured)}

    def modes(self, measured):
        """Make the group of modes."""
        import xarray as xr

        count = len(measured)
        return xr.Dataset(
            {
                "natural_frequency": ("mode", measured),
                "natural_frequency_std": ("mode", 3e-6 * measured),
                "damping_ratio": ("mode", self.damping),
                "damping_ratio_std": ("mode", 3e-4 * self.damping),
            },
            coords={"mode": np.arange(1, count + 1)},
        )


def closed_form(
    n: Sequence[int] = (16, 14),
    *,
    rotations: bool = True,
    triangles: bool = False,
    thickness: float = THICKNESS,
    E: float = 70e9,
    orders: Sequence[tuple[int, int]] = ORDERS,
) -> FiniteElementModel:
    """Make a model whose nodes have the closed form's values, in the plate's place."""
    x, y = (
        g.ravel() for g in np.meshgrid(np.linspace(0, A, n[0] + 1), np.linspace(0, B, n[1] + 1))
    )
    zero = np.zeros_like(x)
    i = np.arange(len(x)).reshape(n[1] + 1, n[0] + 1)
    quads = np.stack([i[:-1, :-1], i[:-1, 1:], i[1:, 1:], i[1:, :-1]], axis=-1).reshape(-1, 4)
    halves = np.zeros((0, 3), int)
    if triangles:
        halves, quads = np.concatenate([quads[:, :3], quads[:, [0, 2, 3]]]), quads[:0]
    shapes, turns, frequency = [], [], []
    stiffness = E * thickness**2 / 12 / (1 - 0.33**2) / 2700.0
    for p, q in orders:
        j, k = p * np.pi / A, q * np.pi / B
        w = np.sin(j * x) * np.sin(k * y)
        w_x, w_y = j * np.cos(j * x) * np.sin(k * y), k * np.sin(j * x) * np.cos(k * y)
        shapes.append(np.stack([zero, zero, w], axis=1))
        turns.append(np.stack([w_y, -w_x, zero], axis=1))
        frequency.append(np.sqrt(stiffness) * (j**2 + k**2) / (2 * np.pi))
    order = np.argsort(frequency)
    return FiniteElementModel(
        np.stack([x - A / 2, y - B / 2, zero], axis=1) + CENTER,
        halves,
        quads,
        np.array(frequency)[order],
        np.stack(shapes, axis=-1)[..., order],
        np.stack(turns, axis=-1)[..., order] if rotations else None,
        thickness,
    )


def thicker(model: FiniteElementModel, factor: float) -> FiniteElementModel:
    """Make the model of a thicker plate, whose frequencies grow with it."""
    return replace(model, frequency=factor * model.frequency, thickness=factor * model.thickness)
