"""Every format of an export: one acceptance test, each file read by a tool that is not ours."""

from __future__ import annotations

import ast
import csv
import runpy
import sys
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import meshio
import numpy as np
import pytest
import pyuff
import scipy.io
import xarray as xr
import yaml

from sldvexp import dataset
from sldvexp.config import registry
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import ConfigError, UserError
from sldvexp.export import velocities_of
from sldvexp.export.uff import GeometryDataSets, ShapeNames, UffExport
from sldvexp.export.velocities import mesh_of, velocity_in_world
from sldvexp.export.vtu import Vtu
from sldvexp.io import pvd

#: What other programs need of a session, and not its velocities: tests/export/test_scan_files.py.
OF_THE_SESSION = {"reg", "scanlist"}
#: Moving pictures, whose numbers are rounded: tests/export/test_motion_exports.py.
TO_LOOK_AT = {"gif", "glb", "mp4"}
FORMATS = sorted(set(registry.BUILT_IN["export"]) - OF_THE_SESSION - TO_LOOK_AT)
RUNS = ["world", "local", "points"]
#: Formats of fields only.
FIELDS_ONLY = {"ugrid", "vtu"}
#: What six digits of a universal file's shapes leave.
SIX_DIGITS = 5e-6


@dataclass
class Read:
    """What a foreign tool finds in a file; None where the format does not say it."""

    velocity: np.ndarray
    std: np.ndarray
    confidence: np.ndarray
    frequency: np.ndarray
    components: list[str]
    units: set[str]
    position: np.ndarray | None = None
    prisms: np.ndarray | None = None
    observable: np.ndarray | None = None


def read_csv(path: Path) -> Read:
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    place = "node" if "node" in rows[0] else "point"
    components = list(dict.fromkeys(r["component"] for r in rows))
    frequency = list(dict.fromkeys(float(r["frequency_hz"]) for r in rows))
    shape = (-1, len(components), len(frequency))

    def column(name: str) -> np.ndarray:
        return np.array([float(r[name] or "nan") for r in rows]).reshape(shape)

    nodes = column(place)
    np.testing.assert_array_equal(nodes[:, 0, 0], 1 + np.arange(len(nodes)))
    return Read(
        column("real_m_per_s") + 1j * column("imag_m_per_s"),
        column("std_m_per_s"),
        column("confidence_m_per_s"),
        np.array(frequency),
        components,
        {"m/s", "Hz"},
        np.stack([column(f"{a}_m")[:, 0, 0] for a in "xyz"], 1) if place == "node" else None,
        observable=column("determined")[..., 0],
    )


def read_mat(path: Path) -> Read:
    s = scipy.io.loadmat(path, simplify_cells=True)["sldvexp"]
    shape = (-1, 3, np.size(s["frequency"]))
    return Read(
        s["velocity"].reshape(shape),
        s["velocity_std"].reshape(shape),
        s["confidence"].reshape(shape),
        np.atleast_1d(s["frequency"]),
        list(s["component"]),
        set(s["units"].values()) - {"m"},
        s.get("position"),
        s["element"] - 1 if "element" in s else None,
        s["observable"].reshape(-1, 3),
    )


def read_uff(path: Path) -> Read:
    sets = pyuff.UFF(str(path)).read_sets()
    by_type: dict[int, list] = {}
    for s in sets:
        by_type.setdefault(s["type"], []).append(s)
    assert by_type[164][0]["length"] == 1.0
    assert by_type[1858][0]["amplitude_units"] == 2
    functions = by_type[58]
    frequency = functions[0]["x"]
    nodes = int(max(f["rsp_node"] for f in functions))
    velocity = np.full((nodes, 3, len(frequency)), np.nan, complex)
    for f in functions:
        velocity[f["rsp_node"] - 1, f["rsp_dir"] - 1] = f["data"]
        assert (f["ref_node"], f["func_type"], f["ordinate_spec_data_type"]) == (0, 12, 11)
    shapes = np.full((3, *velocity.shape), np.nan, complex)
    for number, s in enumerate(by_type[55]):
        kind, step = number % 3, s["freq_step_n"] - 1
        values = np.stack([s["r1"], s["r2"], s["r3"]], axis=1)
        shapes[kind, s["node_nums"] - 1, :, step] = values
        assert s["id1"].startswith(("Velocity", "Standard error", "Half-width")[kind])
        np.testing.assert_allclose(s["freq"], frequency[step], rtol=SIX_DIGITS)
    both = np.isfinite(shapes[0])
    np.testing.assert_allclose(shapes[0][both], velocity[both], rtol=2 * SIX_DIGITS, atol=1e-12)
    place = {}
    if 2411 in by_type:
        [s] = by_type[2411]
        assert s["node_nums"].tolist() == list(range(1, nodes + 1))
        place["position"] = np.stack([s["x"], s["y"], s["z"]], axis=1)
        place["prisms"] = np.array([e["nodes_nums"] for e in by_type[2412][0][112]]) - 1
    label = functions[0]["ordinate_axis_units_lab"].strip()
    units = {label, functions[0]["abscissa_axis_units_lab"].strip()}
    return Read(velocity, shapes[1].real, shapes[2].real, frequency, [], units, **place)


