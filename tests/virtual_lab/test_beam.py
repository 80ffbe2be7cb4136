"""The beam: where it goes, what it hits, and how its spot lies across an edge."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.special import ndtr

from sldvexp.laser import direction_cosines, project
from sldvexp.targets import Circle, Circles
from sldvexp.units import LengthUnit
from sldvexp.virtual_lab import VirtualLab
from sldvexp.virtual_lab.beam import Spot, beams, part_inside

TRUE_MIRRORS = (
    "scene.mirrors.mirror_offset=0.03",
    "scene.mirrors.up_down={gain: 0.02, zero: 0.01, polynomial: [0.003, -0.002]}",
    "scene.mirrors.left_right.gain=-1.97",
)


def light(lab, dac):
    """The true beams of DAC steps that need not be whole."""
    wired = dac[:, ::-1] if lab.scene.mirrors.swapped else dac
    rotation, origin = lab.true_pose(lab.view)
    return beams(lab.mirrors, wired, rotation, origin, lab.scene.spot)


@pytest.mark.one_in(8)
@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize("laser", ["ometron", "ometron_16bit"])
@pytest.mark.parametrize("view", ["1", "2", "4"])
def test_the_beam_goes_where_true_dac_points_it(quiet, laser, view, swapped):
    lab = quiet("plate", *TRUE_MIRRORS, f"scene.mirrors.swapped={swapped}", laser=laser)
    lab.use_view(view)
    points = np.random.default_rng(1).uniform([0, 0, -0.05], [0.5, 0.3, 0.1], (200, 3))
    beam = light(lab, lab.true_dac(points))
    away = points - beam.origin
    missed = np.linalg.norm(np.cross(away, beam.direction), axis=1)
    assert missed.max() < 1e-12
    assert ((away * beam.direction).sum(1) > 1).all()


def test_true_mirrors_differ_from_the_nominal_ones(quiet):
    bent = "laser.up_down.polynomial=[0.1]"
    nominal, true = (quiet("calibration", bent, *more).mirrors for more in ((), TRUE_MIRRORS))
    u = np.array([-0.5, 0.0, 0.7])
    dac = np.stack([u, u], axis=1) * nominal.board.value[1]
    gain = np.radians(25)
    bend = np.radians(0.1)
    up_down = 1.02 * (gain * u + bend * u**2) + 0.01 + 0.003 * u**2 - 0.002 * u**3
    np.testing.assert_allclose(true.angle_from_dac(dac)[:, 0], up_down, atol=1e-15)
    np.testing.assert_allclose(true.angle_from_dac(dac)[:, 1], -0.97 * gain * u, atol=1e-15)
    assert true.mirror_offset == 0.03
    assert nominal.mirror_offset == 0.0


@pytest.mark.parametrize("swapped", [False, True])
def test_v_is_the_velocity_along_the_line_of_sight(quiet, phasors, swapped):
    """At the middle of a hole: the speaker's velocity times n . D, and 100 mV per mm/s."""
    mirrors = f"scene.mirrors={{mirror_offset: 0.04, swapped: {swapped}}}"
    lab = quiet("calibration", mirrors)
    rotation, origin = lab.true_pose("1")
    truth = lab.calibration_object
    found = phasors(lab.scan(np.rint(lab.true_dac(truth.center)).astype(int)), 450.0)
    d = direction_cosines(project((truth.center - origin) @ rotation.T, 0.04), rotation)
    assert (d[:, 2] > 0.8).all()
    velocity = found[:, 0] / found[:, 1]  # the excitation is 1 V
    # Half a step off the middle turns D by 5e-5 rad at most; a count is 0.3 mV of 900 mV.
    np.testing.assert_allclose(velocity, 100 * 0.01 * d[:, 2], rtol=2e-4)


def integrated(depth, outward, normal, curvature, direction, radius):
    """Light of a Gaussian beam inside a circle: chord by chord exact, 40000 chords summed."""
    sigma = radius / 2
    across = np.linalg.svd(direction[None])[2][1:]
    p, q = across - np.outer(across @ normal, direction) / (direction @ normal)
    x = np.linspace(-6, 6, 40001) * sigma
    c = x[:, None] * p + (1 / curvature - depth) * outward
    # |c + y q|^2 < 1 / curvature^2
    b, c2 = c @ q / (q @ q), ((c**2).sum(1) - curvature**-2) / (q @ q)
    half = np.sqrt(np.maximum(b**2 - c2, 0))
    chord = ndtr((-b + half) / sigma) - ndtr((-b - half) / sigma)
    weight = np.exp(-0.5 * (x / sigma) ** 2)
    return weight @ chord / weight.sum()


@pytest.mark.whole
@pytest.mark.parametrize("radius", [3e-4, 8e-3], ids=["usual", "as wide as the circle"])
@pytest.mark.parametrize("tilt", [0.0, 0.6, 1.2])
@pytest.mark.parametrize("turn", [0.0, 0.8, 2.5])
def test_the_light_inside_an_edge(tilt, turn, radius):
    normal, outward = np.array([0.0, 0.0, 1.0]), np.array([np.cos(turn), np.sin(turn), 0.0])
    direction = -np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    depth = radius * np.array([-1.0, -0.3, 0.0, 0.2, 0.7])
    n = len(depth)
    ours = part_inside(
        0.01 - depth,
        np.tile(outward, (n, 1)),
        np.tile(normal, (n, 1)),
        np.full(n, 0.01),
        np.tile(direction, (n, 1)),
        np.full(n, radius),
    )
    sums = [integrated(s, outward, normal, 100.0, direction, radius) for s in depth]
    np.testing.assert_allclose(ours, sums, atol=1e-6)


