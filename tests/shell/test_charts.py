"""Contract of all charts: places, axes, how they turn, beams, and what Love's kinematics give."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.linalg import lstsq

from sldvexp.errors import UserError
from sldvexp.geometry import Meridian, rotation_from_euler
from sldvexp.shell import CylinderChart, HeightChart, RevolutionChart, TensorSplines, ThinShell
from sldvexp.shell.chart import Chart
from sldvexp.shell.outline import fitted_chart
from tests.shell.simulated_surface import HEIGHTS, RADIUS, mesh, sphere

AXES, CENTER = rotation_from_euler([0.3, 1.1, -0.7]), np.array([1.0, -2.0, 0.5])
LOW, HIGH = np.array([-0.13, -0.105]), np.array([0.13, 0.105])
#: Curvatures along one direction, 1/m.
BENT = {"plane": 0.0, "cylinder": 2.0, "trough": -2.0}
#: (r, y) of shells of revolution, upwards; a cup widens and bends both ways.
MERIDIANS = {
    "tube": [[0.2, -0.11], [0.2, 0.11]],
    "cone": [[0.25, -0.1], [0.15, 0.1]],
    "cup": [[0.15, -0.1], [0.19, -0.04], [0.21, 0.02], [0.22, 0.08], [0.22, 0.12]],
}


#: One of every kind, and the surface that lies below it.
CHARTS = [b + name for b in ("", "below the ") for name in (*BENT, *MERIDIANS, *HEIGHTS)]
every_chart = pytest.mark.parametrize("chart", CHARTS, indirect=True)


@pytest.fixture
def chart(request: pytest.FixtureRequest) -> Chart:
    name = request.param.removeprefix("below the ")
    return made(name) if name == request.param else made(name).lowered(0.003)


@cache
def made(name: str) -> Chart:
    """A chart of a kind, made for the first test of it."""
    if name in BENT:
        return CylinderChart(CENTER, AXES, BENT[name])
    if name in MERIDIANS:
        return RevolutionChart(CENTER, AXES, Meridian(np.array(MERIDIANS[name])))
    return HeightChart.fitted(mesh(HEIGHTS[name], rotation=AXES, center=CENTER))


def places(count=40, seed=0):
    return np.random.default_rng(seed).uniform(0.9 * LOW, 0.9 * HIGH, (count, 2))


def differences(of, place, step=1e-5):
    """Derivatives by s and t, shape (..., point, 2)."""
    by = step * np.eye(2)
    return np.stack([(of(place + d) - of(place - d)) / (2 * step) for d in by], axis=-1)


@every_chart
@pytest.mark.parametrize("height", [0.0, 0.0015, -0.01])
def test_places_are_found_again(chart, height):
    place = places()
    found, above = chart.place(chart.points(place, height))
    assert found == pytest.approx(place, abs=1e-11)
    assert above == pytest.approx(height, abs=1e-11)


@every_chart
def test_axes_are_along_the_surface(chart):
    """Orthonormal and right-handed; the first two along it."""
    place = places()
    frames = chart.frames(place)
    assert np.einsum("pij,pkj->pik", frames, frames) == pytest.approx(
        np.broadcast_to(np.eye(3), frames.shape), abs=1e-12
    )
    assert np.linalg.det(frames) == pytest.approx(1.0)
    tangents = differences(lambda at: chart.points(at, 0.0), place)
    along = np.einsum("pij,pja->pia", frames, tangents)
    assert along[:, 2] == pytest.approx(0.0, abs=1e-8)
    # J undoes the tangents' components
    rate = chart.forms(place).rate
    unit = np.einsum("pia,pja->pij", rate, along[:, :2])
    assert unit == pytest.approx(np.broadcast_to(np.eye(2), unit.shape), abs=1e-8)


@every_chart
def test_axes_turn_as_the_forms_say(chart):
    place = places()
    frames, forms = chart.frames(place), chart.forms(place)
    by = differences(chart.frames, place)  # (point, axis, xyz, a)
    along = np.einsum("pnxa,pia->pnix", by, forms.rate)
    turn = np.einsum("pnix,pmx->pnim", along, frames)  # what axis n gains of axis m
    size = 1 + np.abs(forms.curvature).max()
    assert turn[:, 2, :, :2] == pytest.approx(forms.curvature, abs=1e-7 * size)
    assert turn[:, 0, :, 1] == pytest.approx(forms.turn, abs=1e-7 * size)
    assert forms.curvature == pytest.approx(np.swapaxes(forms.curvature, 1, 2), abs=1e-12)


@every_chart
def test_beams_meet_the_surface(chart):
    place, height = places(), 0.002
    point = chart.points(place, height)
    begin = CENTER + np.array([0.1, -0.2, 1.7]) @ AXES
    way = (point - begin) / np.linalg.norm(point - begin, axis=1)[:, None]
    found, cosine, meets = chart.met(np.broadcast_to(begin, way.shape), way, height)
    assert meets.all()
    assert found == pytest.approx(place, abs=1e-10)
    assert cosine == pytest.approx(-np.einsum("bij,bj->bi", chart.frames(place), way), abs=1e-9)


@every_chart
def test_the_back_is_not_met(chart):
    """Where the surface closes in itself, a beam from behind meets its far side from inside."""
    place = places()
    point, normal = chart.points(place, 0.0), chart.frames(place)[:, 2]
    found, _, meets = chart.met(point - 0.05 * normal, normal, 0.0)
    assert not (meets & (np.abs(found - place) < 1e-3).all(axis=1)).any()


def laid():
    return TensorSplines.over(1.05 * LOW, 1.05 * HIGH, 20, 5, 0.1)


def fitted_motion(chart, displacement):
    """Splines of a displacement of the middle surface, (point, 3) of points, and what they miss."""
    at = np.random.default_rng(1).uniform(LOW, HIGH, (4000, 2))
    local = np.einsum("pij,pj->pi", chart.frames(at), displacement(chart.points(at, 0.0)))
    theta = lstsq(laid()(at), local, lapack_driver="gelsy")[0]
    return ThinShell(laid(), laid(), chart), theta.T.ravel()


@pytest.mark.one_in(10)
@every_chart
def test_a_rigid_motion_has_no_strain(chart):
    """And every height moves with it."""
    way, spin = np.array([0.3, -0.2, 0.5]), np.array([1.0, 2.0, -1.5])

    def rigid(points):
        return way + np.cross(spin, points - chart.center)

    shell, theta = fitted_motion(chart, rigid)
    place = places()
    for height in (0.0, 0.0015, -0.0015):
        moved = np.stack([rows @ theta for rows in shell.velocity(place, height)], axis=1)
        true = rigid(chart.points(place, height))
        assert np.einsum("pij,pi->pj", chart.frames(place), moved) == pytest.approx(true, abs=1e-7)
        strain = np.stack([rows @ theta for rows in shell.strain(place, height)], axis=1)
        assert strain == pytest.approx(0.0, abs=2e-5)


def wave(points):
    """A smooth displacement in space."""
    x, y, z = (points - CENTER).T
    return np.column_stack(
        [np.sin(7 * x + 2 * y), np.cos(5 * y - 3 * z), np.sin(6 * x) * np.cos(8 * y) + z]
    )


@pytest.mark.one_in(19)
@every_chart
@pytest.mark.parametrize("height", [0.0, 0.0015, -0.0015])
def test_strain_is_that_of_differences_in_space(chart, height):
    """Displacements of points at a height, whose normals stay normal, differentiated in space."""
    shell, theta = fitted_motion(chart, wave)
    place = places()
    frames = chart.frames(place)

    def displacement(at):
        moved = np.stack([rows @ theta for rows in shell.velocity(at, height)], axis=1)
        return np.einsum("pij,pi->pj", chart.frames(at), moved)

    by = differences(displacement, place)  # (point, xyz, a)
    tangents = differences(lambda at: chart.points(at, height), place)
    # Along the tangent plane: du = F dx
    gradient = np.linalg.solve(
        np.swapaxes(np.einsum("pix,pxa->pia", frames[:, :2], tangents), 1, 2),
        np.swapaxes(np.einsum("pix,pxa->pia", frames[:, :2], by), 1, 2),
    )
    symmetric = (gradient + np.swapaxes(gradient, 1, 2)) / 2
    wanted = np.stack([symmetric[:, 0, 0], symmetric[:, 1, 1], symmetric[:, 0, 1]], axis=1)
    got = np.stack([rows @ theta for rows in shell.strain(place, height)], axis=1)
    assert got == pytest.approx(wanted, abs=1e-5 * np.abs(wanted).max())


@pytest.mark.whole
@every_chart
def test_normals_stay_normal(chart):
    """A point's displacement changes along the normal as the moved normal turns: no shear."""
    shell, theta = fitted_motion(chart, wave)
    place = places()

    def displacement(at, height=0.0):
        moved = np.stack([rows @ theta for rows in shell.velocity(at, height)], axis=1)
        return np.einsum("pij,pi->pj", chart.frames(at), moved)

    by = differences(displacement, place)
    forms, frames = chart.forms(place), chart.frames(place)
    tilt = np.einsum("pxa,pia,px->pi", by, forms.rate, frames[:, 2])
    through = (displacement(place, 1e-3) - displacement(place, -1e-3)) / 2e-3
    shear = tilt + np.einsum("pix,px->pi", frames[:, :2], through)
    assert shear == pytest.approx(0.0, abs=1e-6 * np.abs(tilt).max())


