"""How often the bounds of a field hold the truth, over whole virtual sessions.

A session takes one image of a wide, smoothly moving plate from each of five places in the virtual
lab, with its noise; what is known of where it stood is the truth plus an error that is drawn from
the poses' covariance. Compared is the layer of nodes that lies on the plate.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from sldvexp.config.registry import get
from sldvexp.field import View, VolumeVisibility
from sldvexp.field.estimate import solve_field
from sldvexp.geometry import KnownPose, rotation_from_vector
from sldvexp.image import Interpolation
from sldvexp.instrument import Acquisition
from sldvexp.laser import TwoMirror
from sldvexp.signal import SineFit
from sldvexp.virtual_lab import VirtualLab
from sldvexp.virtual_lab.modes import EdgeSupport, Mode
from sldvexp.virtual_lab.plate import Plate, PlateScene
from sldvexp.volume import Grid

LASER = TwoMirror(mirror_offset=0.0)
VIEWS = {
    "1": KnownPose([0.024, 2.910, -3.117], [0.290, 0.530, 1.655]),
    "2": KnownPose([-0.955, 2.695, 2.139], [0.899, 0.564, 1.533]),
    "3": KnownPose([-0.927, 2.913, 2.202], [0.608, 0.372, 1.656]),
    "4": KnownPose([2.075, 2.988, -1.072], [0.073, 0.015, 1.680]),
    "5": KnownPose([-1.749, 2.790, 1.403], [0.876, 0.036, 1.596]),
}
CENTER = [0.42, 0.14, 0.0]
FREQUENCY = 200.0
#: Much wider than the volume, so that elements and pixels leave nothing out: two bending modes, one
#: at resonance and one off it, both steepest in the middle, and motion in the plane.
PLATE = Plate(
    center=CENTER,
    size=[1.2, 1.0],
    thickness=0.003,
    edges=EdgeSupport.free,
    modes={
        "across": Mode(1, 0, FREQUENCY, 0.01, 0.06),
        "along": Mode(0, 1, 0.98 * FREQUENCY, 0.02, 0.05),
    },
)
#: Through the plate's surface, 1.5 mm above its middle one, and thin: off that surface each view
#: sees another place of the plate.
VOLUME = Grid(
    center=CENTER,
    size=[0.2, 0.16],
    shape=[9, 7],
    layers=3,
    thickness=0.0004,
    offset=0.0015,
)
PIXELS, SAMPLES = 15, 128
#: Standard deviations of a pose: rotation about each axis, rad, and origin along each, m.
#: The first matters as much as the velocities' noise, the second is usual for marks pointed at by
#: hand and shows in the velocity far above the noise.
FAIR, BY_HAND = (1e-4, 3e-4), (3e-4, 1e-3)
#: Nodes of a session share its poses' errors, so that the session is what is independent: its share
#: of intervals that hold varies by no more than this (0.038 and 0.040 over 200 sessions).
FAIR_STD = 0.045
OUT_OF_PLANE = np.array([False, False, True])


@dataclass(frozen=True)
class Coverage:
    """Shares of intervals that hold the truth, in and out of the plane."""

    with_pose: np.ndarray
    without_pose: np.ndarray


def covariance_of(quality: tuple[float, float]) -> np.ndarray:
    return np.diag(np.repeat(np.square(quality), 3))


def lattice(lab: VirtualLab, corners: np.ndarray) -> np.ndarray:
    """Pixels over what the volume fills in the image, with a margin."""
    dac = lab.true_dac(corners)
    margin = 0.1 * np.ptp(dac, axis=0)
    low, high = dac.min(axis=0) - margin, dac.max(axis=0) + margin
    axes = np.rint(np.linspace(low, high, PIXELS)).astype(int).T
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)


def session(seed: int, quality: tuple[float, float]) -> Coverage:
    """One session: images, poses with errors, the field, and how it stands to the truth."""
    scene = PlateScene(views=VIEWS, plate=PLATE)
    lab = VirtualLab(scene, LASER, seed=[7, seed])
    acquisition = Acquisition(25600.0, SAMPLES, (FREQUENCY,))
    lab.configure(acquisition)
    rng, covariance = lab.generator("poses"), covariance_of(quality)
    prisms = VOLUME.prisms()
    views = []
    for name in VIEWS:
        lab.use_view(name)
        dac = lattice(lab, prisms.position.reshape(-1, 3))
        s = lab.scan(dac)
        image = SineFit().demodulate(
            s.counts,
            np.arange(SAMPLES) / s.rate,
            [FREQUENCY],
            volts_per_count=s.volts_per_count,
        )
        rotation, origin = lab.true_pose(name)
        error = rng.multivariate_normal(np.zeros(6), covariance)
        views.append(
            View(
                name,
                rotation_from_vector(error[:3]) @ rotation,
                origin + error[3:],
                covariance,
                dac.astype(float),
                image.velocity,
                image.std,
                image.flags,
                (PIXELS, PIXELS),
            )
        )
    looks = VolumeVisibility(views, LASER, prisms, VOLUME.rule(), Interpolation.cubic)
    method, solver = get("reconstruction", "absolute")(), get("solver", "iterative")()
    result = solve_field(looks, method, solver)
    nodes = len(prisms.position.reshape(-1, 3)) // VOLUME.layers
    surface = slice(nodes, 2 * nodes)
    truth = lab.plate.velocity(prisms.position.reshape(-1, 3)[surface], FREQUENCY)
    error = result.velocity[surface, :, 0] - truth
    error = np.abs(np.stack([error.real, error.imag]))
    both = result.std_by_part[:, surface, :, 0]
    factor = result.confidence_by_part[:, surface, :, 0] / both
    noise = factor * result.std_noise[surface, :, 0]
    return Coverage(shares(error <= factor * both), shares(error <= noise))


def shares(inside: np.ndarray) -> np.ndarray:
    """Of the components in the plane, and of that out of it."""
    return np.array([inside[..., ~OUT_OF_PLANE].mean(), inside[..., OUT_OF_PLANE].mean()])


def coverage(sessions: int, quality: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Shares of every session with and without the poses' part, shape (session, 2) each."""
    found = [session(seed, quality) for seed in range(sessions)]
    return np.array([f.with_pose for f in found]), np.array([f.without_pose for f in found])


@pytest.mark.whole
def test_bounds_hold_in_some_sessions() -> None:
    sessions = 5
    held, without = coverage(sessions, FAIR)
    off = 3.5 * FAIR_STD / np.sqrt(sessions)
    np.testing.assert_allclose(held.mean(axis=0), 0.95, atol=off)
    assert without.mean() < 0.95 - off


@pytest.mark.long
def test_bounds_hold_in_and_out_of_the_plane() -> None:
    """Three standard errors of 200 sessions are less than 0.0096, half of what is allowed."""
    held, without = coverage(200, FAIR)
    assert np.all(held.std(axis=0) < FAIR_STD)
    assert np.all(np.abs(held.mean(axis=0) - 0.95) <= 0.02)
    assert np.all(without.mean(axis=0) < 0.9)


@pytest.mark.long
def test_bounds_of_noise_alone_fail_with_poses_made_by_hand() -> None:
    sessions = 60
    held, without = coverage(sessions, BY_HAND)
    error = held.std(axis=0, ddof=1) / np.sqrt(sessions)
    assert np.all(np.abs(held.mean(axis=0) - 0.95) <= 3.5 * error)
    assert np.all(without.mean(axis=0) < 0.7)