def read_ugrid(path: Path) -> Read:
    with xr.open_dataset(path) as opened:
        ds = opened.load()
    names = [n.split("_")[1] for n in ds if n.startswith("velocity_") and n.endswith("_real")]

    def of(ending: str) -> np.ndarray:
        found = [ds[f"velocity_{c}_{ending}"] for c in names]
        stacked = [a.stack(node=["layer_depth", "mesh_node"]) for a in found]
        return np.stack([a.transpose("node", ...).values for a in stacked], axis=1)

    position = [ds[f"position_{a}"].stack(node=["layer_depth", "mesh_node"]) for a in "xyz"]
    triangles, step = ds["mesh_face_nodes"].values, ds.sizes["mesh_node"]
    one = np.concatenate([triangles, triangles + step], axis=1)
    prisms = np.concatenate([one + step * k for k in range(ds.sizes["layer_depth"] - 1)])
    units = {ds[f"velocity_{names[0]}_real"].units.replace("m s-1", "m/s"), ds["frequency"].units}
    return Read(
        of("real") + 1j * of("imag"),
        of("std"),
        of("confidence"),
        ds["frequency"].values,
        names,
        units,
        np.stack(position, axis=1),
        prisms,
        of("observable"),
    )


def read_vtu(path: Path) -> Read:
    import xml.etree.ElementTree as ElementTree

    steps = ElementTree.parse(path).getroot().findall("./Collection/DataSet")
    meshes = [meshio.read(path.parent / s.get("file")) for s in steps]
    data = [m.point_data for m in meshes]
    names = ("real", "imag") if "real" in data[0] else ("velocity_real", "velocity_imag")

    def of(name: str) -> np.ndarray:
        return np.stack([d[name] for d in data], axis=-1)

    for d in data:
        velocity = d["velocity_real"] + 1j * d["velocity_imag"]
        np.testing.assert_array_equal(d["velocity_amplitude"], np.abs(velocity))
        np.testing.assert_array_equal(d["velocity_phase"], np.angle(velocity))
    [cells] = meshes[0].cells
    assert cells.type == "wedge"
    return Read(
        of(names[0]) + 1j * of(names[1]),
        of("velocity_std"),
        of("confidence"),
        np.array([float(s.get("timestep")) for s in steps]),
        [],
        {"m/s", "Hz"},
        meshes[0].points,
        cells.data[:, [0, 2, 1, 3, 5, 4]],  # meshio has turned them over
        data[0]["observable"],
    )


READERS = {"csv": read_csv, "mat": read_mat, "uff": read_uff, "ugrid": read_ugrid, "vtu": read_vtu}