def test_a_sphere_bends_alike_everywhere():
    chart = HeightChart.fitted(mesh(sphere))
    curvature = chart.forms(places()).curvature
    assert curvature == pytest.approx(
        np.broadcast_to(np.eye(2) / RADIUS, curvature.shape), abs=1e-4 / RADIUS
    )


def test_a_surface_goes_on_as_smoothly_beyond_its_nodes():
    chart = HeightChart.fitted(mesh(sphere), margin=0.02)
    beyond = np.array([[0.148, 0.0], [-0.14, 0.12], [0.0, -0.124]])
    assert chart.points(beyond, 0.0)[:, 2] == pytest.approx(sphere(*beyond.T), abs=1e-4)
    assert chart.forms(beyond).curvature == pytest.approx(
        np.broadcast_to(np.eye(2) / RADIUS, (3, 2, 2)), abs=0.1 / RADIUS
    )


def test_nodes_may_be_measured_ones():
    """Of a dome, off by 0.05 mm at random: curvatures of 2/m are found."""
    rng = np.random.default_rng(3)
    chart = HeightChart.fitted(mesh(lambda x, y: sphere(x, y) + 5e-5 * rng.normal(size=len(x))))
    curvature = chart.forms(places()).curvature
    assert np.sqrt(np.mean((curvature - np.eye(2) / RADIUS) ** 2)) < 0.05 / RADIUS


@pytest.mark.parametrize("height", HEIGHTS.values(), ids=HEIGHTS)
def test_a_mesh_that_bends_both_ways_gets_a_height_over_a_plane(height):
    prisms = mesh(height, rotation=AXES, center=CENTER)
    chart = fitted_chart(prisms)
    assert isinstance(chart, HeightChart)
    place, above = chart.place(prisms.surface)
    assert above == pytest.approx(0.0, abs=1e-6)
    assert np.einsum("pi,pi->p", chart.frames(place)[:, 2], prisms.frame[:, 2]).min() > 0.999


def test_a_surface_that_hides_a_part_of_itself_is_named():
    """Half a sphere's rim is as steep as can be."""
    steep = mesh(lambda x, y: np.sqrt(np.maximum(0.13**2 - x**2, 0)) - 0.1 * y**2)
    with pytest.raises(UserError, match=r"seen as a whole from one side; \d+ of 1664 triangles"):
        fitted_chart(steep)


def test_a_surface_with_an_edge_is_named():
    with pytest.raises(UserError, match=r"smooth surface; the volume's has edges or steps"):
        fitted_chart(mesh(lambda x, y: 0.5 * np.abs(x) + 0.5 * np.abs(y)))
