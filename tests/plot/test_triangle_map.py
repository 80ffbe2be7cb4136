"""Maps over triangles have the colour of their value in every pixel, and find the pixels once."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.spatial
from matplotlib import colormaps
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import TriMesh
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation

from sldvexp.plot import triangle_map
from sldvexp.plot.triangle_map import VEIL, TriangleMap


@pytest.fixture
def rng():
    return np.random.default_rng(1)


LOOK = {"cmap": colormaps["viridis"], "norm": Normalize(0.0, 1.0)}


def _mesh(rng: np.random.Generator, count: int = 60) -> Triangulation:
    """Make triangles over a unit square, none of which has a corner beside an edge of it."""
    inside = rng.uniform(0.05, 0.95, (count, 2))
    place = np.concatenate([[[0, 0], [1, 0], [1, 1], [0, 1]], inside])
    return Triangulation(*place.T, scipy.spatial.Delaunay(place).simplices)


def _map(mesh: Triangulation, values: np.ndarray, **chosen) -> TriangleMap:
    every = np.ones(len(mesh.triangles), bool)
    return TriangleMap(
        mesh,
        values[mesh.triangles],
        **{"shown": every, "veiled": ~every, "array": values} | LOOK | chosen,
    )


def _panel(canvas: float = 2.0):
    made = Figure(figsize=(canvas, canvas), dpi=100)
    panel = made.add_axes((0.1, 0.2, 0.5, 0.6))
    panel.set(xlim=(0, 1), ylim=(0, 1))
    panel.set_axis_off()
    return made, panel


def _drawn(made: Figure) -> np.ndarray:
    canvas = FigureCanvasAgg(made)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].astype(float)


@pytest.mark.parametrize("size", [(37.3, 21.8), (220.0, 178.0), (3.0, 150.0)])
def test_every_pixel_has_the_value_of_its_middle(rng, size):
    mesh = _mesh(rng)
    place = np.column_stack([mesh.x, mesh.y]) * size
    found = triangle_map._Pixels.from_triangles(place, mesh.triangles)
    x, y = np.meshgrid(np.arange(found.shape[1]) + 0.5, np.arange(found.shape[0]) + 0.5)
    inside = (x < size[0]) & (y < size[1])
    picture = np.full(found.shape, np.nan)
    picture.ravel()[found.number] = found.values((2 + 3 * place @ (1.0, -0.4))[mesh.triangles])
    np.testing.assert_allclose(picture[inside], (2 + 3 * (x - 0.4 * y))[inside], rtol=1e-9)
    assert np.isnan(picture[~inside]).all()


def test_triangles_may_turn_either_way_and_have_no_area(rng):
    mesh = _mesh(rng)
    place = 90 * np.column_stack([mesh.x, mesh.y])
    whole = triangle_map._Pixels.from_triangles(place, mesh.triangles)
    flat = np.tile([[5, 5, 9], [7, 7, 7]], (3, 1))
    turned = np.concatenate([mesh.triangles[:, ::-1], flat])
    other = triangle_map._Pixels.from_triangles(place, turned)
    assert set(whole.number) == set(other.number) == set(range(90 * 90))
    assert other.triangle.max() < len(mesh.triangles)


@pytest.mark.parametrize("turned", [False, True])
def test_looks_as_matplotlib_draws_triangles(rng, turned):
    mesh = _mesh(rng, 30)
    values = 0.5 + 0.5 * np.sin(3 * mesh.x) * mesh.y
    pictures = []
    linear = LOOK | {"cmap": colormaps["gray"]}  # for values and for colours alike
    for drawn in (_map(mesh, values, **linear), TriMesh(mesh, array=values, **linear)):
        made, panel = _panel()
        panel.add_collection(drawn)
        if turned:
            panel.invert_xaxis()
        pictures.append(_drawn(made))
    away = np.abs(np.subtract(*pictures)).max(axis=2)
    assert np.ptp(pictures[0]) > 120
    assert away.max() <= 16  # which matplotlib is off along the edges of long triangles


def test_what_is_not_shown_is_seen_through_and_what_is_veiled_is_pale(rng):
    mesh = _mesh(rng)
    left = mesh.x[mesh.triangles].max(axis=1) < 0.5
    right = mesh.x[mesh.triangles].min(axis=1) > 0.5
    made, panel = _panel()
    panel.add_collection(_map(mesh, np.zeros(len(mesh.x)), shown=~left, veiled=right))
    picture = _drawn(made)
    dark = 255 * np.array(colormaps["viridis"](0.0)[:3])
    colours = {tuple(colour) for colour in picture[45:155, 25:115].reshape(-1, 3).round()}
    pale = 255 * VEIL + (1 - VEIL) * dark
    for wanted in (dark, pale, (255, 255, 255)):
        assert min(np.abs(np.subtract(wanted, colour)).max() for colour in colours) <= 1


def test_maps_of_one_surface_find_its_pixels_once(rng, monkeypatch):
    mesh, found = _mesh(rng), []
    find = triangle_map._Pixels.from_triangles
    monkeypatch.setattr(
        triangle_map._Pixels, "from_triangles", lambda *told: found.append(find(*told)) or found[-1]
    )
    made = Figure(figsize=(4, 2))
    for panel in made.subplots(1, 2):
        panel.set(xlim=(0, 1), ylim=(0, 1))
        panel.add_collection(_map(mesh, mesh.x), autolim=False)
    _drawn(made)
    assert len(found) == 1