@pytest.mark.one_in(4)
@pytest.mark.parametrize("run", RUNS)
@pytest.mark.parametrize("name", FORMATS)
def test_format_holds_what_the_run_has(name, run, request, tmp_path):
    made = request.getfixturevalue(run)
    export = registry.get("export", name)()
    if run == "points" and name in FIELDS_ONLY:
        with pytest.raises(UserError, match=f"export={name} needs a field over a volume"):
            export.export(made.run, tmp_path, "mine")
        assert list(tmp_path.iterdir()) == []
        return
    path = export.export(made.run, tmp_path, "mine")
    assert path == tmp_path / f"mine{export.suffix}"
    assert not [p for p in tmp_path.rglob(".*")]

    found = READERS[name](path)
    group = made.tree["point" if run == "points" else "field"]
    known = {n: group[n].values.reshape(-1, 3, 3) for n in ("velocity", "velocity_std")}
    known["confidence"] = group["confidence"].values.reshape(-1, 3, 3)
    digits = 1e-12 if name == "uff" else 0
    np.testing.assert_allclose(found.velocity, known["velocity"], rtol=digits, atol=0)
    six, missing = SIX_DIGITS if name == "uff" else 0, np.zeros(len(found.std), bool)
    if name == "uff":  # a shape has all components of a node, or not the node
        missing = ~np.isfinite(known["velocity"]).all(axis=(1, 2))
        assert np.isnan(found.std[missing]).all()
    for bound, of in ((found.std, "velocity_std"), (found.confidence, "confidence")):
        np.testing.assert_allclose(bound[~missing], known[of][~missing], rtol=six, atol=0)
    np.testing.assert_allclose(found.frequency, group["frequency"], rtol=six, atol=0)
    assert found.units == {"m/s", "Hz"}
    if found.components:
        assert found.components == group["component"].values.tolist()
    if found.observable is not None:
        np.testing.assert_array_equal(found.observable, group["observable"].values.reshape(-1, 3))
    if run != "points":
        np.testing.assert_allclose(found.position, group["position"], rtol=1e-15, atol=1e-18)
        if name != "csv":
            np.testing.assert_array_equal(found.prisms, group["element"])


@pytest.mark.parametrize("name", FORMATS)
def test_format_says_that_there_is_nothing(name, points, tmp_path):
    export = registry.get("export", name)()
    tree = {k: g for k, g in points.tree.items() if k != "point"}
    with pytest.raises(UserError, match="the run has no velocities to export; choose a reco"):
        export.export(RunData(tree, {}), tmp_path, "mine")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", FORMATS)