def test_a_spot_without_width_sees_a_step(quiet, phasors):
    lab = quiet("calibration", "scene.spot.waist=0", laser="ometron_16bit")
    velocity = np.abs(phasors(lab.scan(line_across(lab, 2)), 450.0)[:, 0])
    top = velocity.max()
    assert ((velocity < 0.01 * top) | (velocity > 0.99 * top)).all()
    assert 0.3 < (velocity > 0.5 * top).mean() < 0.9


def line_across(lab, circle):
    """A horizontal line of contiguous pixels over one circle."""
    edge = lab.true_edge(circle, np.linspace(0, 2 * np.pi, 100))
    row = round(edge[:, 0].mean()) + 7
    low, high = np.ptp(edge[:, 1]) * np.array([-0.2, 0.2]) + [edge[:, 1].min(), edge[:, 1].max()]
    columns = np.arange(int(low), int(high))
    return np.stack([np.full_like(columns, row), columns], axis=1)


def crossings(lab, circle, row):
    """Left-right steps at which the true edge crosses a row."""

    def height(azimuth):
        return lab.true_edge(circle, azimuth)[0] - row

    grid = np.linspace(0, 2 * np.pi, 50)
    sign = [height(a) > 0 for a in grid]
    roots = [brentq(height, *grid[i : i + 2]) for i in range(49) if sign[i] != sign[i + 1]]
    return np.sort([lab.true_edge(circle, a)[1] for a in roots])


@pytest.mark.one_in(2)
@pytest.mark.parametrize("circle", [1, 3])
def test_halfway_at_the_true_edge(quiet, phasors, circle):
    lab = quiet("calibration", "scene.machine_error=true", laser="ometron_16bit", seed=4)
    dac = line_across(lab, circle)
    velocity = np.abs(phasors(lab.scan(dac), 450.0)[:, 0])
    column, middle = dac[:, 1], len(dac) // 2
    half = velocity.max() / 2
    left = np.interp(half, velocity[:middle], column[:middle])
    right = np.interp(-half, -velocity[middle:], column[middle:])
    # The edge's curvature moves the halfway value inwards by 1.1 um, 0.05 of these small steps.
    true = crossings(lab, circle, dac[0, 0])
    np.testing.assert_allclose([left, right], true, atol=0.1)
    assert left - true[0] > 0.01
    assert right - true[1] < -0.01


def test_spot_radius_grows_away_from_the_focus(quiet):
    beam = light(quiet("calibration"), np.zeros((1, 2)))
    assert beam.spot == Spot(0.0003, 1.7, 0.45)
    radius = beam.radius(np.array([1.7, 2.15, 1.25, 6.2]))
    np.testing.assert_allclose(radius / 0.0003, [1, np.sqrt(2), np.sqrt(2), np.sqrt(101)])


def test_raised_washers_hide_what_is_behind(quiet, phasors):
    """Each speaker has a phase of its own. From the side, washer 5 stands before circle 1."""
    phases = "{" + ", ".join(f"{n}: {{phase: {n / 4}}}" for n in range(1, 9)) + "}"
    lab = quiet("plate", f"+scene.speakers={phases}", target="two_planes")
    truth = lab.calibration_object
    for view, seen_at_1 in (("1", 1), ("2", 5)):
        lab.use_view(view)
        found = phasors(lab.scan(np.rint(lab.true_dac(truth.center)).astype(int)), 450.0)
        expected = np.array([seen_at_1, *range(2, 9)]) / 4
        np.testing.assert_allclose(np.angle(found[:, 0] / found[:, 1]), expected, atol=1e-3)


def test_the_true_circles_are_those_of_the_target(quiet):
    """The bitangent points of the target lie on the edges."""
    target = Circles(LengthUnit.inch, 0.0, {1: Circle(1, 2, 0.8), 2: Circle(7, 3, 0.9)})
    base = quiet("calibration")
    truth = VirtualLab(base.scene, base.mirrors, target).calibration_object
    points = target.all_bitangents()
    for i in (0, 1):
        on_it = [f"circle {truth.number[i]} " in label for label in points.label]
        away = np.linalg.norm(points.position[on_it] - truth.center[i], axis=1)
        np.testing.assert_allclose(away, truth.radius[i], atol=1e-15)
        assert len(away) == 4


def test_a_mirrored_object(quiet):
    ours, mirrored = (
        quiet("calibration", f"scene.mirrored={m}", target="two_planes").calibration_object
        for m in (False, True)
    )
    across = ours.center[:, 0] + mirrored.center[:, 0]
    np.testing.assert_allclose(across, across[0])
    np.testing.assert_array_equal(ours.center[:, 1:], mirrored.center[:, 1:])
    i = np.linspace(0, 6, 9)
    back = mirrored.edge(6, i) * [-1, 1, 1] + [across[0], 0, 0]
    np.testing.assert_allclose(back, ours.edge(6, i), atol=1e-15)


@pytest.mark.whole
def test_machine_errors_belong_to_the_object(quiet):
    def circles(seed, error):
        lab = quiet("plate", f"scene.machine_error={error}", seed=seed)
        truth = lab.calibration_object
        return np.column_stack([truth.center, 2 * truth.radius])

    perfect, first, again, other = (
        circles(*case) for case in ((1, False), (1, True), (1, True), (2, True))
    )
    bound = 0.00005 * 0.0254
    np.testing.assert_array_equal(first, again)
    for drawn in (first, other):
        assert np.abs(drawn - perfect).max() <= bound * (1 + 1e-9)
        assert np.abs(drawn - perfect).max() > bound / 2
    assert np.abs(first - other).max() > bound / 10
