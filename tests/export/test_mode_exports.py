"""Mode shapes in the formats of other programs, with their poles where a format holds them."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import pyuff

from sldvexp import dataset
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import UserError
from sldvexp.export.base import VelocitiesOf
from sldvexp.export.csv import Csv
from sldvexp.export.glb import Glb
from sldvexp.export.uff import GeometryDataSets, ModeDataSets, ShapeNames, UffExport
from sldvexp.export.vtu import Vtu
from sldvexp.io.uff import writer

NATURAL, DAMPING = np.array([197.0, 439.0, 545.0]), np.array([0.01, 0.02, 0.005])
POLES = 2 * np.pi * NATURAL * (-DAMPING + 1j * np.sqrt(1 - DAMPING**2))
OF = {"of": VelocitiesOf.modes}


@pytest.fixture(scope="session")
def modal(world) -> RunData:
    """A run whose mode shapes are other numbers than its velocities."""
    shapes = world.tree["field"].assign_coords(frequency=NATURAL)
    shapes["velocity"] = (0.5 + 2j) * shapes["velocity"]
    modes = dataset.group(
        "modes", {"mode": [1, 2, 3]}, natural_frequency=NATURAL, damping_ratio=DAMPING
    )
    return replace(world.run, groups={**world.tree, "modes": modes, "modes/field": shapes})


def shape_of(run: RunData) -> np.ndarray:
    return run.groups["modes/field"]["velocity"].values


def sets_of(path, kind: int) -> list[dict]:
    return [s for s in pyuff.UFF(str(path)).read_sets() if s["type"] == kind]


def known(values: np.ndarray) -> np.ndarray:
    return np.isfinite(values).all(axis=1)


def test_complex_modes_come_with_poles_and_are_read_back(modal, tmp_path):
    path = UffExport(**OF).export(modal, tmp_path, "modes")
    shapes = [s for s in sets_of(path, 55) if s["analysis_type"] == writer.COMPLEX_MODE]
    assert [s["mode_n"] for s in shapes] == [1, 2, 3]
    for number, (found, pole) in enumerate(zip(shapes, POLES, strict=True)):
        assert found["eig"] == pytest.approx(pole, rel=5e-6)
        values = shape_of(modal)[..., number]
        np.testing.assert_array_equal(found["node_nums"], np.flatnonzero(known(values)) + 1)
        read = np.stack([found[f"r{k}"] for k in (1, 2, 3)], axis=1)
        size = np.abs(values[known(values)]).max()
        np.testing.assert_allclose(read, values[known(values)], atol=1e-5 * size)


def test_modes_come_with_the_geometry_and_without_spectra(modal, tmp_path):
    for geometry, nodes in ((GeometryDataSets.current, 2411), (GeometryDataSets.legacy, 15)):
        path = UffExport(geometry=geometry, **OF).export(modal, tmp_path, f"modes_{nodes}")
        kinds = pyuff.UFF(str(path)).get_set_types()
        assert nodes in kinds
        assert not {58, 1858} & set(kinds)


def test_bounds_of_modes_are_in_a_file_of_their_own(modal, tmp_path):
    path = UffExport(**OF).export(modal, tmp_path, "modes")
    assert {s["analysis_type"] for s in sets_of(path, 55)} == {writer.COMPLEX_MODE}
    bounds = sets_of(tmp_path / "modes_bounds.uff", 55)
    assert [s["analysis_type"] for s in bounds] == [writer.RESPONSE] * 6
    first = modal.groups["modes/field"]["velocity_std"].values[..., 0]
    read = np.stack([bounds[0][f"r{k}"] for k in (1, 2, 3)], axis=1)
    np.testing.assert_allclose(read, first[known(first)], rtol=5e-6)


@pytest.mark.whole
def test_sdynpy_takes_mode_shapes(modal, tmp_path, monkeypatch):
    monkeypatch.setenv("QT_QPA_PLATFORM", "offscreen")  # or it ends the process
    sdynpy = pytest.importorskip("sdynpy")
    path = UffExport(**OF).export(modal, tmp_path, "modes")
    shapes = sdynpy.shape.from_unv(sdynpy.unv.readunv(str(path)))
    np.testing.assert_allclose(shapes.frequency.ravel(), NATURAL, rtol=1e-5)
    np.testing.assert_allclose(shapes.damping.ravel(), DAMPING, rtol=1e-4)


def test_normal_modes_have_frequency_damping_and_real_shapes(modal, tmp_path):
    path = UffExport(shapes=ShapeNames.normal, **OF).export(modal, tmp_path, "modes")
    shapes = [s for s in sets_of(path, 55) if s["analysis_type"] == writer.NORMAL_MODE]
    for number, found in enumerate(shapes):
        assert found["freq"] == pytest.approx(NATURAL[number], rel=5e-6)
        assert found["modal_damp_vis"] == pytest.approx(DAMPING[number], rel=5e-6)
        values = shape_of(modal)[..., number]
        values = values[known(values)]
        turn = 0.5 * np.angle((values**2).sum())
        read = np.stack([found[f"r{k}"] for k in (1, 2, 3)], axis=1)
        expected = (values * np.exp(-1j * turn)).real
        np.testing.assert_allclose(read, expected, atol=1e-5 * np.abs(expected).max())
        assert np.linalg.norm(read) ** 2 >= 0.5 * np.linalg.norm(values) ** 2
    assert len(shapes) == 3


@pytest.mark.parametrize("shapes", [ShapeNames.response, ShapeNames.normal])
def test_analysis_data_sets_hold_the_same_modes(shapes, modal, tmp_path):
    path = UffExport(modes=ModeDataSets.analysis, shapes=shapes, **OF).export(
        modal, tmp_path, "modes"
    )
    kind = writer.NORMAL_MODE if shapes is ShapeNames.normal else writer.COMPLEX_MODE
    found = sets_of(path, 2414)
    assert [s["analysis_type"] for s in found] == [kind] * 3
    for number, one in enumerate(found):
        assert one["record10_field6"] == number + 1
        assert one["record12_field2"] == pytest.approx(NATURAL[number], rel=5e-6)
        assert one["record12_field5"] == pytest.approx(DAMPING[number], rel=5e-6)
        values = shape_of(modal)[..., number]
        np.testing.assert_array_equal(one["node_nums"], np.flatnonzero(known(values)) + 1)
        if kind == writer.COMPLEX_MODE:
            pole = complex(one["record13_field1"], one["record13_field2"])
            assert pole == pytest.approx(POLES[number], rel=5e-6)
            read = np.array(one["data_at_node"]).view(complex)
            size = np.abs(values[known(values)]).max()
            np.testing.assert_allclose(read, values[known(values)], atol=1e-5 * size)


def test_normal_shapes_of_lines_are_refused(modal, tmp_path):
    with pytest.raises(UserError, match=r"shapes=normal is for mode shapes; add of=modes"):
        UffExport(shapes=ShapeNames.normal).export(modal, tmp_path, "velocity")


def test_tables_hold_mode_shapes_at_their_natural_frequencies(modal, tmp_path):
    table = pd.read_csv(Csv(**OF).export(modal, tmp_path, "modes"))
    assert sorted(set(table["frequency_hz"])) == NATURAL.tolist()
    read = table["real_m_per_s"].to_numpy() + 1j * table["imag_m_per_s"].to_numpy()
    np.testing.assert_allclose(read.reshape(shape_of(modal).shape), shape_of(modal), rtol=1e-12)


def test_paraview_and_glb_show_modes(modal, tmp_path):
    path = Vtu(phases=0, **OF).export(modal, tmp_path, "modes")
    assert [f'timestep="{f!s}"' in path.read_text() for f in NATURAL] == [True] * 3
    moved = Glb(frequency=439.0, **OF).export(modal, tmp_path, "modes").read_bytes()
    text = json.loads(moved[20 : 20 + int.from_bytes(moved[12:16], "little")])
    assert "439" in json.dumps(text)


def test_a_run_without_mode_shapes_is_refused_in_a_sentence(world, tmp_path):
    with pytest.raises(UserError, match="no mode shapes to export; choose modal=own"):
        Csv(**OF).export(world.run, tmp_path, "modes")


def test_files_of_modes_are_called_so():
    assert (Csv(**OF).usual_name, Csv().usual_name, Glb().usual_name) == (
        "modes",
        "velocity",
        "motion",
    )
