"""The deflection shape's data is the field, layer, frame and all."""

from __future__ import annotations

import base64

import numpy as np
import pytest
import xarray as xr
from matplotlib import colormaps

from sldvexp.plot import style
from sldvexp.plot.shape import normals
from sldvexp.report.html import shape
from sldvexp.report.html.fewer_nodes import fewer_nodes
from tests.shell.made_strain import made_strain

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [2, 1, 1.0]])
COMPONENTS = {"world": ["x", "y", "z"], "local": ["t1", "t2", "n"]}


def floats(text: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), "<f4")


@pytest.mark.parametrize("coordinates", COMPONENTS)
def test_shape_is_the_field_on_the_given_surface(coordinates, small_volume, small_field):
    around = small_volume(coordinates, radius=0.4)
    of = small_field(around, coordinates)
    data = shape.shape_of(of, around)
    nodes = np.flatnonzero(around["node_layer"].values == 1)
    assert data["components"] == COMPONENTS[coordinates]
    assert (data["length_unit"], data["velocity_unit"]) == ("mm", "mm/s")
    expected = 1e3 * of["velocity"].values[nodes].transpose(2, 1, 0)
    np.testing.assert_allclose(floats(data["real"]), expected.real.ravel(), rtol=1e-6)
    np.testing.assert_allclose(floats(data["imaginary"]), expected.imag.ravel(), rtol=1e-6)
    bound = 1e3 * of["confidence"].values[nodes].transpose(2, 1, 0)
    np.testing.assert_allclose(floats(data["bound"]), bound.ravel(), rtol=1e-6)
    position = floats(data["position"]).reshape(-1, 3)
    np.testing.assert_allclose(position, 1e3 * around["position"].values[nodes], atol=1e-4)
    directions = floats(data["directions"]).reshape(3, -1, 3)
    axes = around["frame"].values.transpose(1, 0, 2)
    wanted = axes if coordinates == "local" else np.eye(3)[:, None]
    assert directions.shape == wanted.shape
    np.testing.assert_allclose(directions, wanted, atol=1e-6)
    np.testing.assert_allclose(floats(data["normal"]).reshape(-1, 3), axes[2], atol=1e-6)


def test_colours_are_those_of_the_figures(small_volume, small_field):
    around = small_volume()
    maps = shape.shape_of(small_field(around), around)["maps"]
    for name, of in (
        ("size", style.SIZE_MAP),
        ("sign", style.SIGN_MAP),
        ("phase", style.PHASE_MAP),
    ):
        own = np.frombuffer(base64.b64decode(maps[name]), np.uint8).reshape(-1, 3)
        ends = colormaps[of]([0.0, 1.0], bytes=True)[:, :3]
        np.testing.assert_array_equal(own[[0, -1]], ends)


def test_triangles_cover_the_surface_once(small_volume, small_field):
    around = small_volume()
    data = shape.shape_of(small_field(around), around)
    corner = np.frombuffer(base64.b64decode(data["triangles"]), "<u2").reshape(-1, 3)
    place = floats(data["position"]).reshape(-1, 3)[corner]
    area = np.linalg.norm(np.cross(place[:, 1] - place[:, 0], place[:, 2] - place[:, 0]), axis=1)
    assert area.sum() / 2 == pytest.approx(200 * 150, rel=1e-5)


def test_outermost_layer_has_its_triangles_too(small_volume):
    around = small_volume()
    around["depth"].values[:] = [0.02, 0.01, 0.0]  # the given surface is the uppermost layer
    nodes, triangles, depth = shape.surface_layer(around)
    assert depth == 0.0
    assert set(nodes) == set(np.flatnonzero(around["node_layer"].values == 2))
    assert len(triangles) == 2 * 4 * 3
    assert triangles.max() == len(nodes) - 1


def test_strongest_frequencies_are_kept_when_there_is_no_room_for_all(
    monkeypatch, small_volume, small_field
):
    around = small_volume()
    monkeypatch.setattr(shape, "MOST_BYTES", 1)
    data = shape.shape_of(small_field(around), around)
    assert (data["frequencies"], data["left_out"]) == ([197.0], 1)


def test_what_views_do_not_determine_stays_unknown(small_volume, small_field):
    around = small_volume()
    of = small_field(around)
    node = np.flatnonzero(around["node_layer"].values == 1)[4]
    of["velocity"].values[node, 1, :] = np.nan
    real = floats(shape.shape_of(of, around)["real"]).reshape(2, 3, -1)
    assert np.argwhere(np.isnan(real)).tolist() == [[0, 1, 4], [1, 1, 4]]


