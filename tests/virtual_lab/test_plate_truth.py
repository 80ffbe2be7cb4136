"""The plate's velocity and strain in closed form, against differences and against the beam."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.units import LengthUnit
from sldvexp.virtual_lab.beam import beams
from sldvexp.virtual_lab.modes import Direction, EdgeSupport, Mode
from sldvexp.virtual_lab.plate import Plate, VibratingPlate

RADII = [None, 0.3, -0.3]
SIZE = [0.3, 0.25]
STEP = 1e-5  # of the differences: errors of (wave number x step)^2 / 6 = 2e-8


def plate(radius, edges=EdgeSupport.supported, thickness=0.02):
    modes = {
        "bending": Mode(2, 1, 400.0, 0.02, 0.02),
        "more_bending": Mode(3, 2, 900.0, 0.05, -0.03),
        "along_x": Mode(1, 2, 700.0, 0.1, 0.01, Direction.x),
        "along_y": Mode(2, 0, 1500.0, 0.01, 0.02, Direction.y),
    }
    return VibratingPlate.built(
        Plate(
            center=[0.4, 0.1, -0.2],
            euler=[0.3, 0.5, -0.2],
            size=SIZE,
            thickness=thickness,
            radius=radius,
            edges=edges,
            modes=modes,
        )
    )


@pytest.fixture
def places():
    return np.random.default_rng(2).uniform(0.01, np.array(SIZE) - 0.01, (40, 2))


def difference(function, places, axis, step=STEP):
    """Central difference of a function of coordinates of the middle surface."""
    h = np.zeros(2)
    h[axis] = step / 2
    return (function(places + h) - function(places - h)) / step


@pytest.mark.parametrize("edges", EdgeSupport)
@pytest.mark.parametrize("radius", RADII)
def test_strain_is_the_gradient_of_the_displacement(places, radius, edges):
    ours = plate(radius, edges)
    f = 450.0
    points = ours.position(places)
    tangents = [difference(ours.position, places, a) for a in (0, 1)]
    lengths = [np.linalg.norm(t, axis=1, keepdims=True) for t in tangents]
    axes = ours.axes(points)
    for i in (0, 1):
        np.testing.assert_allclose(tangents[i] / lengths[i], axes[:, i], atol=1e-9)

    def displacement(p):
        return ours.velocity(ours.position(p), f) / (2j * np.pi * f)

    gradient = [difference(displacement, places, a) / lengths[a] for a in (0, 1)]
    e = np.array([[(gradient[i] * axes[:, j]).sum(1) for j in (0, 1)] for i in (0, 1)])
    found = ours.strain(points, f)
    expected = np.stack([e[0, 0], e[1, 1], (e[0, 1] + e[1, 0]) / 2], axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())
    assert (np.abs(found).max(axis=0) > 1e-2 * np.abs(found).max()).all()


def test_strain_along_other_axes_is_the_same_tensor(places):
    ours = plate(0.3)
    points = ours.position(places)
    axes, (ss, tt, st) = ours.axes(points), ours.strain(points, 450.0).T
    c, s = np.cos(0.4), np.sin(0.4)
    turned = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ axes
    found = ours.strain(points, 450.0, turned).T
    assert found[0] == pytest.approx(c * c * ss + s * s * tt + 2 * c * s * st)
    assert found[1] == pytest.approx(s * s * ss + c * c * tt - 2 * c * s * st)
    assert found[2] == pytest.approx(c * s * (tt - ss) + (c * c - s * s) * st)
    assert pytest.approx(np.array([ss, tt, st])) == ours.strain(points, 450.0, axes).T


@pytest.mark.parametrize("radius", RADII)
def test_normals_stay_straight_and_normal(places, radius):
    """Love and Kirchhoff: no shear between surfaces at two heights, no change of thickness."""
    f, h = 450.0, 1e-4
    below, middle, above = (plate(radius, thickness=2 * z) for z in (0.01 - h, 0.01, 0.01 + h))
    axes = middle.axes(middle.position(places))
    rise = (
        above.velocity(above.position(places), f) - below.velocity(below.position(places), f)
    ) / (2 * h)
    length = np.linalg.norm(difference(middle.position, places, 0), axis=1)
    by_s = difference(lambda p: middle.velocity(middle.position(p), f), places, 0)
    by_t = difference(lambda p: middle.velocity(middle.position(p), f), places, 1)
    scale = np.abs(rise).max()
    shear_s = (rise * axes[:, 0]).sum(1) + (by_s * axes[:, 2]).sum(1) / length
    shear_t = (rise * axes[:, 1]).sum(1) + (by_t * axes[:, 2]).sum(1)
    assert np.abs(shear_s).max() < 1e-6 * scale
    assert np.abs(shear_t).max() < 1e-6 * scale
    assert np.abs((rise * axes[:, 2]).sum(1)).max() < 1e-9 * scale
    assert scale > 0.05


@pytest.mark.one_in(2)
@pytest.mark.parametrize("radius", RADII)
def test_the_beam_sees_v_dot_d_where_it_hits(quiet, radius):
    turned = "scene.plate.euler=[0.3, 0.2, -0.1]"
    bent = f"scene.plate.radius={radius or 'null'}"
    made = quiet("plate", turned, bent, "scene.plate.edges=free")
    ours, frequency = made.plate, np.array([300.0, 450.0])
    places = np.random.default_rng(3).uniform(0, SIZE, (60, 2))
    points = ours.position(places)
    for view in made.scene.views:
        made.use_view(view)
        rotation, origin = made.true_pose(view)
        beam = beams(made.mirrors, made.true_dac(points), rotation, origin, made.scene.spot)
        distance, velocity = ours.seen(beam, frequency)
        hit = beam.origin + distance[:, None] * beam.direction
        np.testing.assert_allclose(hit, points, atol=1e-12)
        for k, f in enumerate(frequency):
            expected = -(ours.velocity(points, f) * beam.direction).sum(1)
            np.testing.assert_allclose(velocity[:, k], expected, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("radius", RADII)
def test_points_off_the_surface_stand_for_the_nearest_on_it(places, radius):
    ours = plate(radius)
    points = ours.position(places)
    above = points + 0.02 * ours.axes(points)[:, 2]
    np.testing.assert_allclose(ours.velocity(above, 450.0), ours.velocity(points, 450.0), rtol=1e-9)
    beside = ours.position([[-0.01, 0.1], [0.1, 0.26], [0.0, 0.25], [0.3, 0.0]])
    assert np.isnan(ours.velocity(beside, 450.0)).all(axis=1).tolist() == [True, True, False, False]
    assert np.isnan(ours.strain(beside, 450.0)).all(axis=1).tolist() == [True, True, False, False]


@pytest.mark.parametrize("radius", [0.3, -0.3])
def test_a_panel_is_a_cylinder(radius):
    """Its normals all leave or meet one line, at the distance of its surface."""
    ours = plate(radius)
    local = (ours.position(np.random.default_rng(1).uniform(0, SIZE, (30, 2))) - ours.center) @ (
        ours.rotation.T
    )
    from_axis = np.hypot(local[:, 0], local[:, 2] + radius)
    np.testing.assert_allclose(from_axis, abs(radius + 0.01), atol=1e-12)
    middle = (ours.position([[0.15, 0.125]]) - ours.center) @ ours.rotation.T
    np.testing.assert_allclose(middle, [[0, 0, 0.01]], atol=1e-12)


def test_far_side_of_a_panel_is_hidden():
    """A beam across a nearly closed tube sees the near side, on which it meets the panel first."""
    tube = VibratingPlate.built(
        Plate(size=[1.8, 0.5], thickness=0.0, radius=0.3, modes={"any": Mode()})
    )
    origin = np.array([[0.1, 0.0, 2.0], [0.1, 0.3, 2.0]])
    direction = np.array([[0.0, 0.0, -1.0]] * 2)
    distance, _ = tube.surface.meet(origin, direction)
    assert distance[0] == pytest.approx(2.0 + 0.3 - np.sqrt(0.09 - 0.01))
    assert distance[1] == np.inf
    inside, _ = tube.surface.meet(np.array([[0.1, 0.0, -0.3]]), direction[:1])
    assert inside[0] == pytest.approx(np.sqrt(0.09 - 0.01))


def test_a_mode_at_resonance_and_far_from_it():
    one = VibratingPlate.built(
        Plate(size=[0.3, 0.25], thickness=0.002, modes={"m": Mode(1, 1, 200.0, 0.01, 0.02)})
    )
    antinode = one.position([[0.15, 0.125]])
    np.testing.assert_allclose(one.velocity(antinode, 200.0), [[0, 0, 0.02]], atol=1e-15)
    below, above = (one.velocity(antinode, f)[0, 2] for f in (20.0, 2000.0))
    # Far below, the stiffness makes velocity lead the force by 90 deg; far above, mass lags it.
    assert np.angle(below) == pytest.approx(np.pi / 2, abs=0.01)
    assert np.angle(above) == pytest.approx(-np.pi / 2, abs=0.01)
    assert abs(below) == pytest.approx(0.02 * 0.02 * 0.1 / 0.99, rel=1e-4)
    quarter = one.velocity(one.position([[0.075, 0.125]]), 200.0)[0]
    wave = np.pi / 0.3
    slope = 0.02 * wave * np.cos(wave * 0.075)
    assert quarter[0] == pytest.approx(-0.001 * slope)
    assert quarter[2] == pytest.approx(0.02 * np.sin(wave * 0.075))


def test_units_scale_the_plate():
    modes = {"m": Mode()}
    in_m = Plate(center=[0.1, 0, 0], size=[0.3, 0.2], thickness=0.004, radius=0.5, modes=modes)
    in_mm = Plate(
        center=[100, 0, 0],
        size=[300, 200],
        thickness=4,
        radius=500,
        modes=modes,
        unit=LengthUnit.mm,
    )
    places = [[0.1, 0.05], [0.2, 0.15]]
    a, b = VibratingPlate.built(in_m), VibratingPlate.built(in_mm)
    np.testing.assert_allclose(a.position(places), b.position(places), rtol=1e-12)
    points = a.position(places)
    np.testing.assert_allclose(a.velocity(points, 210.0), b.velocity(points, 210.0), rtol=1e-9)