def test_format_leaves_the_old_file_if_it_cannot_be_replaced(name, world, tmp_path, monkeypatch):
    export = registry.get("export", name)()
    path = export.export(world.run, tmp_path, "mine")
    before = path.read_bytes()

    def refuse(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", refuse)
    with pytest.raises(UserError, match="cannot be written: No space left on device"):
        export.export(world.run, tmp_path, "mine")
    assert path.read_bytes() == before
    assert not [p for p in tmp_path.rglob(".*")]


@pytest.mark.parametrize("name", FORMATS)
def test_frequency_that_is_not_known(name, world, tmp_path):
    tree = dict(world.tree)
    tree["field"] = tree["field"].isel(frequency=0, drop=True)
    export = registry.get("export", name)()
    if name == "uff":
        with pytest.raises(UserError, match="export=uff: the run's velocities have no frequency"):
            export.export(RunData(tree, world.attributes), tmp_path, "mine")
        return
    path = export.export(RunData(tree, world.attributes), tmp_path, "mine")
    known = tree["field"]["velocity"].values
    if name == "ugrid":
        with xr.open_dataset(path) as found:
            assert found["velocity_z_imag"].dims == ("layer_depth", "mesh_node")
            np.testing.assert_array_equal(found["velocity_z_imag"].values.ravel(), known[:, 2].imag)
    elif name == "vtu":
        np.testing.assert_array_equal(read_vtu(path).velocity[..., 0], known)
        last = meshio.read(tmp_path / "mine" / "phase_00001.vtu").point_data
        assert set(last) == {"velocity", "determined"}
    elif name == "mat":
        assert np.isnan(read_mat(path).frequency).all()
    else:
        assert ",x,," in path.read_text().splitlines()[1]


def test_points_of_known_places_have_them_in_a_table(points, tmp_path):
    group, tree = points.tree["point"], dict(points.tree)
    count = group.sizes.get("point", 1)
    place = np.random.default_rng(3).normal(size=(count, 3))
    names = [f"n{i}" for i in range(count)]
    if "point" not in group.dims:
        group = group.expand_dims(point=names)
    tree["point"] = group.assign_coords(point=names)
    turned = slice(None, None, -1)
    known = xr.Dataset({"position": (("point", "axis"), place[turned])}, {"point": names[turned]})
    tree["line_of_sight"] = known
    path = registry.get("export", "csv")().export(
        RunData(tree, points.attributes), tmp_path, "mine"
    )
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        at = [float(row[f"{axis}_m"]) for axis in "xyz"]
        np.testing.assert_array_equal(at, place[names.index(row["point"])])
    assert len(rows) == group["velocity"].size


@pytest.mark.parametrize("name", ["a/b", "../b", ".b", "/b"])
def test_file_stays_in_the_folder(name, points, tmp_path):
    export = registry.get("export", "csv")()
    with pytest.raises(UserError, match="cannot name a folder"):
        export.export(points.run, tmp_path, name)


def test_run_writes_its_exports_beside_its_file(sldvexp):
    done = sldvexp("experiment=point", "export={mine: {plugin: csv}, other: {plugin: mat}}")
    assert done.status == 0, done.err
    assert {"run.nc", "mine.csv", "other.mat"} <= {p.name for p in done.folder.iterdir()}
    assert "mine.csv" in done.out.replace("\n", "")


def test_run_stays_if_it_cannot_be_exported(sldvexp):
    done = sldvexp("experiment=point", "export.mine.plugin=vtu")
    assert done.status != 0
    assert "export.mine: export=vtu needs a field over a volume" in done.err
    assert (done.folder / "run.nc").is_file()


def test_command_exports_a_run_that_exists(sldvexp, points):
    (points.folder / "velocity.csv").unlink(missing_ok=True)
    done = sldvexp("export", str(points.folder), "csv", "uff", "uff.shapes=mode")
    assert (done.status, done.err) == (0, "")
    names = [Path(line).name for line in done.out.splitlines()]
    assert names == ["velocity.csv", "velocity.uff"]
    again = sldvexp("export", str(points.folder / "run.nc"), "mat")
    assert Path(again.out.strip()) == points.folder / "velocity.mat"


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        ([], "export takes a run.nc, or the folder of one, and formats"),
        (["{run}"], "formats: csv, gif, glb, mat, mp4, reg, scanlist, uff, ugrid, vtu"),
        (["{run}", "vtk"], "there is no export=vtk; did you mean vtu? Valid: csv, gif, "),
        (["nowhere", "csv"], "nowhere: there is no such file"),
        (["{run}", "csv", "vtu.phases=3"], "vtu.phases=3 must begin with a format that is"),
        (["{run}", "vtu", "vtu.phases=2"], "vtu.phases must be 0 or at least 3, not 2"),
        (["{run}", "vtu", "vtu.phase=3"], "vtu.phase"),
        (["{run}", "uff", "uff.shapes=modes"], "uff.shapes"),
    ],
)
def test_command_says_what_is_wrong(words, answer, sldvexp, points):
    done = sldvexp("export", *(w.format(run=points.folder) for w in words))
    assert done.status != 0
    assert answer in done.err
    assert len(done.err.strip().splitlines()) == 1


# ---- what single formats have besides


def test_period_of_one_frequency_is_played(local, tmp_path):
    Vtu(phases=8, animated=440.0).export(local.run, tmp_path, "mine")
    velocity = velocity_in_world(velocities_of(local.run), mesh_of(local.run, "vtu"))[..., 1]
    for k in range(8):
        data = meshio.read(tmp_path / "mine" / f"phase_{k + 1:05d}.vtu").point_data
        turned = velocity * np.exp(2j * np.pi * k / 8)
        np.testing.assert_allclose(data["velocity"], turned.real, atol=1e-15)
        moved = (turned / (2j * np.pi * 440)).real
        np.testing.assert_allclose(data["displacement"], moved, atol=1e-18)
    text = (tmp_path / "mine_phase.pvd").read_text()
    assert text.count("<DataSet") == 8
    assert f'timestep="{1 / 440 / 8!r}"' in text


class Spoken:
    """A module that notes what is asked of it, in place of ParaView's."""

    def __init__(self, name, notes):
        self.__dict__.update(name=name, notes=notes)

    def __getattr__(self, part):
        return Spoken(f"{self.name}.{part}", self.notes)

    def __call__(self, *words, **named):
        self.notes[self.name] = (words, named)
        return Spoken(f"{self.name}()", self.notes)

    def __setattr__(self, part, value):
        self.notes[f"{self.name}.{part}"] = value


