"""Strains in the formats of other programs, each file read by a tool that is not ours."""

from __future__ import annotations

from dataclasses import replace

import meshio
import numpy as np
import pandas as pd
import pytest
import pyuff
import scipy.io

from sldvexp.config import registry
from sldvexp.export.strains import principal_vector
from sldvexp.io.uff.nodal import read_nodal
from sldvexp.io.uff.reader import index
from sldvexp.io.uff.source import opened
from tests.shell.made_strain import made_strain

SIX_DIGITS = 5e-6


@pytest.fixture(scope="module", params=["world", "local"])
def strained(request):
    """A run with a strain at the frequencies of its field."""
    found = request.getfixturevalue(request.param)
    strain = made_strain(found.tree["volume"], tuple(found.tree["field"]["frequency"].values))
    return replace(found, tree=found.tree | {"strain": strain})


def exported(strained, name, folder):
    registry.get("export", name)().export(strained.run, folder, "results")
    return strained.tree["strain"]


@pytest.mark.whole
def test_a_table_has_a_row_for_each_quantity_place_component_and_frequency(strained, tmp_path):
    strain = exported(strained, "csv", tmp_path)
    table = pd.read_csv(tmp_path / "results_strain.csv", keep_default_na=False, na_values=[""])
    parts = dict(list(table.groupby("quantity")))
    assert set(parts) == {"strain", "principal_strain", "principal_direction", "von_mises"}
    one = parts["strain"]
    values = (one["real"] + 1j * one["imag"]).to_numpy().reshape(strain["strain"].shape)
    np.testing.assert_array_equal(values, strain["strain"].values)
    assert one["component"].tolist()[: 3 * 3 : 3] == ["ss", "tt", "st"]
    np.testing.assert_array_equal(one["std"], strain["strain_std"].values.ravel())
    np.testing.assert_array_equal(
        one[["x_m", "y_m", "z_m"]].to_numpy()[::9], strain["position"].values
    )
    assert one["place"].to_numpy()[::9].tolist() == list(range(1, strain.sizes["place"] + 1))
    stress = parts["von_mises"]
    np.testing.assert_array_equal(stress["real"], strain["von_mises"].values.ravel())
    assert (set(stress["unit"]), stress["imag"].isna().all()) == ({"Pa"}, True)


def test_the_surface_has_everything_for_paraview(strained, tmp_path):
    strain = exported(strained, "vtu", tmp_path)
    listed = (tmp_path / "results_strain.pvd").read_text()
    for i, hertz in enumerate(strain["frequency"].values):
        file = f"results/strain_{i + 1:05d}.vtu"
        assert f'timestep="{hertz}" part="0" file="{file}"' in listed
        mesh = meshio.read(tmp_path / file)
        np.testing.assert_allclose(mesh.points, strain["position"].values)
        np.testing.assert_array_equal(mesh.cells_dict["triangle"], strain["triangle"].values)
        one, data = strain.isel(frequency=i), mesh.point_data
        for name in ("strain", "bending_strain", "stress"):
            both = data[f"{name}_real"] + 1j * data[f"{name}_imag"]
            np.testing.assert_array_equal(both, one[name].values)
        for name in ("strain_std", "stress_std", "von_mises", "von_mises_std", "principal_strain"):
            np.testing.assert_array_equal(data[name], one[name].values)
        size = np.linalg.norm(data["principal_vector"], axis=1)
        np.testing.assert_allclose(size, one["principal_strain"].values[:, 0])
        away = data["displacement_real"] + 1j * data["displacement_imag"]
        assert away.shape == (strain.sizes["place"], 3)
    assert 'ComponentName0="ss"' in (tmp_path / file).read_text()


def test_a_vector_along_the_extension_lies_in_the_surface(strained):
    one = strained.tree["strain"].isel(frequency=0)
    normals = one["frame"].values[:, 2]
    assert np.abs(np.einsum("pi,pi->p", principal_vector(one), normals)).max() < 1e-18


def test_a_universal_file_of_its_own_has_tensors_of_strain(strained, tmp_path):
    """The velocities' file stays as programs know it; those that read no tensors read that."""
    strain = exported(strained, "uff", tmp_path)
    velocities = pyuff.UFF(str(tmp_path / "results.uff")).read_sets()
    assert {s["spec_data_type"] for s in velocities if s["type"] == 55} == {11}
    path = tmp_path / "results_strain.uff"
    file = pyuff.UFF(str(path))
    kinds = file.get_set_types().astype(int).tolist()
    shapes = [i for i, kind in enumerate(kinds) if kind == 55]
    assert len(shapes) == 3 * strain.sizes["frequency"]
    [nodes] = [file.read_sets(i) for i, kind in enumerate(kinds) if kind == 2411]
    place = np.stack([nodes[a] for a in "xyz"], axis=1)
    np.testing.assert_allclose(place, strain["position"].values, atol=1e-15)
    assert nodes["disp_cs"].tolist() == list(range(2, len(place) + 2))
    for number, at in enumerate(shapes):
        if number % 3 == 0:
            continue  # complex tensors, which pyuff does not read
        one = file.read_sets(at)
        assert (one["data_ch"], one["spec_data_type"], one["n_data_per_node"]) == (4, 3, 6)
        assert (one["analysis_type"], one["data_type"]) == (5, 2)
        known = strain[("strain", "strain_std", "confidence")[number % 3]].values
        ss, tt, st = known[..., number // 3].T
        for key, expected in (("r1", ss), ("r2", st), ("r3", tt), ("r4", 0), ("r6", 0)):
            np.testing.assert_allclose(one[key], expected + 0 * ss, rtol=SIX_DIGITS)


def test_complex_tensors_have_six_numbers_a_line(strained, tmp_path):
    strain = exported(strained, "uff", tmp_path)
    with opened(tmp_path / "results_strain.uff") as source:
        sets = [read_nodal(source, one) for one in index(source) if one.kind == 55]
    assert {one.quantity for one in sets} == {3}
    for i, hertz in enumerate(strain["frequency"].values):
        one = sets[3 * i]
        assert one.frequency == pytest.approx(hertz, rel=SIX_DIGITS)
        ss, tt, st = strain["strain"].values[..., i].T
        none = np.zeros_like(ss)
        expected = np.stack([ss, st, tt, none, none, none], axis=1)
        np.testing.assert_allclose(one.values, expected, rtol=2 * SIX_DIGITS, atol=1e-16)


def test_a_struct_has_the_whole_group(strained, tmp_path):
    strain = exported(strained, "mat", tmp_path)
    found = scipy.io.loadmat(tmp_path / "results.mat", simplify_cells=True)["sldvexp"]["strain"]
    for name in ("strain", "bending_strain", "von_mises", "position"):
        np.testing.assert_array_equal(found[name], strain[name].values)
    assert found["component"].tolist() == ["ss", "tt", "st"]
    assert found["triangle"].min() == 1
