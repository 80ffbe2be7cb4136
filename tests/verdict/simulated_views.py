"""Views of a shallow panel with known mistakes, made without any lab, for many sessions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from sldvexp import dataset
from sldvexp.field import View
from sldvexp.field.bounds.pose_uncertainty import pose_covariance
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import pose_to_dataset
from sldvexp.verdict.beams import MeasuredSurface, PixelBeams
from sldvexp.verdict.comparison import Bench, bench_of
from sldvexp.verdict.joint_fit import JointFit
from sldvexp.volume import Grid

LASER = TwoMirror()
#: Standard errors of rotation (rad) and origin (m) of poses, and of the velocity (m/s).
LOOSE, TIGHT = (3e-4, 1e-3), (2e-5, 5e-5)
NOISE = 1e-4
DISTANCE, TILT = 1.7, np.radians(27.0)


def surface(elements: int = 8) -> Grid:
    """Make a panel of a cylinder, 0.24 by 0.19 m."""
    return Grid(
        radius=0.6, size=[0.24, 0.19], shape=[elements + 1, elements - 1], layers=3, thickness=0.006
    )


def poses(views: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Stand around the panel, one view in front and the others inclined."""
    found = []
    for k in range(views):
        tilt = np.radians(3.0) if k == 0 else TILT + np.radians(3.0) * np.cos(4.0 * k)
        turn = 2 * np.pi * (k + 0.3 * np.sin(5.0 * k)) / max(views - 1, 1)
        toward = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)])
        origin = DISTANCE * toward
        up = np.array([0.0, 1.0, 0.0])
        z = -toward
        x = np.cross(up, z)
        x /= np.linalg.norm(x)
        found.append((np.stack([x, np.cross(z, x), z]), origin))
    return found


def velocity(point: np.ndarray, frequency: int = 0) -> np.ndarray:
    """Give a bending wave of 20 mm/s with some motion in the plane, shape (point, 3)."""
    x, y, _ = point.T
    a, b = (2 * np.pi * (0.9 + 0.3 * frequency), 2 * np.pi * (0.7 + 0.2 * frequency))
    w = 0.02 * np.cos(a * x + 0.3) * np.cos(b * y - 0.2) * np.exp(0.4j * frequency)
    u = 0.003 * np.sin(a * x) * (1 + 0.5j)
    v = 0.002 * np.cos(b * y) * (0.7 - 0.4j)
    return np.stack([u, v, w], axis=1)


def other_velocity(point: np.ndarray, frequency: int = 0) -> np.ndarray:
    """Give another field, as of another frequency."""
    x, y, _ = point.T
    w = 0.02 * np.sin(2 * np.pi * 1.1 * x) * np.sin(2 * np.pi * 1.3 * y + 0.4) * (0.8 + 0.6j)
    return np.stack([0.1 * w, -0.05 * w, w], axis=1)


@dataclass
class Session:
    """Views as stated, at poses that truly are a little off."""

    views: list[View]
    surface: MeasuredSurface
    truth: np.ndarray
    turned: list[np.ndarray]


def session(
    rng: np.random.Generator,
    views: int = 5,
    std: tuple[float, float] = LOOSE,
    noise: float = NOISE,
    pixels: int = 31,
    frequencies: int = 2,
    mistakes: dict[int, str] | None = None,
    size: float = 0.0,
    elements: int = 8,
) -> Session:
    """Image the panel from all views, with mistakes of some."""
    volume = surface(elements)
    truth = rng.standard_normal((views, 6)) * np.repeat(std, 3)
    step = np.linspace(-4.6, 4.6, pixels)
    angle = np.radians(np.stack(np.meshgrid(step, step, indexing="ij"), -1).reshape(-1, 2))
    measured = MeasuredSurface.of(volume, LASER)
    found, turned = [], []
    for k, (rotation, origin) in enumerate(poses(views)):
        mistake = (mistakes or {}).get(k, "")
        zero = np.zeros((len(angle), frequencies), complex)
        stated = View.from_arrays(
            f"v{k + 1}",
            rotation,
            origin,
            zero,
            noise,
            angle=angle,
            laser=LASER,
            covariance=np.diag(np.repeat(std, 3) ** 2),
            shape=(pixels, pixels),
        )
        stated = replace(stated, dac=np.round(stated.dac))
        off = truth[k].copy()
        direction = rng.standard_normal(3)
        direction /= np.linalg.norm(direction)
        if mistake == "rotation":
            off[:3] += size * direction
        if mistake == "turned":  # across the beam
            off[:2] += size * direction[:2] / np.linalg.norm(direction[:2])
        if mistake == "origin":
            off[3:] += size * direction
        true = stated.moved(off)
        turned.append(true.rotation @ stated.rotation.T)
        beams = PixelBeams.trace(true, measured, np.arange(len(angle)))
        field = other_velocity if mistake == "other" else velocity
        values = np.stack(
            [
                np.einsum("pi,pi->p", field(beams.point, f), beams.direction)
                for f in range(frequencies)
            ],
            axis=1,
        )
        factor = {
            "sign": -1.0,
            "rms": 0.5**0.5,
            "gain": 1 + size,
            "phase": np.exp(1j * size),
        }.get(mistake, 1.0)
        values = np.conj(values) if mistake == "conjugate" else values * factor
        if mistake == "offset":
            values = values + size * (1 - 0.7j)
        image = np.full_like(zero, np.nan)
        image[beams.pixel] = values
        drawn = rng.standard_normal(zero.shape) + 1j * rng.standard_normal(zero.shape)
        scale = abs(factor)  # what scales the velocities scales their noise and what is said of it
        image += scale * NOISE * drawn
        stated = replace(stated, std=scale * stated.std)
        flags = (~np.isfinite(image).all(axis=1)).astype(int)
        found.append(replace(stated, velocity=image, flags=flags))
    return Session(found, measured, truth, turned)


@cache
def clean() -> tuple[Session, Bench, JointFit]:
    """Fit one session without mistakes for all tests of a process; nobody changes it."""
    made = session(np.random.default_rng(1))
    bench = bench_of(made.views, made.surface, pose_covariance(made.views, None))
    assert bench is not None
    return made, bench, bench.fit()


def groups(views: Sequence[View]) -> dict[str, xr.Dataset]:
    """Make the groups of a run: poses as stated, and images."""
    found = {
        "pose": pose_to_dataset(
            [v.name for v in views],
            [v.rotation for v in views],
            [v.origin for v in views],
            [v.covariance for v in views],
            [np.inf] * len(views),
            0.95,
        )
    }
    for view in views:
        found[f"image/{view.name}"] = dataset.group(
            "image",
            {"frequency": 100.0 * np.arange(1, view.velocity.shape[1] + 1)},
            velocity=view.velocity,
            velocity_std=np.broadcast_to(view.std[:, None], view.velocity.shape),
            dac=view.dac,
            flags=view.flags.astype(np.uint8),
        ).assign_attrs(shape=list(view.shape))
    return found