@pytest.mark.parametrize("hertz", [440.0, None])
def test_script_for_paraview_opens_the_period(hertz, local, tmp_path, monkeypatch):
    tree = dict(local.tree)
    if hertz is None:
        tree["field"] = tree["field"].isel(frequency=1, drop=True)
    Vtu(phases=3, animated=hertz).export(RunData(tree, local.attributes), tmp_path, "my 'own'")
    notes: dict[str, object] = {}
    monkeypatch.setitem(sys.modules, "paraview", Spoken("paraview", notes))
    runpy.run_path(str(tmp_path / "my 'own'_paraview.py"))
    _, opened = notes["paraview.simple.PVDReader"]
    assert Path(opened["FileName"]) == tmp_path / "my 'own'_phase.pvd"
    assert Path(opened["FileName"]).is_file()
    vector = "displacement" if hertz else "velocity"
    assert notes["paraview.simple.WarpByVector().Vectors"] == ["POINTS", vector]
    data = meshio.read(tmp_path / "my 'own'" / "phase_00001.vtu").point_data
    assert {"velocity", "determined", vector} == set(data)
    velocity = velocity_in_world(velocities_of(local.run), mesh_of(local.run, "vtu"))[..., 1]
    unknown = np.isnan(velocity).any(axis=1)
    assert np.flatnonzero(unknown).tolist() == [5, 7]
    np.testing.assert_array_equal(data["determined"], (~unknown).astype(int))
    largest = np.sqrt(np.nansum(np.abs(velocity) ** 2, axis=1)).max()
    diagonal = np.linalg.norm(np.ptp(local.tree["field"]["position"].values, axis=0))
    away = largest / (2 * np.pi * hertz) if hertz else largest
    scale = notes["paraview.simple.WarpByVector().ScaleFactor"]
    assert scale * away == pytest.approx(0.08 * diagonal)
    [least, most] = notes["paraview.simple.GetColorTransferFunction().RescaleTransferFunction"][0]
    assert (least, most) == (0.0, pytest.approx(largest))


def test_names_of_exports_are_only_text_in_the_script_for_paraview(local, tmp_path):
    name = '""";raise SystemExit;"""'
    Vtu(phases=3).export(RunData(local.tree, local.attributes), tmp_path, name)
    script = ast.parse((tmp_path / f"{name}_paraview.py").read_text(encoding="utf-8"))
    assert not any(isinstance(part, ast.Raise) for part in ast.walk(script))
    texts = [part.value for part in ast.walk(script) if isinstance(part, ast.Constant)]
    assert f"{name}_phase.pvd" in texts


@pytest.mark.parametrize("comment", ["a--b", "a---b", "-->", "----", "ends with -", "\x1b[31m"])
def test_files_of_vtk_are_xml_whatever_their_comment(comment):
    assert ElementTree.fromstring(pvd({0.0: Path("a.vtu")}, comment)).tag == "VTKFile"


def test_strongest_frequency_is_played_unless_another_is_named(world, tmp_path):
    tree = dict(world.tree)
    tree["field"] = tree["field"].copy()
    tree["field"]["velocity"] = tree["field"]["velocity"] * [1.0, 100.0, 1.0]
    Vtu(phases=3).export(RunData(tree, world.attributes), tmp_path, "mine")
    data = meshio.read(tmp_path / "mine" / "phase_00001.vtu").point_data
    np.testing.assert_array_equal(data["velocity"], tree["field"]["velocity"].values[..., 1].real)
    with pytest.raises(UserError, match=r"nothing at 441.0 Hz; the nearest is 440.0"):
        Vtu(animated=441.0).export(world.run, tmp_path, "mine")
    for bad in ({"phases": 2}, {"phases": -1}, {"animated": 0.0}):
        with pytest.raises(ConfigError):
            Vtu(**bad)


def test_world_velocity_turns_local_components(local):
    world = velocity_in_world(velocities_of(local.run), mesh_of(local.run, "vtu"))
    frame, node = local.tree["volume"]["frame"].values, 14
    own = frame[node % len(frame)]
    assert not np.allclose(own, np.eye(3), atol=1e-2)
    expected = sum(
        own[c] * velocities_of(local.run)["velocity"].values[node, c, 0] for c in range(3)
    )
    np.testing.assert_allclose(world[node, :, 0], expected)


