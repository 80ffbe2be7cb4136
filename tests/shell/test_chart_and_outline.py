"""Coordinates of planes and cylinders: there and back, beams that meet them, outlines of meshes."""

from __future__ import annotations

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from sldvexp.geometry import rotation_from_euler
from sldvexp.shell import CylinderChart, Outline
from sldvexp.shell.outline import fitted_chart
from sldvexp.volume import Contour, OutlinedSurface
from sldvexp.volume.grid import Grid

CURVATURES = (0.0, 2.0, -2.0)
AXES = rotation_from_euler([0.3, 1.1, -0.7])


def at(chart, place, height):
    """The point at coordinates and a height."""
    s, t = place.T
    if chart.curvature == 0:
        local = np.column_stack([s, t, height])
    else:
        r = 1 / chart.curvature
        across, lift = (r + height) * np.sin(s / r), (r + height) * np.cos(s / r) - r
        local = np.column_stack([across, t, lift])
    return chart.center + local @ chart.axes


@pytest.mark.parametrize("curvature", CURVATURES)
@given(
    s=st.floats(-0.4, 0.4),
    t=st.floats(-1, 1),
    height=st.floats(-0.1, 0.1),
)
def test_places_are_found_again(curvature, s, t, height):
    chart = CylinderChart(np.array([1.0, -2.0, 0.5]), AXES, curvature)
    place, found = chart.place(at(chart, np.array([[s, t]]), np.array([height])))
    assert place == pytest.approx(np.array([[s, t]]), abs=1e-12)
    assert found == pytest.approx([height], abs=1e-12)


@pytest.mark.parametrize("curvature", CURVATURES)
def test_beams_meet_the_surface_at_its_height(curvature):
    rng = np.random.default_rng(1)
    chart = CylinderChart(np.array([0.2, 0.1, 0.0]), AXES, curvature)
    place, height = rng.uniform(-0.15, 0.15, (50, 2)), 0.002
    point = at(chart, place, np.full(50, height))
    begin = chart.center + np.array([0.1, -0.2, 1.7]) @ chart.axes
    way = (point - begin) / np.linalg.norm(point - begin, axis=1)[:, None]
    found, cosine, meets = chart.met(np.broadcast_to(begin, way.shape), way, height)
    assert meets.all()
    assert found == pytest.approx(place, abs=1e-12)
    frames = chart.frames(place)
    assert np.einsum("bij,bj->bi", frames, -way) == pytest.approx(cosine, abs=1e-12)
    assert np.linalg.norm(cosine, axis=1) == pytest.approx(1.0)


def test_the_back_is_not_met():
    chart = CylinderChart(np.zeros(3), np.eye(3))
    _, _, meets = chart.met(np.array([[0, 0, -1.0]]), np.array([[0, 0, 1.0]]), 0.0)
    assert not meets.any()


def test_local_axes_are_those_of_the_nodes_of_a_grid():
    grid = Grid(center=[0.4, 0.1, 0.2], euler=[0.2, 0.5, -0.1], radius=0.5, size=[0.26, 0.2])
    prisms = grid.prisms()
    outline = Outline.of(grid, prisms, 0.0)
    place, height = outline.chart.place(prisms.surface)
    assert height == pytest.approx(0.0, abs=1e-12)
    assert outline.chart.frames(place) == pytest.approx(prisms.frame, abs=1e-12)


@pytest.mark.parametrize("radius", [None, 0.5, -0.5])
def test_a_mesh_gets_the_chart_of_the_grid_that_it_is(radius):
    grid = Grid(center=[0.4, 0.1, 0.2], euler=[0.2, 0.5, -0.1], radius=radius, shape=[15, 11])
    prisms = grid.prisms()
    own, fitted = (
        Outline.of(grid, prisms, 0.0).chart,
        fitted_chart(prisms),
    )
    assert fitted.curvature == pytest.approx(own.curvature, rel=1e-6, abs=1e-9)
    assert fitted.place(prisms.surface)[1] == pytest.approx(0.0, abs=1e-8)
    assert abs(fitted.axes[2] @ own.axes[2]) == pytest.approx(1.0, abs=1e-9)


def test_a_hole_in_a_mesh_does_not_belong_to_the_structure():
    grid = Grid(size=[0.2, 0.2], shape=[5, 5])
    prisms = grid.prisms()
    middle = np.abs(prisms.position[: prisms.surface_nodes][prisms.triangles].mean(axis=1))
    kept = prisms.triangles[~(middle[:, :2] < 0.05).all(axis=1)]
    outline = Outline.of(grid, prisms, 0.0)
    holed = Outline(outline.chart, 0.0, outline.corners, kept, outline.low, outline.high, 0.0)
    places = np.array([[0.0, 0.0], [0.07, 0.07], [0.099, 0.0], [0.101, 0.0]])
    assert holed.holds(places).tolist() == [False, True, True, False]
    assert outline.holds(places).tolist() == [True, True, True, False]


def test_a_plane_s_first_coordinate_runs_along_the_volume_s_tangent():
    rng = np.random.default_rng(3)
    flat = OutlinedSurface(
        outline=Contour([[0.0, 0.0], [0.3, 0.0], [0.3, 0.1], [0.0, 0.1]]),
        euler=[0.3, 0.2, -0.1],
        tangent=[1.0, 1.0, 0.0],
    )
    chart = fitted_chart(flat.prisms())
    wanted = np.array([1.0, 1.0, 0.0]) / np.sqrt(2) @ rotation_from_euler(flat.euler)
    assert chart.axes[0] == pytest.approx(wanted, abs=1e-9)
    assert chart.axes[2] == pytest.approx(rotation_from_euler(flat.euler)[2], abs=1e-9)
    place = rng.uniform(-0.1, 0.1, (5, 2))
    assert chart.place(chart.points(place, 0.0))[0] == pytest.approx(place)
