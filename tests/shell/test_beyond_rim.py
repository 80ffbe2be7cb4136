"""Pixels beyond the surface that something shades are left out, and named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.shell import simulated_shell as lab
from tests.shell.test_surface_fields import compared, estimated

#: Half of the volume's sides, m.
HALF = np.array([0.13, 0.105])


def resting(views, here, rng, some=(1,)):
    """The same views, of which some are at rest at pixels that meet the plate at such places."""
    for k, view in enumerate(views):
        if k not in some:
            yield view
            continue
        place = estimated_places(view)
        shaded = here(place)
        noise = lab.NOISE * rng.normal(size=(shaded.sum(), 2)).view(complex)
        velocity = view.velocity.copy()
        velocity[shaded] = noise
        yield replace(view, velocity=velocity)


def estimated_places(view):
    """Where beams meet the plane of the plate, from its middle, shape (pixel, 2), m."""
    start, along = lab.rays(lab.LASER.angle_from_dac(view.dac), lab.LASER.mirror_offset)
    begin, way = view.origin + start @ view.rotation, along @ view.rotation
    return (begin - (begin[:, 2] / way[:, 2])[:, None] * way)[:, :2] - lab.CENTER[:2]


def beside(place):
    """Some pixels beyond the left side."""
    return (place[:, 0] < -HALF[0] - 0.001) & (np.abs(place[:, 1]) < 0.02)


def told(found):
    return [note for note in found.notes if "beyond the surface's rim" in note]


@pytest.mark.one_in(3)
@pytest.mark.parametrize("seed", range(3))
def test_shaded_pixels_are_left_out_and_named(seed):
    truth, volume = lab.plate(), lab.volume()
    views = lab.views(truth, np.random.default_rng(seed), lab.FINE)
    clean = compared(estimated(views, volume), truth)[0]
    shaded = list(resting(views, beside, np.random.default_rng(seed + 9)))
    count = int(beside(estimated_places(views[1])).sum())
    found = estimated(shaded, volume)
    assert 2 <= count <= 8
    assert told(found) == [
        f"{count} pixels of view 2 beyond the surface's rim left out, which do not move as the "
        "structure does: something stands in the beam there, or the structure ends before "
        "volume.margin does"
    ]
    errors, held = compared(found, truth)
    assert np.all(errors < 1.3 * clean)
    assert held.mean() > 0.9


@pytest.mark.whole
def test_good_pixels_stay():
    truth, volume = lab.plate(), lab.volume()
    for seed in range(12):
        assert not told(estimated(lab.views(truth, np.random.default_rng(seed), lab.FINE), volume))