def test_universal_file_has_the_axes_of_every_node(local, tmp_path):
    path = UffExport().export(local.run, tmp_path, "mine")
    sets = {s["type"]: s for s in pyuff.UFF(str(path)).read_sets()}
    frame = local.tree["volume"]["frame"].values
    axes = dict(zip(sets[2420]["CS_sys_labels"], sets[2420]["CS_matrices"], strict=True))
    np.testing.assert_array_equal(axes[1][:3], np.eye(3))
    for node, system in enumerate(sets[2411]["disp_cs"]):
        np.testing.assert_allclose(axes[system][:3], frame[node % len(frame)], atol=1e-15)
    triangles = np.array([e["nodes_nums"] for e in sets[2412][91]]) - 1
    middle = local.tree["volume"]["node_layer"].values[triangles]
    assert set(middle.ravel()) == {1}
    assert sets[55]["node_nums"].tolist() == [n for n in range(1, 37) if n not in (6, 8)]


def test_universal_file_for_programs_that_know_the_older_sets_only(local, tmp_path):
    export = UffExport(geometry=GeometryDataSets.legacy, shapes=ShapeNames.mode)
    path = export.export(local.run, tmp_path, "mine")
    sets: dict[int, list] = {}
    for s in pyuff.UFF(str(path)).read_sets():
        sets.setdefault(s["type"], []).append(s)
    assert not {2411, 2412, 2420} & set(sets)
    [nodes], [lines], [systems] = sets[15], sets[82], sets[18]
    position = np.stack([nodes["x"], nodes["y"], nodes["z"]], axis=1)
    np.testing.assert_allclose(position, local.tree["field"]["position"], rtol=SIX_DIGITS)
    drawn = [
        list(map(int, t.split()))
        for t in " ".join(map(str, lines["nodes"].astype(int))).split(" 0")
    ]
    triangles = mesh_of(local.run, "uff").surface_triangles + 1
    assert [t for t in drawn if t] == [[*t, t[0]] for t in triangles.tolist()]
    frame = local.tree["volume"]["frame"].values
    np.testing.assert_allclose(systems["x_point"][1:], frame[:, 0], rtol=SIX_DIGITS, atol=1e-12)
    np.testing.assert_allclose(systems["xz_point"][1:], frame[:, 2], rtol=SIX_DIGITS, atol=1e-12)
    modes = [s for s in sets[55] if s["analysis_type"] == 3]
    assert len(modes) == 3
    expected = 2j * np.pi * local.tree["field"]["frequency"].values
    np.testing.assert_allclose([m["eig"] for m in modes], expected, rtol=SIX_DIGITS)


@pytest.mark.parametrize("last", [301.0, 301.001])
def test_frequencies_that_are_exactly_even_have_no_column_of_their_own(last, points, tmp_path):
    tree = dict(points.tree)
    tree["point"] = tree["point"].assign_coords(frequency=[100.5, 200.75, last])
    text = UffExport().export(RunData(tree, points.attributes), tmp_path, "mine").read_text()
    even = "         6         3         1  1.00500E+02  1.00250E+02"
    assert (even in text) == (last == 301.0)
    found = read_uff(tmp_path / "mine.uff")
    np.testing.assert_allclose(found.frequency, [100.5, 200.75, last], rtol=1e-15)
    np.testing.assert_allclose(found.velocity[0], tree["point"]["velocity"], rtol=1e-12)


def test_experiments_of_the_program_export_nothing_unasked():
    config = yaml.safe_load((Path(__file__).parents[2] / "conf/config.yaml").read_text())
    assert "export" not in str(config["defaults"])


def test_conventions_go_along(world, tmp_path):
    for name in FORMATS:
        if name == "csv":
            continue
        path = registry.get("export", name)().export(world.run, tmp_path, name)
        if name == "mat":
            text = str(scipy.io.loadmat(path, simplify_cells=True)["sldvexp"]["about"])
        elif name == "ugrid":
            with xr.open_dataset(path) as found:
                text = str(found.attrs)
        else:
            text = path.read_text()
        assert "peak" in text
        assert dataset.CONVENTIONS["time_convention"] in text
