"""Exports to look at: the surface moves as the field says, told by readers that are not ours."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib import colormaps

from sldvexp.dataset.run_data import RunData
from sldvexp.errors import ConfigError, UserError
from sldvexp.export.glb import Glb
from sldvexp.export.motion import DRAWN_SHARE, MotionColour, motion_of
from sldvexp.export.velocities import mesh_of, velocities_of, velocity_in_world
from sldvexp.plot.style import SIZE_MAP
from tests.shell.made_strain import made_strain

PAGE = Path(__file__).parents[2] / "sldvexp/report/html/shape.js"
PHASES = (0.0, 0.7, np.pi / 2, 4.0)


@pytest.fixture(scope="module")
def strained(world):
    strain = made_strain(world.tree["volume"], tuple(world.tree["field"]["frequency"].values))
    return replace(world, tree=world.tree | {"strain": strain})


def placed(points, **cells):
    """The run of a point as five in space, which move as that one but differently far."""
    group, tree = points.tree["point"], dict(points.tree)
    names = [f"n{i}" for i in range(5)]
    tree["point"] = group.expand_dims(point=names).assign_coords(point=names).copy()
    tree["point"]["velocity"] = tree["point"]["velocity"] * xr.DataArray(
        np.arange(1.0, 6.0), dims="point"
    )
    place = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1.0]])  # in no plane
    tree["line_of_sight"] = xr.Dataset({"position": (("point", "axis"), place)}, {"point": names})
    for name, own in cells.items():
        tree["line_of_sight"][name] = ((name, f"{name}_end"), np.array(own))
    return RunData(tree, points.attributes)


def surface(run, i):
    """Positions, and complex velocities at a frequency, of the layer that is drawn."""
    mesh = mesh_of(run, "glb")
    world = velocity_in_world(velocities_of(run), mesh)
    return mesh.position[mesh.surface_layer], world[mesh.surface_layer][..., i]


class Opened:
    """A GLB file as pygltflib finds it."""

    def __init__(self, path):
        pygltflib = pytest.importorskip("pygltflib")
        self.file = pygltflib.GLTF2().load(str(path))
        [self.mesh], [self.animation] = self.file.meshes, self.file.animations
        self.extras = self.mesh.extras

    def array(self, number):
        accessor = self.file.accessors[number]
        view = self.file.bufferViews[accessor.bufferView]
        kind = {5126: "<f4", 5125: "<u4", 5123: "<u2"}[accessor.componentType]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor.type]
        data = self.file.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]
        found = np.frombuffer(data, kind).reshape(accessor.count, width)
        if accessor.max:
            np.testing.assert_array_equal(found.max(axis=0), np.array(accessor.max, kind))
            np.testing.assert_array_equal(found.min(axis=0), np.array(accessor.min, kind))
        return found

    def at(self, weights):
        """Where the vertices are with these weights."""
        own = self.mesh.primitives[0]
        rest = self.array(own.attributes.POSITION).astype(float)
        moved = [self.array(target["POSITION"]) for target in own.targets]
        return rest + sum(w * d for w, d in zip(weights, moved, strict=True))

    def weights(self, second):
        """What a player makes of the instants."""
        [sampler] = self.animation.samplers
        time = self.array(sampler.input).ravel()
        values = self.array(sampler.output).reshape(len(time), 2)
        return np.array([np.interp(second, time, column) for column in values.T])


@pytest.mark.parametrize("phase", PHASES)
@pytest.mark.parametrize("kind", ["world", "local"])
def test_surface_moves_in_a_browser_as_the_field_says(kind, phase, request, tmp_path):
    run = request.getfixturevalue(kind).run
    found = Opened(Glb(frequency=440.0, seconds=2.0).export(run, tmp_path, "mine"))
    position, velocity = surface(run, 1)
    scale = found.extras["metres_drawn_per_metre_per_second"]
    expected = position + scale * np.nan_to_num((velocity * np.exp(1j * phase)).real)
    exact = np.array([np.cos(phase), -np.sin(phase)])
    single = 1e-6 * np.abs(position).max()  # numbers of 32 bits
    np.testing.assert_allclose(found.at(exact), expected, atol=single)
    # Of 60 instants a period, joined by straight lines.
    played = found.weights(2.0 * phase / (2 * np.pi))
    assert np.abs(played - exact).max() <= 1 - np.cos(np.pi / 60) + 1e-6
    assert found.extras["frequency_hz"] == 440.0
    largest = np.nanmax(np.linalg.norm(np.abs(velocity), axis=1))
    diagonal = np.linalg.norm(np.ptp(position, axis=0))
    assert scale * largest == pytest.approx(DRAWN_SHARE * diagonal, rel=1e-12)


def test_animation_is_one_period_of_two_weights_that_closes(world, tmp_path):
    found = Opened(Glb(seconds=4.0).export(world.run, tmp_path, "mine"))
    [channel], [sampler] = found.animation.channels, found.animation.samplers
    assert (channel.target.path, channel.target.node, sampler.interpolation) == (
        "weights",
        0,
        "LINEAR",
    )
    assert (found.file.accessors[sampler.input].min, found.file.accessors[sampler.input].max) == (
        [0.0],
        [4.0],
    )
    np.testing.assert_allclose(found.weights(0.0), found.weights(4.0), atol=1e-6)
    assert found.extras["targetNames"] == ["real", "imaginary"]
    assert found.mesh.weights == [1.0, 0.0]
    # z of the run is upwards, which in glTF is y.
    x, y, z, w = found.file.nodes[0].rotation
    assert (y, z) == (0, 0)
    assert 2 * x * w == pytest.approx(-1.0)


def test_trimesh_opens_the_surface_at_rest(world, tmp_path):
    trimesh = pytest.importorskip("trimesh")
    opened = trimesh.load(Glb().export(world.run, tmp_path, "mine"), process=False)
    [mesh] = opened.geometry.values()
    position, _ = surface(world.run, 0)
    np.testing.assert_allclose(mesh.vertices, position, atol=1e-7)
    np.testing.assert_array_equal(mesh.faces, mesh_of(world.run, "glb").triangles)
    [upright] = [opened.graph[name][0] for name in opened.graph.nodes_geometry]
    np.testing.assert_allclose(upright[:3, :3] @ [0, 0, 1], [0, 1, 0], atol=1e-12)


def colours(found):
    """Colours of a file as a screen has them, 0 to 1."""
    linear = found.array(found.mesh.primitives[0].attributes.COLOR_0)[:, :3] / 65535
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def test_colours_are_those_of_the_amplitude_and_grey_where_nothing_is_known(local, tmp_path):
    tree = dict(local.tree)
    tree["field"] = tree["field"].copy(deep=True)
    layer = mesh_of(local.run, "glb").surface_layer
    tree["field"]["velocity"].values[layer[4]] = np.nan
    found = Opened(Glb(frequency=195.0).export(RunData(tree, local.attributes), tmp_path, "mine"))
    _, velocity = surface(RunData(tree, local.attributes), 0)
    size = np.sqrt((np.abs(velocity) ** 2).sum(axis=1))
    known = np.isfinite(size)
    assert not known.all()
    assert found.extras["colour_range"] == [0.0, size[known].max()]
    expected = colormaps[SIZE_MAP](size[known] / size[known].max())[:, :3]
    np.testing.assert_allclose(colours(found)[known], expected, atol=1e-3)
    np.testing.assert_allclose(colours(found)[~known], 0.6, atol=1e-3)
    assert (found.extras["colour"], found.extras["colour_unit"]) == ("amplitude", "m/s")


def test_colours_are_those_of_the_strain_if_the_run_has_it(strained, tmp_path):
    found = Opened(Glb(frequency=440.0).export(strained.run, tmp_path, "mine"))
    value = strained.tree["strain"]["principal_strain"].isel(frequency=1, principal=0).values
    expected = colormaps[SIZE_MAP](value / value.max())[:, :3]
    np.testing.assert_allclose(colours(found), expected, atol=1e-3)
    assert (found.extras["colour"], found.extras["colour_unit"]) == ("largest extension", "strain")
    plain = Glb(colour=MotionColour.amplitude).export(strained.run, tmp_path, "plain")
    assert Opened(plain).extras["colour"] == "amplitude"


def test_points_are_drawn_by_what_joins_them(points, tmp_path):
    lines = [[0, 1], [1, 2]]
    modes = {}
    for name, run in {
        "lines": placed(points, line=lines),
        "both": placed(points, line=lines, triangle=[[0, 1, 2]]),
        "points": placed(points),
    }.items():
        found = Opened(Glb().export(run, tmp_path, name))
        modes[name] = [p.mode for p in found.mesh.primitives]
        hertz = run.groups["point"]["frequency"].values.tolist()
        position, velocity = surface(run, hertz.index(found.extras["frequency_hz"]))
        scale = found.extras["metres_drawn_per_metre_per_second"]
        np.testing.assert_allclose(found.at([0, 1]), position + scale * velocity.imag, atol=1e-6)
    assert modes == {"lines": [1], "both": [4, 1], "points": [0]}


def test_deflection_is_that_of_the_report(world):
    [told] = re.findall(r"DRAWN_SHARE = ([\d.]+)", PAGE.read_text())
    assert float(told) == DRAWN_SHARE


def test_strongest_frequency_of_the_surface_moves_unless_another_is_named(world):
    tree = dict(world.tree)
    tree["field"] = tree["field"].copy()
    tree["field"]["velocity"] = tree["field"]["velocity"] * [1.0, 1.0, 100.0]
    run = RunData(tree, world.attributes)
    assert motion_of(run, "glb", None, None).hertz == 545.012345
    assert motion_of(run, "glb", 545.012, None).hertz == 545.012345  # as pages show it
    with pytest.raises(UserError, match=r"export=glb: the run has nothing at 545.0 Hz; the near"):
        motion_of(run, "glb", 545.0, None)


def test_motion_without_known_frequency_or_strain(world, strained, points, tmp_path):
    tree = dict(world.tree)
    tree["field"] = tree["field"].isel(frequency=0, drop=True)
    found = Opened(Glb().export(RunData(tree, world.attributes), tmp_path, "mine"))
    assert found.extras["frequency_hz"] is None
    with pytest.raises(UserError, match=r"nothing at 100\.0 Hz; it knows no frequency"):
        Glb(frequency=100.0).export(RunData(tree, world.attributes), tmp_path, "mine")
    with pytest.raises(UserError, match="the run has no strain of this surface; choose recon"):
        Glb(colour=MotionColour.strain).export(world.run, tmp_path, "mine")
    with pytest.raises(UserError, match="export=glb needs a field over a volume or points"):
        Glb().export(points.run, tmp_path, "mine")
    lost = placed(points)
    lost.groups["line_of_sight"]["position"].values[2] = np.nan
    with pytest.raises(UserError, match="the place of n2 is not known"):
        Glb().export(lost, tmp_path, "mine")
    still = dict(world.tree)
    still["field"] = still["field"].copy()
    still["field"]["velocity"] = 0 * still["field"]["velocity"]
    rest = Opened(Glb().export(RunData(still, world.attributes), tmp_path, "rest"))
    assert rest.extras["metres_drawn_per_metre_per_second"] == 0


@pytest.mark.parametrize("bad", [{"frequency": 0.0}, {"seconds": 0.0}, {"seconds": float("nan")}])
def test_settings_of_a_motion_that_mean_nothing(bad):
    with pytest.raises(ConfigError):
        Glb(**bad)
