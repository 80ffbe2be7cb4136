"""Exports to look at: the surface moves as the field says, told by readers that are not ours."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib import colormaps
from PIL import Image
from scipy import ndimage

from sldvexp.config.paths import HANDBOOK
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import ConfigError, UserError
from sldvexp.export.gif import Gif
from sldvexp.export.glb import Glb
from sldvexp.export.motion import MotionColour, motion_of
from sldvexp.export.mp4 import Mp4
from sldvexp.export.velocities import mesh_of, velocities_of, velocity_in_world
from sldvexp.export.vtu import Vtu
from sldvexp.plot import MovingShape
from sldvexp.plot.moving_look import MOVING_SHARE, PALE, PALENESS
from sldvexp.plot.style import SIZE_MAP
from sldvexp.report.html.shape import LOOK
from tests.shell.made_strain import made_strain

PAGE = Path(__file__).parents[2] / "sldvexp/report/html"
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
    assert scale * largest == pytest.approx(MOVING_SHARE * diagonal, rel=1e-12)


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
    strain = strained.tree["strain"].isel(frequency=1, principal=0)
    value = strain["principal_strain"].values
    clear = value >= strain["principal_confidence"].values
    assert 0 < clear.sum() < len(clear)
    expected = colormaps[SIZE_MAP](value / value.max())[:, :3]
    np.testing.assert_allclose(colours(found)[clear], expected[clear], atol=1e-3)
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


def test_picture_is_that_of_the_report():
    """Deflection, where it is seen from, its time, and what is below its bound: said once."""
    own = LOOK["azimuth"], LOOK["elevation"], LOOK["seconds"]
    assert own == (Gif().azimuth, Gif().elevation, Gif().seconds)
    assert (LOOK["share"], LOOK["pale"], LOOK["paleness"]) == (MOVING_SHARE, PALE, PALENESS)
    scripts = "".join(page.read_text() for page in PAGE.glob("*.js"))
    for name, value in (("azimuth", "118.5"), ("none", "32768"), ("seconds", "2.5")):
        assert value in f"{LOOK[name]}"
        assert not re.search(rf"(?<![\d.]){re.escape(value)}(?![\d.])", scripts), name
    for name in LOOK:
        assert re.search(rf"[{{,] *{name}\b|data\.look\.{name}\b", scripts), name


@pytest.mark.parametrize("colour", MotionColour)
def test_values_below_their_bounds_are_pale(colour, strained, tmp_path):
    tree = dict(strained.tree)
    layer, few = mesh_of(strained.run, "glb").surface_layer, [2, 5]
    tree["field"] = tree["field"].copy(deep=True)
    tree["strain"] = tree["strain"].copy(deep=True)
    tree["field"]["confidence"].values[:] *= 1e-9
    tree["field"]["confidence"].values[layer[few]] = 1.0
    tree["strain"]["principal_confidence"].values[:] *= 1e-9
    tree["strain"]["principal_confidence"].values[few] = 1.0
    run = RunData(tree, strained.attributes)
    motion = motion_of(run, "glb", 440.0, colour)
    assert np.flatnonzero(motion.faint & (motion.value > 0)).tolist() == few
    found = Opened(Glb(frequency=440.0, colour=colour).export(run, tmp_path, "mine"))
    full = colormaps[SIZE_MAP](motion.value / motion.value.max())[:, :3]
    expected = np.where(motion.faint[:, None], 0.25 * full + 0.75 * 0.93, full)
    np.testing.assert_allclose(colours(found), expected, atol=1e-3)
    assert found.extras["pale_below_their_bound"] == motion.faint.sum()


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


# ---- moving pictures


def frames(path):
    """Every frame of a GIF, as a screen shows it."""
    with Image.open(path) as file:
        found = []
        for k in range(file.n_frames):
            file.seek(k)
            assert file.info["duration"] == 100
            found.append(np.asarray(file.convert("RGB")))
        assert file.info["loop"] == 0
    return np.array(found)


def film(path):
    """Every frame of a film, and how many there are in a second."""
    cv2 = pytest.importorskip("cv2")
    opened, found = cv2.VideoCapture(str(path)), []
    while (read := opened.read())[0]:
        found.append(read[1][..., ::-1])
    return np.array(found), opened.get(cv2.CAP_PROP_FPS)


def furthest(found, pictures):
    """The picture that each frame is most like, and how far from it colours are at most."""
    away = np.abs(found[:, None].astype(float) - pictures[None]).mean(axis=(2, 3, 4))
    return away.argmin(axis=1).tolist(), away.min(axis=1).max()


@pytest.mark.whole
def test_gif_has_a_period_of_frames_that_is_repeated(strained, tmp_path):
    export = Gif(frequency=440.0, width=320, height=200, fps=10.0, seconds=0.8)
    found = frames(export.export(strained.run, tmp_path, "mine"))
    assert found.shape == (8, 200, 320, 3)
    pictures = np.array(list(export.pictures(strained.run, "gif")))
    alike, away = furthest(found, pictures)
    assert alike == list(range(8))
    assert away < 2.5  # of 255, what 256 colours leave
    assert (found[:, 0, -1] == 255).all()  # paper stays white
    motion = motion_of(strained.run, "gif", 440.0, None)
    assert motion.title == "largest extension"
    shape = MovingShape(
        motion.position,
        motion.cells,
        motion.drawn,
        motion.value,
        motion.faint,
        "440 Hz, displacement × " + f"{float(f'{2 * np.pi * 440 * motion.scale:.2g}'):g}",
        "largest extension",
        "strain",
        (320, 200),
        -118.5,
        30.0,
    )
    np.testing.assert_array_equal(pictures[3], shape.picture(2 * np.pi * 3 / 8))
    np.testing.assert_array_equal(pictures[0], shape.picture(2 * np.pi))


@pytest.mark.whole
def test_film_has_its_periods(world, tmp_path):
    pytest.importorskip("cv2")
    export = Mp4(frequency=440.0, width=320, height=200, fps=10.0, seconds=0.8, periods=3)
    found, fps = film(export.export(world.run, tmp_path, "mine"))
    assert (found.shape, fps) == ((24, 200, 320, 3), 10.0)
    alike, away = furthest(found, np.array(list(export.pictures(world.run, "mp4"))))
    assert alike == 3 * list(range(8))
    assert away < 8  # of 255: a film has fewer colours than brightnesses


def marked(picture):
    """Middles of the coloured dots of a picture, from the left, in pixels from the lower left."""
    inked = np.ptp(picture, axis=2)
    labels, count = ndimage.label(inked[:, : int(0.82 * inked.shape[1])] > 40)
    middles = np.array(ndimage.center_of_mass(labels > 0, labels, range(1, count + 1)))
    across, down = middles.T[::-1]
    order = np.argsort(across)
    return np.stack([across[order], len(picture) - down[order]], axis=1)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("phase", PHASES)
def test_picture_shows_nodes_where_they_are(phase):
    """Seen along y all dots are equally far, so that distances in the picture are true."""
    place = np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 1.0]])
    away = np.zeros((4, 3), complex)
    away[1] = [0.2, 0, 0.5j]
    values, dots = (np.ones(4), np.zeros(4, bool)), [np.arange(4)[:, None]]
    shape = MovingShape(place, dots, away, *values, "", "amplitude", "m/s", (800, 400), -90.0, 0.0)
    seen = marked(shape.picture(phase))
    assert len(seen) == 4
    metre = (seen[3] - seen[0])[0] / 3
    expected = place + (away * np.exp(1j * phase)).real
    np.testing.assert_allclose(seen - seen[0], metre * expected[:, [0, 2]], atol=1.0)


def test_nearer_triangles_hide_those_behind():
    """Of two squares behind each other the nearer is seen, whatever their order."""
    square = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1.0]])
    place = np.concatenate([square, square + np.array([0, 0.5, 0])])  # the second is behind
    near, behind = np.array([[0, 1, 2], [0, 2, 3]]), np.array([[4, 5, 6], [4, 6, 7]])
    value, still = np.repeat([1.0, 0.2], 4), np.zeros((8, 3), complex)
    for order in ([near, behind], [behind, near]):
        look = (np.zeros(8, bool), "", "amplitude", "m/s", (300, 300), -90.0, 0.0)
        shape = MovingShape(place, [np.concatenate(order)], still, value, *look)
        red, green, blue = shape.picture(0.0)[150, 120].astype(int)
        assert red > 1.5 * blue  # yellow
        assert green > blue


@pytest.mark.parametrize(
    "bad",
    [
        {"width": 100},
        {"height": 5000},
        {"fps": 0.0},
        {"fps": 1.0, "seconds": 2.0},
        {"fps": 1e9},
        {"fps": float("nan")},
        {"azimuth": float("inf")},
    ],
)
@pytest.mark.parametrize("kind", [Gif, Mp4])
def test_pictures_that_cannot_be(kind, bad):
    with pytest.raises(ConfigError):
        kind(**bad)


def test_formats_have_limits_of_their_own():
    for fps in (60.0, 24.0, 30.0):
        with pytest.raises(ConfigError, match="must be 100 over a whole number, 50 at most"):
            Gif(fps=fps)
    assert [Gif(fps=fps).frames for fps in (50.0, 100 / 3, 12.5)] == [125, 83, 31]
    with pytest.raises(ConfigError, match="must be an even number of pixels"):
        Mp4(width=321)
    with pytest.raises(ConfigError, match="periods"):
        Mp4(periods=0)


def test_command_makes_a_moving_picture_and_says_what_a_film_needs(sldvexp, world, monkeypatch):
    words = ("gif.width=320", "gif.height=200", "gif.seconds=0.4", "gif.fps=10")
    done = sldvexp("export", str(world.folder), "gif", *words)
    assert (done.status, done.err) == (0, "")
    assert Path(done.out.strip()) == world.folder / "motion.gif"
    wrong = sldvexp("export", str(world.folder), "gif", "gif.fps=24")
    assert "command line: gif.fps must be 100 over a whole number" in wrong.err
    monkeypatch.setattr("sldvexp.export.mp4.find_spec", lambda name: None)
    missing = sldvexp("export", str(world.folder), "mp4")
    assert "command line: mp4 needs the package opencv-python-headless: pip" in missing.err


def test_handbook_tells_every_setting_of_a_motion():
    table = (HANDBOOK / "motion.md").read_text(encoding="utf-8").split("| setting |")[1]
    told: dict[str, set[str]] = {}
    for names, formats in re.findall(r"^\| (`.*?`) \| (`.*?`) \|", table, re.MULTILINE):
        for name in re.findall(r"`(\w+)`", formats):
            told.setdefault(name, set()).update(re.findall(r"`(\w+)`", names))
    kinds = {"glb": Glb, "gif": Gif, "mp4": Mp4, "vtu": Vtu}
    assert told == {name: {f.name for f in fields(kind)} for name, kind in kinds.items()}