def test_the_strongest_frequency_is_shown_first(small_volume, small_field):
    around = small_volume()
    of = small_field(around)
    assert shape.shape_of(of, around)["strongest"] == 0
    of["velocity"].values[:, :, 1] *= 10
    assert shape.shape_of(of, around)["strongest"] == 1


def test_shape_of_points_is_their_velocities_and_what_joins_them(small_points):
    data = shape.shape_of_points(*small_points)
    point, lines_of_sight = small_points
    expected = 1e3 * point["velocity"].values.transpose(2, 1, 0)
    np.testing.assert_allclose(floats(data["real"]), expected.real.ravel(), rtol=1e-6)
    np.testing.assert_allclose(floats(data["imaginary"]), expected.imag.ravel(), rtol=1e-6)
    np.testing.assert_allclose(floats(data["position"]), 100.0 * SQUARE.ravel(), atol=1e-4)
    for name in ("triangle", "line"):
        whole = np.frombuffer(base64.b64decode(data[f"{name}s"]), "<u2")
        assert whole.tolist() == lines_of_sight[name].values.ravel().tolist()
    assert data["names"] == ["1", "2", "7", "9", "12"]
    np.testing.assert_array_equal(floats(data["directions"]).reshape(3, 3), np.eye(3))
    normal = floats(data["normal"]).reshape(5, 3)
    np.testing.assert_allclose(normal[:4], np.tile([0, 0, 1], (4, 1)), atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(normal[4]), 1.0, rtol=1e-6)


def test_points_that_nothing_joins_have_the_normal_of_their_plane(small_points):
    place = SQUARE[:4] @ np.array([[1, 0, 0], [0, 0, 1], [0, 1, 0.0]])
    found = normals(place, np.empty((0, 3), np.int64))
    np.testing.assert_allclose(found, np.tile([0, 1, 0], (4, 1)), atol=1e-12)
    point, lines_of_sight = small_points
    data = shape.shape_of_points(point, lines_of_sight.drop_vars(["triangle", "line"]))
    assert (data["triangles"], data["lines"]) == ("", "")


def test_field_without_frequencies_has_one_nameless_entry(small_volume, small_field):
    around = small_volume()
    of = small_field(around, hertz=(50.0,)).isel(frequency=0, drop=True)
    assert shape.shape_of(of, around)["frequencies"] == [None]


def test_of_a_surface_of_many_nodes_some_are_drawn_for_all(monkeypatch, small_volume, small_field):
    around = small_volume()
    field, strain = small_field(around), made_strain(around)
    whole = shape.shape_of(field, around, strain)
    monkeypatch.setattr(shape, "MOST_NODES", 9)
    data = shape.shape_of(field, around, strain)
    kept, count = data["few"]["nodes"], data["few"]["of"]
    assert 4 <= len(kept) <= 9 < count
    assert sorted(set(kept)) == kept
    position = floats(whole["position"]).reshape(count, 3)
    np.testing.assert_array_equal(floats(data["position"]).reshape(-1, 3), position[kept])
    for part in ("real", "imaginary", "bound"):
        every = floats(whole[part]).reshape(-1, count)
        np.testing.assert_array_equal(floats(data[part]).reshape(-1, len(kept)), every[:, kept])
    for own, of in zip(data["colourings"], whole["colourings"], strict=True):
        every = floats(of["real"]).reshape(-1, count)
        np.testing.assert_array_equal(floats(own["real"]).reshape(-1, len(kept)), every[:, kept])
    corners = np.frombuffer(base64.b64decode(data["triangles"]), "<u2")
    assert len(corners)
    assert corners.max() < len(kept)
    nodes = np.flatnonzero(around["node_layer"].values == 1)
    few = fewer_nodes(around["position"].values[nodes], np.zeros((0, 3), int), 9)
    np.testing.assert_array_equal(few.kept, kept)
    velocity = (floats(whole["real"]) + 1j * floats(whole["imaginary"])).reshape(-1, count)
    off = abs(velocity - velocity[:, few.kept[few.stands_in]]).max()
    assert data["few"]["off"] == f"{off:.2g} {data['velocity_unit']}"


def test_few_nodes_of_a_bent_sheet_keep_its_sides_and_its_size():
    x, y = np.meshgrid(np.linspace(0, 2, 90), np.linspace(0, 1, 60), indexing="ij")
    position = np.stack([np.sin(x), y, np.cos(x)], axis=-1).reshape(-1, 3)
    at = np.arange(90 * 60).reshape(90, 60)
    a, b, c, d = at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]
    triangles = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)
    few = fewer_nodes(position, triangles, 600)
    assert 300 < len(few.kept) <= 600
    assert sorted(few.stands_in[few.kept]) == list(range(len(few.kept)))
    assert np.linalg.norm(position - position[few.kept[few.stands_in]], axis=1).max() < 0.1
    corners = position[few.kept][few.triangles]
    area = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    outwards = (area * corners.mean(axis=1) * [1, 0, 1]).sum(axis=1)
    assert (outwards > 0).mean() > 0.999 or (outwards < 0).mean() > 0.999
    assert 1.7 < np.linalg.norm(area, axis=1).sum() < 2.0


