"""Modes of a rectangle: equations, edges, natural frequencies, coupling, shear, and refusals.

Equations are checked on the trigonometric shapes by their derivatives, to 1e-8 and better.
"""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import Checks
from sldvexp.virtual_lab.modes import Coupling, Direction, EdgeSupport, Mode, RectangularPlate
from sldvexp.virtual_lab.motion import Sheet
from sldvexp.virtual_lab.plate import Plate, VibratingPlate

SIZE = (0.3, 0.25)
SHEET = Sheet(70e9, 0.33, 2700.0, 0.003)
PLACES = np.random.default_rng(1).uniform(0, SIZE, (50, 2))


def only(mode, **settings):
    """One mode, its derivatives at PLACES, and the square of its angular frequency."""
    made = RectangularPlate(SIZE, EdgeSupport.supported, SHEET, **settings).modes([mode])
    u, v, w = (lambda i, j, f=f, **at: f(i, j)[:, 0] for f in made.derivatives(PLACES))
    return made, (u, v, w), (2 * np.pi * made.frequency[0]) ** 2


def test_natural_frequencies_are_those_of_the_scene_before_they_were_rounded():
    """The scene's are of a sheet whose modulus differs a little: all by one factor."""
    rounded = {(1, 1): 197.0, (2, 1): 439.0, (1, 2): 545.0, (2, 2): 787.0, (3, 1): 842.0}
    natural = [only(Mode(x, y))[0].frequency[0] for x, y in rounded]
    ratio = np.array(natural) / list(rounded.values())
    assert ratio == pytest.approx(1.01, abs=0.002)
    assert np.ptp(ratio) < 0.5 / 197


def test_bending_solves_the_plate_equation():
    _, (_, _, w), omega2 = only(Mode(3, 2))
    force = SHEET.bending * (w(4, 0) + 2 * w(2, 2) + w(0, 4))
    assert force == pytest.approx(SHEET.mass * omega2 * w(0, 0), rel=1e-10)


@pytest.mark.parametrize("direction", [Direction.compression, Direction.shear])
def test_stretch_is_in_plane_equilibrium_with_its_inertia(direction):
    made, (u, v, _), omega2 = only(Mode(2, 1, direction=direction))
    c, nu, gh = SHEET.stretching, SHEET.nu, SHEET.shearing
    along_x = c * (u(2, 0) + nu * v(1, 1)) + gh * (u(0, 2) + v(1, 1))
    along_y = c * (v(0, 2) + nu * u(1, 1)) + gh * (v(2, 0) + u(1, 1))
    scale = SHEET.mass * omega2
    assert along_x + scale * u(0, 0) == pytest.approx(0.0, abs=1e-9 * scale)
    assert along_y + scale * v(0, 0) == pytest.approx(0.0, abs=1e-9 * scale)
    edge = np.array([[0.0, 0.1], [0.3, 0.2]])
    u, v, _ = made.derivatives(edge)
    assert v(0, 0) == pytest.approx(0.0, abs=1e-12)
    assert u(1, 0) + nu * v(0, 1) == pytest.approx(0.0, abs=1e-8)
    peaks = np.hypot(*made.amplitude[0, :2])
    assert peaks == pytest.approx(1.0)


@pytest.mark.parametrize("radius", [0.5, -0.3])
@pytest.mark.parametrize("direction", [Direction.normal, Direction.compression, Direction.shear])
def test_coupled_panels_solve_donnell_s_equations(radius, direction):
    k = 1 / radius
    made, (u, v, w), omega2 = only(
        Mode(2, 1, direction=direction), curvature=k, coupling=Coupling.donnell
    )
    c, nu, gh = SHEET.stretching, SHEET.nu, SHEET.shearing
    n_s = c * (u(1, 0) + k * w(0, 0) + nu * v(0, 1))
    along_s = c * (u(2, 0) + k * w(1, 0) + nu * v(1, 1)) + gh * (u(0, 2) + v(1, 1))
    along_t = c * (v(0, 2) + nu * (u(1, 1) + k * w(0, 1))) + gh * (v(2, 0) + u(1, 1))
    plate = SHEET.bending * (w(4, 0) + 2 * w(2, 2) + w(0, 4)) + k * n_s
    # k N_s holds w down: the ring's tension is that of s alone.
    ring = c * (u(1, 0) + k * w(0, 0) + nu * v(0, 1))
    assert n_s == pytest.approx(ring)
    scale = SHEET.mass * omega2 * np.abs(made.amplitude).max()
    assert along_s + SHEET.mass * omega2 * u(0, 0) == pytest.approx(0.0, abs=1e-8 * scale)
    assert along_t + SHEET.mass * omega2 * v(0, 0) == pytest.approx(0.0, abs=1e-8 * scale)
    assert plate - SHEET.mass * omega2 * w(0, 0) == pytest.approx(0.0, abs=1e-8 * scale)
    if direction is Direction.normal:
        assert made.amplitude[0, 2] == 1.0
        assert np.abs(made.amplitude[0, :2]).max() > 0.02
        u, v, w = made.derivatives(np.array([[0.0, 0.1], [0.3, 0.2]]))
        assert np.abs([v(0, 0), w(0, 0), w(2, 0)]).max() < 1e-10
        assert u(1, 0) == pytest.approx(0.0, abs=1e-10)


def test_a_nearly_flat_panel_is_a_plate():
    flat, _, _ = only(Mode(2, 1))
    bent, _, _ = only(Mode(2, 1), curvature=1e-6, coupling=Coupling.donnell)
    assert bent.frequency == pytest.approx(flat.frequency, rel=1e-6)
    assert bent.amplitude[0] == pytest.approx([0, 0, 1], abs=1e-6)


