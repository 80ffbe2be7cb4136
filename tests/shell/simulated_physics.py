"""Plates whose motion is a sum of sines in closed form: shear, membrane motion, a point force."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from sldvexp.shell import estimate_surface
from sldvexp.virtual_lab.plate import FlatSurface
from tests.shell import simulated_shell as lab

SIZE, THICKNESS = np.array([0.3, 0.25]), 0.003


@dataclass
class SinePlate:
    """A plate whose w is ``sum_mn amplitude_mn sin(m pi s/a) sin(n pi t/b)``, m/s.

    Its face moves along itself by -h/2 (1 - shear k^2) of the slopes of every term, and by
    `along` times low waves of the middle. Beyond s = 0 and t = 0 the face is higher by `bump`, m.
    """

    amplitude: dict[float, np.ndarray]
    shear: float = 0.0
    along: complex = 0.0
    bump: float = 0.0
    center: np.ndarray = field(default_factory=lambda: lab.CENTER)
    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    surface: FlatSurface = field(
        default_factory=lambda: FlatSurface(SIZE, THICKNESS / 2, np.zeros((0, 2, 2)))
    )

    def wave_numbers(self, frequency):
        m, n = self.amplitude[frequency].shape
        return np.pi * np.arange(1, m + 1) / SIZE[0], np.pi * np.arange(1, n + 1) / SIZE[1]

    def derivative(self, place, frequency, i=0, j=0, power=0):
        """Derivatives of w, each term times its k^2 to a power."""
        terms = self.amplitude[frequency]
        p, q = self.wave_numbers(frequency)
        k2 = p[:, None] ** 2 + q**2
        s, t = (np.asarray(place) + SIZE / 2).T
        of_s = p**i * np.sin(np.outer(s, p) + i * np.pi / 2)
        of_t = q**j * np.sin(np.outer(t, q) + j * np.pi / 2)
        return np.einsum("pm,mn,pn->p", of_s, terms * k2**power, of_t)

    def velocity(self, points, frequency):
        place = (np.asarray(points) - self.center)[:, :2]
        arm = -THICKNESS / 2 - self.bump * np.all(place > 0, axis=1)

        def along(i, j):
            slope = self.derivative(place, frequency, i, j)
            return arm * (slope - self.shear * self.derivative(place, frequency, i, j, 1))

        x, y = (np.pi * (place + SIZE / 2) / SIZE).T
        of_middle = self.along * np.stack([np.cos(x) * np.cos(y), np.cos(2 * y)])
        w = self.derivative(place, frequency)
        return np.stack([along(1, 0) + of_middle[0], along(0, 1) + of_middle[1], w], axis=-1)


#: Frequency of the first mode of a plate of aluminium, Hz.
FIRST_MODE = np.sqrt(lab.SHEET.bending_stiffness / lab.SHEET.mass) * np.pi / 2 * sum(1 / SIZE**2)


def forced(frequency, force, place, loss=0.02, waves=40, sheet=lab.SHEET):
    """Amplitudes of a simply supported plate that a force acts on at a place from its middle."""
    number = np.arange(1, waves + 1)
    p, q = (np.pi * number / side for side in SIZE)
    at_s, at_t = (np.sin(k * (x + b / 2)) for k, x, b in zip((p, q), place, SIZE, strict=True))
    k4 = (p[:, None] ** 2 + q**2) ** 2
    omega = 2 * np.pi * frequency
    stiffness = sheet.bending_stiffness * (1 + 1j * loss) * k4 - sheet.mass * omega**2
    return 1j * omega * 4 * force * np.outer(at_s, at_t) / SIZE.prod() / stiffness


def mode(m, n, size=0.02):
    """Amplitudes of one mode, real."""
    terms = np.zeros((4, 4), complex)
    terms[m - 1, n - 1] = size
    return terms


def estimated(
    truth, rng, frequency=(197.0,), offset=0.0, pose_std=None, sheet=lab.SHEET, **settings
):
    """Shell field of noisy images, on a surface that is given too high by `offset`, m."""
    errors, covariance = None, None
    if pose_std is not None:
        std = np.tile(np.repeat(pose_std, 3), len(lab.PLACES))
        errors, covariance = (std * rng.normal(size=len(std))).reshape(-1, 6), np.diag(std**2)
    images = lab.views(truth, rng, lab.FINE, frequency=frequency, errors=errors)
    volume = lab.volume()
    volume.center = [*volume.center[:2], offset]
    return field_of(images, volume, frequency, sheet, covariance, **settings)


def field_of(images, volume, frequency, sheet=lab.SHEET, covariance=None, **settings):
    """Shell field of images, of fewer splines than it would be by default."""
    method = lab.method(**{"cells": 8, "membrane_cells": 4, **settings})
    known = {"frequency": frequency, "covariance": covariance}
    return estimate_surface(images, lab.LASER, volume, method, sheet, **known)


def renoised(found, truth, rng, noise=lab.NOISE):
    """The same field with new noise on its pixels, and the motion along them that was found."""
    fit, images = found.fit, []
    for pixels in fit.pixels:
        points = fit.outline.chart.points(pixels.coordinates, fit.face)
        frames = fit.outline.chart.frames(pixels.coordinates)
        toward = np.einsum("pa,pai->pi", pixels.cosine, frames)
        one = [np.einsum("pi,pi->p", truth.velocity(points, f), toward) for f in found.frequency]
        clean = np.stack(one, axis=1)
        shaken = noise * (rng.normal(size=clean.shape) + 1j * rng.normal(size=clean.shape))
        image = np.zeros((len(pixels.view.dac), clean.shape[1]), complex)
        image[pixels.pixel] = clean + shaken
        images.append(image)
    return replace(found, fit=replace(fit, measured=replace(fit.measured, images=images)))