def test_a_surface_of_few_nodes_is_drawn_whole(small_volume, small_field):
    around = small_volume()
    assert shape.shape_of(small_field(around), around)["few"] is None


def test_colours_of_strain_are_those_of_the_drawn_surface(small_volume, small_field):
    """The velocity is drawn as a displacement, i omega times it, and so is its strain."""
    around = small_volume()
    strain = made_strain(around)
    data = shape.shape_of(small_field(around), around, strain)
    texts = [one["text"] for one in data["colourings"]]
    assert texts[1:] == [
        "strain e_tt now",
        "strain e_st now",
        "largest extension",
        "von Mises stress",
    ]
    first, *_, extension, stress = data["colourings"]
    assert (first["unit"], stress["unit"]) == ("µstrain", "kPa")
    drawn = floats(first["real"]) + 1j * floats(first["imaginary"])
    expected = 1e6j * strain["strain"].values[:, 0].T
    np.testing.assert_allclose(drawn.reshape(2, -1), expected, rtol=1e-5, atol=1e-6)
    assert "imaginary" not in extension
    largest = 1e6 * strain["principal_strain"].values[:, 0].T
    np.testing.assert_allclose(floats(extension["real"]).reshape(2, -1), largest, rtol=1e-5)


def test_a_shape_is_seen_from_where_its_views_stood():
    origin = np.array([[1, 1, 1], [1, 0, 1 + np.sqrt(3)], [1, -1, 1], [np.nan, 0, 0]])
    turned = np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0.0]])  # rows are the instrument's axes
    pose = xr.Dataset(
        {
            "origin": (("view", "axis"), origin),
            "rotation": (("view", "laser_axis", "axis"), np.stack([np.eye(3), *3 * [turned]])),
        },
        coords={"view": ["left", "top", "right", "lost"]},
    )
    found = shape.stands_of(pose, np.array([[-1, -1, 1], [1, 1, 1.0]]), length=1e3)
    assert [one["name"] for one in found] == ["left", "top", "right"]
    angles = [[one["azimuth"], one["elevation"]] for one in found]
    np.testing.assert_allclose(angles, [[45, 0], [0, 60], [-45, 0]], atol=1e-12)
    np.testing.assert_allclose([one["origin"] for one in found], 1e3 * origin[:3])
    assert [one["axis"] for one in found] == [[0, 0, 1], [0, 1, 0], [0, 1, 0]]


@pytest.mark.parametrize("radius", [None, 0.4])
def test_other_layers_are_the_surface_moved_along_its_normals(radius, small_volume, small_field):
    around = small_volume(radius=radius)
    of = small_field(around)
    data = shape.shape_of(of, around)
    position = floats(data["position"]).reshape(-1, 3)
    normal = floats(data["normal"]).reshape(-1, 3)
    given = int(np.argmin(abs(around["depth"].values)))
    others = [layer for layer in range(3) if layer != given]
    for layer, own in zip(others, data["layers"], strict=True):
        nodes = np.flatnonzero(around["node_layer"].values == layer)
        place = 1e3 * around["position"].values[nodes]
        np.testing.assert_allclose(position + own["depth"] * normal, place, atol=1e-3)
        assert own["text"].endswith("above" if own["depth"] > 0 else "below")
        assert own["rounded"]


def test_layers_that_are_not_moved_along_normals_are_left_out(small_volume, small_field):
    around = small_volume()
    of = small_field(around)
    of["position"].values[-1, 0] += 1e-4
    assert len(shape.shape_of(of, around)["layers"]) == 1


def test_layers_without_room_are_left_out(monkeypatch, small_volume, small_field):
    around = small_volume()
    data = shape.shape_of(small_field(around), around)
    monkeypatch.setattr(shape, "MOST_BYTES", sum(map(len, shape._texts(data))) // 2)
    assert shape.shape_of(small_field(around), around)["layers"] == []


def test_strains_of_other_places_than_the_drawn_ones_are_no_colours(small_volume, small_field):
    around = small_volume()
    strain = made_strain(around).isel(place=slice(3))
    assert shape.shape_of(small_field(around), around, strain)["colourings"] == []
