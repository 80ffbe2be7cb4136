"""Views of a plate of the virtual lab with noise of their own, without a session."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sldvexp.field import View
from sldvexp.geometry import rotation_from_euler
from sldvexp.laser import project, rays
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.shell import Isotropic, Shell
from sldvexp.virtual_lab.modes import Direction, Mode
from sldvexp.virtual_lab.plate import Plate, VibratingPlate
from sldvexp.volume.grid import Grid

LASER = TwoMirror()
FREQUENCY = 197.0
SHEET = Isotropic(thickness=0.003)
CENTER = np.array([0.42, 0.14, 0.0])
PLACES = (
    ([0.024, 2.910, -3.117], [0.290, 0.530, 1.655]),
    ([-0.955, 2.695, 2.139], [0.899, 0.564, 1.533]),
    ([-0.927, 2.913, 2.202], [0.608, 0.372, 1.656]),
    ([2.075, 2.988, -1.072], [0.073, 0.015, 1.680]),
    ([-1.749, 2.790, 1.403], [0.876, 0.036, 1.596]),
)
NOISE = 3e-5
#: Pixels of an image, and those of one that shows what lies at an edge.
PIXELS, FINE = (15, 17), (21, 25)
FACE_POSES = tuple((rotation_from_euler(euler), np.array(origin)) for euler, origin in PLACES)
#: Those of the face turned by half a turn about the plate's own x.
BEHIND = np.diag([1.0, -1.0, -1.0])
BACK_POSES = tuple((r @ BEHIND, CENTER + BEHIND @ (o - CENTER)) for r, o in FACE_POSES)


def plate(radius=None, stretch=0.2, thickness=0.003, shear=0.0, in_phase=0.0):
    """The plate of the lab; stretch is the velocity of its modes along itself, m/s.

    Shear takes such a part of the slope of the mode of one half wave along each side. In phase with
    that mode, the middle moves along itself with a velocity of its own, m/s.
    """
    modes = {
        "bending": Mode(1, 1, 197.0, velocity=0.02),
        "other": Mode(2, 1, 439.0, velocity=0.02),
        "x": Mode(1, 0, 9000.0, velocity=stretch, direction=Direction.x),
        "y": Mode(0, 1, 10800.0, velocity=stretch, direction=Direction.y),
    }
    if in_phase:
        modes["x_in_phase"] = Mode(1, 0, 197.0, velocity=in_phase, direction=Direction.x)
        modes["y_in_phase"] = Mode(0, 1, 197.0, velocity=in_phase / 1.2, direction=Direction.y)
    return VibratingPlate.built(
        Plate(
            center=CENTER.tolist(),
            radius=radius,
            thickness=thickness,
            shear=shear > 0,
            shear_share=shear or None,
            modes=modes,
        )
    )


def volume(radius=None, shape=(13, 11)):
    return Grid(
        center=CENTER.tolist(),
        size=[0.26, 0.21],
        shape=list(shape),
        radius=radius,
        layers=2,
        margin=0.02,
    )


def views(
    truth,
    rng,
    pixels=PIXELS,
    noise=NOISE,
    frequency=(FREQUENCY,),
    errors=None,
    poses=FACE_POSES,
    first=1,
):
    """Images of places spread over the plate, with poses that are off by `errors`, (view, 6)."""
    made = []
    sides = zip(truth.surface.size, pixels, strict=True)
    s, t = (np.linspace(0.003, b - 0.003, n) for b, n in sides)
    place = np.stack(np.meshgrid(s, t, indexing="ij"), axis=-1).reshape(-1, 2)
    place = place[truth.surface.inside(place)]
    spots = truth.center + truth.surface.position(place) @ truth.rotation
    for k, (rotation, origin) in enumerate(poses):
        angle = project((spots - origin) @ rotation.T, LASER.mirror_offset)
        _, along = rays(angle, LASER.mirror_offset)
        velocity = np.stack(
            [np.einsum("pi,pi->p", truth.velocity(spots, f), -along @ rotation) for f in frequency],
            axis=1,
        )
        shaken = noise * (rng.normal(size=velocity.shape) + 1j * rng.normal(size=velocity.shape))
        view = View.from_arrays(
            str(k + first), rotation, origin, velocity + shaken, noise, angle=angle, laser=LASER
        )
        made.append(view if errors is None else view.moved(-errors[k]))
    return made


def views_of_both_sides(truth, rng, some=(0, 3, 4), errors=None, **settings):
    """Some views of the face, and as many of the back."""
    behind = replace(truth, surface=replace(truth.surface, height=-truth.surface.height))
    count, face, back = len(some), [FACE_POSES[k] for k in some], [BACK_POSES[k] for k in some]
    of_face, of_back = (None, None) if errors is None else (errors[:count], errors[count:])
    return [
        *views(truth, rng, poses=face, errors=of_face, **settings),
        *views(behind, rng, poses=back, errors=of_back, first=count + 1, **settings),
    ]


def method(**settings):
    return Shell(**settings)