def test_inextensional_panels_keep_the_arc_s_length():
    _, (u, _, w), _ = only(Mode(3, 1), curvature=2.0, coupling=Coupling.inextensional)
    assert u(1, 0) + 2.0 * w(0, 0) == pytest.approx(0.0, abs=1e-12)
    assert np.abs(u(0, 0)).max() > 0.05


def test_membrane_in_phase_goes_with_the_slopes():
    made, (u, v, w), _ = only(Mode(2, 1, membrane=[0.01, -0.02]))
    k = made.wave_number[0]
    assert u(0, 0) == pytest.approx(0.01 * w(1, 0) / k[0], abs=1e-15)
    assert v(0, 0) == pytest.approx(-0.02 * w(0, 1) / k[1], abs=1e-15)


def test_shear_takes_its_part_of_the_slope():
    """Mindlin's plate without rotatory inertia: both equilibria, and the frequency they give."""
    shear = SHEET.bending / (5 / 6 * SHEET.shearing)
    made, (_, _, w), omega2 = only(Mode(3, 2), shear=shear)
    (c,) = made.turning
    k2 = (made.wave_number[0] ** 2).sum()
    assert c == pytest.approx(1 / (1 + shear * k2), rel=1e-12)
    assert 0.001 < 1 - c < 0.02
    stiff = 5 / 6 * SHEET.shearing
    lap, bilap = w(2, 0) + w(0, 2), w(4, 0) + 2 * w(2, 2) + w(0, 4)
    # Transverse force of the shear strain (1 - c) grad w, and the moments' balance along s.
    assert stiff * (1 - c) * lap == pytest.approx(-SHEET.mass * omega2 * w(0, 0), rel=1e-9)
    moment = SHEET.bending * c * (w(3, 0) + w(1, 2)) + stiff * (1 - c) * w(1, 0)
    assert moment == pytest.approx(0.0, abs=1e-8 * stiff * np.abs((1 - c) * w(1, 0)).max())
    assert bilap == pytest.approx(k2**2 * w(0, 0))
    rigid, _, _ = only(Mode(3, 2))
    assert made.frequency[0] == pytest.approx(rigid.frequency[0] * np.sqrt(c))


def test_a_given_share_of_shear_is_that_of_the_first_mode():
    modes = {"first": Mode(1, 1), "second": Mode(2, 2)}
    plate = Plate(modes=modes, shear=True, shear_share=0.02)
    one, four = 1 - plate.vibration().turning
    assert one == pytest.approx(0.02)
    assert four / (1 - four) == pytest.approx(4 * 0.02 / 0.98)


@pytest.mark.parametrize(
    "settings",
    [
        {"radius": 0.4, "coupling": Coupling.donnell},
        {"radius": -0.4, "coupling": Coupling.inextensional},
        {"shear": True, "shear_share": 0.1},
        {"radius": 0.4, "shear": True, "shear_share": 0.05, "coupling": Coupling.donnell},
    ],
)
def test_strain_of_every_kind_is_the_gradient_of_the_displacement(settings):
    modes = {
        "b": Mode(2, 1, 400.0, membrane=[0.1, 0.05]),
        "c": Mode(1, 2, 900.0, direction=Direction.compression),
        "s": Mode(1, 1, 700.0, direction=Direction.shear),
    }
    ours = VibratingPlate.built(Plate(thickness=0.02, modes=modes, **settings))
    places, f, step = PLACES * 0.9 + 0.01, 450.0, 1e-5
    axes = ours.axes(ours.position(places))

    def difference(function, axis):
        h = step / 2 * np.eye(2)[axis]
        return (function(places + h) - function(places - h)) / step

    lengths = [np.linalg.norm(difference(ours.position, a), axis=1) for a in (0, 1)]
    by = [
        difference(lambda p: ours.velocity(ours.position(p), f) / (2j * np.pi * f), a)
        / lengths[a][:, None]
        for a in (0, 1)
    ]
    e = np.array([[(by[i] * axes[:, j]).sum(1) for j in (0, 1)] for i in (0, 1)])
    expected = np.stack([e[0, 0], e[1, 1], (e[0, 1] + e[1, 0]) / 2], axis=1)
    found = ours.strain(ours.position(places), f)
    np.testing.assert_allclose(found, expected, atol=1e-6 * np.abs(expected).max())


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"coupling": Coupling.donnell}, "coupling: donnell needs a curved panel: give radius"),
        (
            {
                "radius": 0.5,
                "coupling": Coupling.inextensional,
                "edges": EdgeSupport.free,
                "modes": {"m": Mode(frequency=200.0)},
            },
            "coupling: inextensional is exact on supported edges alone",
        ),
        ({"radius": 0.5}, "modes.m.frequency: must be given for a curved panel"),
        ({"thickness": 0.0}, "modes.m.frequency: must be given, because a plate of no thickness"),
        ({"shear_share": 0.02}, "shear_share: needs shear: true"),
        ({"shear": True, "shear_share": 1.0}, "shear_share: must be from 0 to below 1"),
        ({"E": -1.0}, "E: must be a positive number"),
        ({"modes": {"m": Mode(0, 1, direction=Direction.shear)}}, "x: must be 1 or more"),
        ({"modes": {"m": Mode(membrane=[1.0])}}, "membrane: must be 2 numbers, along x and y"),
        (
            {"modes": {"m": Mode(direction=Direction.x, membrane=[1.0, 1.0])}},
            "membrane: goes with bending, not with direction: x",
        ),
    ],
)
def test_no_such_plate(settings, told):
    checks = Checks()
    Plate(**({"modes": {"m": Mode()}} | settings)).check(checks, "plate")
    problems = [f"{p.field}: {p.message}" for p in checks.problems]
    assert len(problems) == 1
    assert told in problems[0]
