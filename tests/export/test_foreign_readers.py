"""Exports opened by the programs that they are made for, as far as these are installed."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from sldvexp.export import velocities_of
from sldvexp.export.uff import ShapeNames, UffExport
from sldvexp.export.ugrid import Ugrid
from sldvexp.export.velocities import mesh_of, velocity_in_world
from sldvexp.export.vtu import Vtu
from tests.shell.made_strain import made_strain

RUNS = ["world", "local"]


@pytest.fixture(params=RUNS)
def made(request):
    return request.getfixturevalue(request.param)


def known(made, name: str) -> np.ndarray:
    return made.tree["field"][name].values


@pytest.mark.whole
def test_sdynpy_takes_geometry_functions_and_shapes(made, tmp_path, monkeypatch):
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")  # or it ends the process
    sdynpy = pytest.importorskip("sdynpy")
    path = UffExport(shapes=ShapeNames.mode).export(made.run, tmp_path, "mine")
    unv = sdynpy.unv.readunv(str(path))
    geometry = sdynpy.geometry.from_unv(unv)
    np.testing.assert_allclose(geometry.node.coordinate, known(made, "position"), atol=1e-15)
    wedges = geometry.element[geometry.element.type == 112]
    prisms = np.array([*wedges.connectivity]) - 1
    np.testing.assert_array_equal(prisms, known(made, "element"))

    functions = sdynpy.data.from_unv(unv)
    assert type(functions).__name__ == "SpectrumArray"
    velocity = known(made, "velocity")
    at = functions.coordinate[..., 0]
    np.testing.assert_allclose(
        functions.ordinate, velocity[at.node - 1, at.direction - 1], rtol=1e-12
    )
    determined = np.isfinite(velocity).all(axis=2)
    assert len(functions) == determined.sum()
    np.testing.assert_allclose(functions.abscissa[0], known(made, "frequency"), rtol=5e-6)

    # Directions in the world, by what SDynPy makes of the nodes' coordinate systems.
    directions = geometry.global_deflection(at)
    world = np.zeros((len(velocity), 3, 3), complex)
    np.add.at(world, at.node - 1, directions[:, :, None] * functions.ordinate[:, None, :])
    whole = determined.all(axis=1)
    expected = velocity_in_world(velocities_of(made.run), mesh_of(made.run, "vtu"))[whole]
    np.testing.assert_allclose(world[whole], expected, atol=1e-12 * np.abs(expected).max())

    modes = sdynpy.shape.from_unv({55: [s for s in unv[55] if s.analysis_type == 3]})
    np.testing.assert_allclose(modes.frequency, known(made, "frequency"), rtol=5e-6)
    shape = modes.shape_matrix.reshape(3, -1, 3).transpose(1, 2, 0)
    np.testing.assert_allclose(shape, velocity[whole], rtol=1e-5)
    std = [s for s in unv[55] if s.idline1.startswith("Standard error")]
    found = np.array([list(s.node_data_dictionary.values()) for s in std])
    expected = known(made, "velocity_std")[whole].transpose(2, 0, 1)
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_paraview_steps_through_frequencies_and_phases(made, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    path = Vtu(phases=6).export(made.run, tmp_path, "mine")
    world = velocity_in_world(velocities_of(made.run), mesh_of(made.run, "vtu"))
    reader = pyvista.get_reader(str(path))
    assert list(reader.time_values) == known(made, "frequency").tolist()
    for i, frequency in enumerate(reader.time_values):
        reader.set_active_time_value(frequency)
        [mesh] = reader.read()
        found = mesh.point_data
        np.testing.assert_array_equal(mesh.points, known(made, "position"))
        velocity = found["velocity_real"] + 1j * found["velocity_imag"]
        np.testing.assert_array_equal(velocity, world[..., i])
        for name in ("velocity_std", "confidence"):
            np.testing.assert_array_equal(found[name], known(made, name)[..., i])
        np.testing.assert_array_equal(found["observable"], known(made, "observable"))
        assert mesh.field_data["TimeValue"].tolist() == [frequency]
    names = [found.GetArray("confidence").GetComponentName(i) for i in range(3)]
    assert names == made.tree["field"]["component"].values.tolist()

    assert (mesh.compute_cell_sizes()["Volume"] > 0).all()
    assert mesh.volume == pytest.approx(0.2 * 0.15 * 0.01, rel=0.02)
    played = pyvista.get_reader(str(tmp_path / "mine_phase.pvd"))
    assert len(played.time_values) == 6
    played.set_active_time_point(2)
    [instant] = played.read()
    turned = (
        world[..., np.nansum(np.abs(world) ** 2, axis=(0, 1)).argmax()] * np.exp(2j * np.pi / 3)
    ).real
    np.testing.assert_allclose(instant.point_data["velocity"], turned, atol=1e-15)
    assert np.isfinite(instant.warp_by_vector("displacement").points).any()
    assert (instant.active_scalars_name, instant.active_vectors_name) == (
        "velocity",
        "displacement",
    )
    assert (mesh.active_scalars_name, mesh.active_vectors_name) == (
        "velocity_amplitude",
        "velocity_real",
    )


def test_period_is_drawn_as_the_script_for_paraview_says(made, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    Vtu(phases=4, animated=440.0).export(made.run, tmp_path, "mine")
    script = (tmp_path / "mine_paraview.py").read_text()
    scale, largest = (
        float(re.search(rf"^{name} = (.*)$", script, re.MULTILINE)[1])
        for name in ("SCALE", "LARGEST")
    )
    played = pyvista.get_reader(str(tmp_path / "mine_phase.pvd"))
    played.set_active_time_point(1)
    [instant] = played.read()
    known = instant.threshold((0.5, 1.5), scalars="determined", all_scalars=True)
    moved = known.warp_by_vector("displacement", factor=scale)
    rest = np.ptp(instant.points, axis=0)
    away = np.linalg.norm(moved.points - known.points, axis=1)
    assert 0.01 < away.max() / np.linalg.norm(rest) < 0.081  # of the largest, at another phase
    plotter = pyvista.Plotter(off_screen=True, window_size=(320, 240))
    plotter.add_mesh(moved, clim=(0, largest), show_scalar_bar=False)  # coloured by what is active
    picture = plotter.screenshot(return_img=True)
    plotter.close()
    assert moved.active_scalars_name == "velocity"
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50


def test_strain_has_its_stress_active(made, tmp_path):
    pyvista = pytest.importorskip("pyvista")
    strain = made_strain(made.tree["volume"], tuple(known(made, "frequency")))
    run = replace(made, tree=made.tree | {"strain": strain}).run
    Vtu(phases=0).export(run, tmp_path, "mine")
    assert not (tmp_path / "mine_paraview.py").exists()
    surface = pyvista.read(tmp_path / "mine" / "strain_00001.vtu")
    assert (surface.active_scalars_name, surface.active_vectors_name) == (
        "von_mises",
        "displacement_real",
    )
    np.testing.assert_array_equal(surface.active_scalars, strain["von_mises"].values[:, 0])


def test_xugrid_finds_the_mesh_and_its_layers(made, tmp_path):
    xugrid = pytest.importorskip("xugrid")
    path = Ugrid().export(made.run, tmp_path, "mine")
    with xugrid.open_dataset(path) as found:
        grid = found.ugrid.grid
        nodes = grid.n_node
        velocity = known(made, "velocity")
        assert grid.n_face == len(known(made, "element")) // 2
        triangles = known(made, "element")[: grid.n_face, :3]
        np.testing.assert_array_equal(grid.face_node_connectivity, triangles)
        middle = known(made, "position")[nodes : 2 * nodes]
        np.testing.assert_array_equal(grid.node_coordinates, middle[:, :2])
        for i, c in enumerate(made.tree["field"]["component"].values):
            part = found[f"velocity_{c}_real"]
            assert part.units == "m s-1"
            assert part.dims == ("frequency", "layer_depth", grid.node_dimension)
            both = part.values + 1j * found[f"velocity_{c}_imag"].values
            np.testing.assert_array_equal(both.reshape(3, -1).T, velocity[:, i])
            std = found[f"velocity_{c}_std"].values.reshape(3, -1).T
            np.testing.assert_array_equal(std, known(made, "velocity_std")[:, i])


def test_uxarray_opens_the_mesh(made, tmp_path):
    uxarray = pytest.importorskip("uxarray")
    path = Ugrid().export(made.run, tmp_path, "mine")
    found = uxarray.open_dataset(str(path), str(path))
    assert found.uxgrid.n_face == len(known(made, "element")) // 2
    c = made.tree["field"]["component"].values[2]
    both = found[f"velocity_{c}_real"].values + 1j * found[f"velocity_{c}_imag"].values
    np.testing.assert_array_equal(both.reshape(3, -1).T, known(made, "velocity")[:, 2])


def test_compliance_checker_finds_nothing_against_cf(made, tmp_path):
    runner = pytest.importorskip("compliance_checker.runner")
    path = Ugrid().export(made.run, tmp_path, "mine")
    runner.CheckSuite.load_all_available_checkers()
    report = tmp_path / "report.json"
    _, errors = runner.ComplianceChecker.run_checker(
        str(path), ["cf:1.11"], 0, "strict", output_filename=str(report), output_format="json"
    )
    assert not errors
    found = json.loads(report.read_text())["cf:1.11"]
    every = [
        p for key in ("high_priorities", "medium_priorities", "low_priorities") for p in found[key]
    ]
    assert len(every) > 10
    told = {m for p in every for m in p["msgs"]}
    # CF 1.11 takes the roles of UGRID in (its section 5.9); the checker knows the older ones only.
    unknown = {m for m in told if "cf_role" not in m}
    assert unknown == set()
