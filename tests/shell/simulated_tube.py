"""Views all around a tube of the virtual lab with noise of their own, without a session."""

from __future__ import annotations

import numpy as np

from sldvexp.field import View
from sldvexp.laser import project, rays
from sldvexp.shell import Isotropic, Shell, estimate_surface
from sldvexp.virtual_lab.plate import VibratingPlate
from sldvexp.virtual_lab.tube import Tube, TubeMode
from sldvexp.volume import Revolution
from tests.shell import simulated_shell as lab

RADIUS, LENGTH, DISTANCE = 0.1, 0.25, 1.6
SHEET = Isotropic(thickness=0.002)
#: Largest angle, deg, between a beam and the surface's normal.
STEEP = 70.0
OVAL, ARCHED = 133.0, 1060.0
MODES = {
    "oval": TubeMode(2, angle=20.0),
    "three": TubeMode(3, angle=5.0),
    "arched": TubeMode(4, 1, angle=30.0, velocity=0.015),
}


def tube(modes=None):
    return VibratingPlate.built(
        Tube(radius=RADIUS, length=LENGTH, thickness=0.002, modes=modes or MODES)
    )


def poses(count=8, above=25.0):
    """Places around the tube, by turns above and below its middle, that look at it."""
    made = []
    for k in range(count):
        phi, up = 2 * np.pi * k / count, np.radians(above if k % 2 == 0 else -above)
        out = np.array([np.sin(phi) * np.cos(up), np.sin(up), np.cos(phi) * np.cos(up)])
        x = np.array([np.cos(phi), 0, -np.sin(phi)])
        made.append((np.stack([x, np.cross(-out, x), -out]), DISTANCE * out))
    return made


def volume(margin=0.008, shape=(36, 9), profile=((RADIUS, -0.115), (RADIUS, 0.115))):
    return Revolution(
        profile=[list(p) for p in profile], shape=list(shape), layers=2, margin=margin
    )


def views(truth, rng, pixels=(25, 25), noise=lab.NOISE, frequency=(OVAL,), errors=None):
    """Images of places spread over the side that each view sees, poses off by `errors`."""
    made = []
    for k, (rotation, origin) in enumerate(poses()):
        across = np.radians(np.linspace(-STEEP, STEEP, pixels[0])) + np.arctan2(
            origin[0], origin[2]
        )
        s = (across * RADIUS + np.pi * RADIUS) % (2 * np.pi * RADIUS)
        t = np.linspace(0.003, LENGTH - 0.003, pixels[1])
        place = np.stack(np.meshgrid(s, t, indexing="ij"), axis=-1).reshape(-1, 2)
        spots = truth.position(place)
        angle = project((spots - origin) @ rotation.T, lab.LASER.mirror_offset)
        _, along = rays(angle, lab.LASER.mirror_offset)
        velocity = np.stack(
            [np.einsum("pi,pi->p", truth.velocity(spots, f), -along @ rotation) for f in frequency],
            axis=1,
        )
        shaken = noise * (rng.normal(size=velocity.shape) + 1j * rng.normal(size=velocity.shape))
        view = View.from_arrays(
            str(k), rotation, origin, velocity + shaken, noise, angle=angle, laser=lab.LASER
        )
        made.append(view if errors is None else view.moved(-errors[k]))
    return made


def estimated(seen, frequency=(OVAL,), method=None, within=None, **known):
    return estimate_surface(
        seen,
        lab.LASER,
        within or volume(),
        method or Shell(cells=18),
        SHEET,
        frequency=list(frequency),
        **known,
    )


def compared(found, truth, frequency):
    """Errors of u, v, w of the face and of its strains over each one's r.m.s. size of all three.

    Returns
    -------
    errors, held : ndarray, shape (6, frequency)
    """
    fit, chart = found.fit, found.fit.outline.chart
    place = fit.outline.corners
    points, frames = chart.points(place, fit.face), chart.frames(place)
    group = found.strain()
    motion = [fit.evaluate(rows) for rows in fit.shell.velocity(place, fit.face)]
    errors, held = np.zeros((6, len(frequency))), np.zeros((6, 2, len(frequency)))
    for k, f in enumerate(frequency):
        true = np.einsum("pij,pj->pi", frames, truth.velocity(points, f))
        strain = truth.strain(points, f, frames)
        for i in range(6):
            if i < 3:
                value, own, others = motion[i]
                std, wanted, size = np.sqrt(own + others)[..., k], true[:, i], true
                error = value[:, k] - wanted
            else:
                error = group["strain"].values[:, i - 3, k] - strain[:, i - 3]
                std, size = group["strain_std_by_part"].values[:, :, i - 3, k], strain
            errors[i, k] = np.sqrt(np.mean(np.abs(error) ** 2) / np.mean(np.abs(size) ** 2) / 3)
            parts = np.stack([error.real, error.imag])
            held[i, :, k] = (np.abs(parts) <= 1.96 * std).mean(axis=1)
    return errors, held
