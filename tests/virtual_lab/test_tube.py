"""A tube of the virtual lab: natural frequencies, shapes, strain truth, and where beams meet it."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import ConfigError
from sldvexp.geometry import KnownPose
from sldvexp.virtual_lab.modes import Coupling, Direction, EdgeSupport, Mode, RectangularPlate
from sldvexp.virtual_lab.motion import Sheet
from sldvexp.virtual_lab.plate import VibratingPlate
from sldvexp.virtual_lab.tube import Tube, TubeMode, TubeMotion, TubeScene, TubeWall

SHEET = Sheet(70e9, 0.33, 2700.0, 0.002)
WALL = TubeWall(0.1, 0.25, SHEET)


@pytest.mark.parametrize("waves", [2, 3, 4])
def test_rings_have_rayleigh_s_frequencies(waves):
    """``omega^2 = D n^2 (n^2 - 1)^2 / (rho h R^4 (n^2 + 1))``, to what a thin wall stretches."""
    n, r = waves, WALL.radius
    squared = SHEET.bending * n**2 * (n**2 - 1) ** 2 / (SHEET.mass * r**4 * (n**2 + 1))
    shape, hertz = WALL.natural(n, 0, TubeMotion.bending)
    assert hertz == pytest.approx(np.sqrt(squared) / (2 * np.pi), rel=2e-3)
    assert shape == pytest.approx([-1 / n, 0, 1], abs=1e-3)


def test_short_waves_have_donnell_s_frequencies():
    """Of a panel between supported edges, whose half waves are those of the tube; n = 12."""
    n, m = 12, 3
    side = np.pi * WALL.radius / n
    panel = RectangularPlate(
        (side, WALL.length),
        sheet=SHEET,
        curvature=10.0,
        edges=EdgeSupport.supported,
        coupling=Coupling.donnell,
    )
    (donnell,) = panel.modes([Mode(1, m, direction=Direction.normal)]).frequency
    assert WALL.natural(n, m, TubeMotion.bending)[1] == pytest.approx(donnell, rel=0.02)


def test_a_whole_turn_of_the_tube_as_a_ring_takes_no_force():
    assert WALL.natural(1, 0, TubeMotion.bending)[1] == pytest.approx(0.0, abs=1e-2)


def built(**modes):
    tube = Tube(
        center=[0.1, 0.2, -0.3],
        euler=[0.3, 1.1, -0.7],
        radius=0.1,
        length=0.25,
        thickness=0.002,
        modes=modes,
    )
    return VibratingPlate.built(tube)


PLATE = built(one=TubeMode(2, 1, 20.0), two=TubeMode(3, 0, velocity=0.01))


def places(count=60):
    rng = np.random.default_rng(0)
    return rng.uniform([0, 0.01], [2 * np.pi * 0.1, 0.24], (count, 2))


def test_strain_is_that_of_differences_in_space():
    """Of the face's displacement along two tangents."""
    place, f, step = places(), 900.0, 1e-6
    frames = PLATE.axes(PLATE.position(place))

    def moved(at):
        return PLATE.velocity(PLATE.position(at), f) / (2j * np.pi * f)

    gradient = np.zeros((len(place), 2, 3), complex)
    for a in range(2):
        by = step * np.eye(2)[a]
        length = np.linalg.norm(PLATE.position(place + by) - PLATE.position(place - by), axis=1)
        gradient[:, a] = (moved(place + by) - moved(place - by)) / length[:, None]
    local = np.einsum("pax,pbx->pab", gradient, frames[:, :2])
    shear = (local[:, 0, 1] + local[:, 1, 0]) / 2
    wanted = np.stack([local[:, 0, 0], local[:, 1, 1], shear], axis=1)
    found = PLATE.strain(PLATE.position(place), f)
    assert found == pytest.approx(wanted, abs=1e-5 * np.abs(wanted).max())


def test_motion_comes_back_after_a_turn():
    ends = [np.array([[1e-9, 0.1]]), np.array([[2 * np.pi * 0.1 - 1e-9, 0.1]])]
    one, other = (PLATE.velocity(PLATE.position(p), 900.0) for p in ends)
    assert one == pytest.approx(other, rel=1e-6, abs=1e-12)


def test_beams_meet_the_near_wall_from_everywhere():
    center, place = np.array([0.1, 0.2, -0.3]), places(200)
    points, normals = PLATE.position(place), PLATE.axes(PLATE.position(place))[:, 2]
    own = (points - center) @ PLATE.rotation.T
    assert np.hypot(own[:, 0], own[:, 2]) == pytest.approx(0.101)
    for azimuth in np.arange(0, 6.3, 0.7):
        begin = center + 1.5 * np.array([np.sin(azimuth), 0.0, np.cos(azimuth)]) @ PLATE.rotation
        way = points - begin
        far = np.linalg.norm(way, axis=1)
        way /= far[:, None]
        toward = -(way * normals).sum(axis=1)
        at, way = (begin - PLATE.center) @ PLATE.rotation.T, way @ PLATE.rotation.T
        distance, _ = PLATE.surface.meet(np.broadcast_to(at, way.shape), way)
        assert distance[toward > 0.05] == pytest.approx(far[toward > 0.05])
        assert np.all(distance[toward < -0.05] < far[toward < -0.05] - 1e-3)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"radius": 0.001}, "above half the thickness"),
        ({"length": 0.0}, "plate.length"),
        ({"modes": {}}, "at least one mode"),
        ({"modes": {"a": TubeMode(waves=0)}}, "plate.modes.a.waves"),
        ({"modes": {"a": TubeMode(waves=1)}}, "moves the tube as a whole"),
        ({"modes": {"a": TubeMode(half_waves=-1)}}, "plate.modes.a.half_waves"),
    ],
)
def test_tubes_that_cannot_be(settings, told):
    view = {"1": KnownPose([0.0, 3.0, 0.0], [0.0, 0.0, 1.5])}
    known = {"radius": 0.1, "modes": {"oval": TubeMode()}} | settings
    with pytest.raises(ConfigError, match=told):
        TubeScene(views=view, plate=Tube(**known))
