"""Modes of a disc with a hole: plate equation, edges, published frequencies, strain at the hole."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import ConfigError
from sldvexp.virtual_lab.annular import AnnularMode, Annulus, EdgeCondition
from sldvexp.virtual_lab.annular_plate import AnnularPlate, AnnularScene
from sldvexp.virtual_lab.plate import VibratingPlate

FREE, HELD, CLAMPED = EdgeCondition.free, EdgeCondition.supported, EdgeCondition.clamped
NU = 0.3
RADIUS, HOLE = 0.125, 0.03

#: k^2 a^2 of n = 0, 1, 2, 3 nodal diameters and no inner nodal circle at nu = 0.3, by edge and b/a,
#: three digits that are quoted of Leissa (Vibration of Plates, NASA SP-160) without the print.
PUBLISHED = {
    (CLAMPED, 0.1): (10.2, 21.1, 34.5, 51.0),
    (CLAMPED, 0.3): (11.4, 19.5, 32.5, 49.1),
    (CLAMPED, 0.5): (17.7, 22.0, 32.1, 45.8),
    (HELD, 0.3): (4.66, 12.8, 24.1, 38.8),
    (HELD, 0.5): (5.07, 11.6, 22.3, 35.7),
    (FREE, 0.3): (8.36, 18.3, 4.91, 12.3),
    (FREE, 0.5): (9.31, 17.2, 4.28, 11.4),
}
#: Three digits, of which the printed last one is up to a unit and a half off.
PRINTED = 0.005


@pytest.mark.one_in(8)
@pytest.mark.parametrize(("edge", "ratio"), PUBLISHED)
def test_frequencies_are_the_published_ones(edge, ratio):
    plate = Annulus(1.0, ratio, NU, edge)
    found = [plate.shape(n, 0).k ** 2 for n in range(4)]
    assert found == pytest.approx(PUBLISHED[edge, ratio], rel=PRINTED)


def test_frequencies_of_a_ring_clamped_at_its_hole_are_the_published_ones():
    """Blevins, Formulas for Natural Frequency and Mode Shape, b/a = 0.5."""
    plate = Annulus(1.0, 0.5, NU, FREE, CLAMPED)
    found = [plate.shape(n, 0).k ** 2 for n in range(4)]
    assert found == pytest.approx([13.0, 13.3, 14.7, 18.5], rel=PRINTED)


@pytest.mark.one_in(8)
@pytest.mark.parametrize("edge", EdgeCondition)
@pytest.mark.parametrize(("diameters", "circles"), [(0, 0), (1, 0), (2, 1), (3, 0), (12, 2)])
def test_shapes_solve_the_plate_equation_and_keep_the_edges(edge, diameters, circles):
    shape, n = Annulus(RADIUS, HOLE, NU, edge).shape(diameters, circles), diameters
    k = shape.k
    r = np.linspace(HOLE + 1e-3, RADIUS - 1e-3, 50)

    def laplacian(at):
        w, slope, second = (shape.derivative(at, i) for i in range(3))
        return second + slope / at - n**2 * w / at**2

    def by_r(f, h=1e-3 / k):
        return (8 * (f(r + h) - f(r - h)) - (f(r + 2 * h) - f(r - 2 * h))) / (12 * h)

    assert shape.laplacian_slope(r) == pytest.approx(by_r(laplacian), abs=1e-8 * k**3)
    twice = by_r(shape.laplacian_slope) + by_r(laplacian) / r - n**2 * laplacian(r) / r**2
    assert twice == pytest.approx(k**4 * shape.derivative(r, 0), abs=1e-8 * k**4)
    third = by_r(lambda at: shape.derivative(at, 2))
    assert shape.derivative(r, 3) == pytest.approx(third, abs=1e-7 * k**3)

    of = {
        "w": lambda at: shape.derivative(at, 0),
        "slope": lambda at: shape.derivative(at, 1) / k,
        "moment": lambda at: shape.moment(at, NU) / k**2,
        "force": lambda at: shape.edge_force(at, NU) / k**3,
    }
    zero = {FREE: ("moment", "force"), HELD: ("w", "moment"), CLAMPED: ("w", "slope")}
    kept = [(RADIUS, name) for name in zero[edge]] + [(HOLE, name) for name in zero[FREE]]
    assert np.array([of[name](at) for at, name in kept]) == pytest.approx(0.0, abs=1e-8)
    others = [of[name](RADIUS) for name in of if name not in zero[edge]]
    assert min(map(abs, others)) > 1e-4
    assert np.abs(shape.derivative(np.linspace(HOLE, RADIUS, 2001), 0)).max() == pytest.approx(1.0)


@pytest.mark.whole
def test_roots_follow_one_another():
    plate = Annulus(RADIUS, HOLE, NU, HELD)
    shapes = [plate.shape(2, i) for i in range(4)]
    r = np.linspace(HOLE, RADIUS - 1e-6, 4001)
    crossings = [int((np.diff(np.sign(s.derivative(r, 0))) != 0).sum()) for s in shapes]
    assert crossings == [0, 1, 2, 3]
    assert (np.diff([s.k for s in shapes]) > 0).all()


def test_shape_is_found_once_for_all_labs_of_a_plate():
    one, same, other = (Annulus(RADIUS, hole, NU, HELD).shape(2, 0) for hole in (0.03, 0.03, 0.02))
    assert same is one
    assert other is not one


def plate(**settings):
    modes = {
        "ring": AnnularMode(frequency=250.0),
        "two": AnnularMode(2, 0, angle=25.0, frequency=900.0, damping=0.05, velocity=-0.03),
        "more": AnnularMode(3, 1, angle=-10.0, frequency=3000.0),
    }
    settings = {"center": [0.4, 0.1, -0.2], "euler": [0.3, 0.5, -0.2], "modes": modes} | settings
    return VibratingPlate.built(AnnularPlate(**settings))


@pytest.mark.whole
@pytest.mark.parametrize("thickness", [0.003, 0.02])
def test_strain_is_the_gradient_of_the_displacement(thickness):
    ours, f, step = plate(thickness=thickness), 800.0, 1e-5
    rng = np.random.default_rng(3)
    r, angle = rng.uniform(HOLE + 1e-4, RADIUS - 1e-4, 60), rng.uniform(0, 2 * np.pi, 60)
    places = RADIUS + r[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    axes = ours.axes(ours.position(places))

    def displacement(p):
        return ours.velocity(ours.position(p), f) / (2j * np.pi * f)

    by = [
        (displacement(places + d) - displacement(places - d)) / step for d in step / 2 * np.eye(2)
    ]
    e = np.array([[(by[i] * axes[:, j]).sum(1) for j in (0, 1)] for i in (0, 1)])
    found = ours.strain(ours.position(places), f)
    expected = np.stack([e[0, 0], e[1, 1], (e[0, 1] + e[1, 0]) / 2], axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.whole
def test_strain_around_the_hole_peaks_as_a_free_edge_makes_it():
    """At the edge the stress along r is none: e_rr = -nu e_tt; within a radius it falls by half."""
    ours = plate()
    ring = ours.in_modes({"two": 0.0, "more": 0.0})
    r = np.array([HOLE, 2 * HOLE])
    places = RADIUS + np.stack([r, np.zeros(2)], axis=1)
    along, around, shear = ring.strain(ring.position(places), 250.0).T
    assert along[0] == pytest.approx(-0.33 * around[0], rel=1e-9)
    assert shear == pytest.approx(0.0, abs=1e-12)
    assert abs(around[1] / around[0]) < 0.6


def test_beams_meet_the_ring_and_pass_its_hole():
    ours = plate()
    r = np.array([0.0, 0.029, 0.0301, 0.1249, 0.1251, 0.2])
    points = ours.center + np.stack([r, 0 * r, 0 * r], axis=1) @ ours.rotation
    known = np.isfinite(ours.velocity(points, 300.0)).all(axis=1)
    assert known.tolist() == [False, False, True, True, False, False]
    begin = points + ours.rotation[2]
    distance, _ = ours.surface.meet(
        (begin - ours.center) @ ours.rotation.T, np.tile([0.0, 0.0, -1.0], (6, 1))
    )
    assert np.isfinite(distance).tolist() == known.tolist()
    rim = RADIUS + RADIUS * np.stack([np.cos(r), np.sin(r)], axis=1)
    assert np.isfinite(ours.velocity(ours.position(rim), 300.0)).all()


def test_natural_frequencies_are_those_of_the_sheet():
    made = AnnularPlate(modes={"ring": AnnularMode()}).vibration()
    k = Annulus(RADIUS, HOLE, 0.33, HELD).shape(0, 0).k
    stiffness = 70e9 * 0.003**3 / 12 / (1 - 0.33**2)
    assert made.frequency[0] == pytest.approx(
        k**2 * np.sqrt(stiffness / (2700 * 0.003)) / (2 * np.pi), rel=1e-12
    )


@pytest.mark.one_in(8)
@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"hole": 0.125}, "plate.hole: must lie between 0.00125 and 0.11875 m"),
        ({"hole": -0.01}, "plate.hole: must lie between"),
        ({"radius": 0.0}, "plate.radius: must be a positive number, not 0.0"),
        ({"modes": {}}, "plate.modes: give at least one mode"),
        ({"modes": {"m": AnnularMode(diameters=-1)}}, "diameters: must be a number from 0 to 40"),
        ({"modes": {"m": AnnularMode(frequency=0.0)}}, "frequency: must be a positive number"),
        ({"nu": 0.6}, "plate.nu: must lie between -1 and 0.5, not 0.6"),
        ({"thickness": 0.0}, "plate.thickness: must be a positive number, not 0.0"),
    ],
)
def test_no_such_disc(settings, told, lab):
    modes = {"modes": {"m": AnnularMode()}}
    views = lab("annular_plate").scene.views
    with pytest.raises(ConfigError) as refused:
        AnnularScene(views=views, plate=AnnularPlate(**(modes | settings)))
    assert told in str(refused.value)
