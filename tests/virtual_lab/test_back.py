"""Plates of the virtual lab as beams from behind see them."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.virtual_lab.beam import Beams, Spot
from tests.shell import simulated_shell as lab


@pytest.mark.parametrize("radius", [None, 0.5, -0.5])
def test_a_beam_from_behind_meets_the_lower_surface_and_its_motion(radius):
    """Half a thickness below the middle, where the slopes move it the other way."""
    plate = lab.plate(radius)
    place = plate.surface.size * [0.2, 0.3]
    back = plate.surface.back
    (point,), (frame,) = back.position(place[None]), back.frame(place[None])
    along = np.array([0.3, 0.2, 0.9]) @ frame
    along /= np.linalg.norm(along)
    begin = point - 0.2 * along + plate.center
    beams = Beams(begin[None], along[None], Spot())
    distance, velocity = plate.seen(beams, np.array([lab.FREQUENCY]))
    assert distance == pytest.approx([0.2])
    height, curvature = -plate.surface.height, plate.surface.curvature
    motion = plate.modes.motion(place[None], height, curvature)[0]
    response = plate.modes.response(np.array([lab.FREQUENCY]))[:, 0]
    assert velocity[0, 0] == pytest.approx(-along @ frame.T @ (motion.T @ response))
    of_face = plate.modes.motion(place[None], -height, curvature)[0]
    assert abs(velocity[0, 0] + along @ frame.T @ (of_face.T @ response)) > 1e-5
