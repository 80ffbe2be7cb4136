"""Meshes as programs write them: geometry only, corners that are nearly equal, another unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.io import read_mesh
from sldvexp.units import LengthUnit
from sldvexp.volume import MeshFile

CASES = Path(__file__).parents[1] / "importers" / "cases" / "mesh"
#: Of a plate of 0.2 m by 0.1 m in 4 by 3 cells.
NODES = np.array([[x, y, 0.0] for y in np.linspace(0, 0.1, 4) for x in np.linspace(0, 0.2, 5)])


def right(surface, atol=1e-9):
    order = np.lexsort(np.round(surface.position, 4).T)
    np.testing.assert_allclose(
        surface.position[order], NODES[np.lexsort(np.round(NODES, 4).T)], atol=atol
    )
    assert surface.triangles.shape == (24, 3)
    corner = surface.position[surface.triangles]
    area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])[:, 2] / 2
    np.testing.assert_allclose(area, 0.02 / 24, rtol=1e-4)


@pytest.mark.parametrize("name", ["tex.obj", "neg.obj"])
def test_textures_and_relative_indices_are_geometry(name):
    volume = MeshFile(path=str(CASES / name))
    right(volume.surface())
    assert volume.prisms().surface_nodes == 20


def test_corners_that_are_nearly_equal_are_one_node():
    volume = MeshFile(path=str(CASES / "jitter.stl"))
    right(volume.surface(), atol=1.1e-7)
    told = volume.group().attrs["merged"]
    assert told == "58 corners within 2.2e-06 m of one another are 20 nodes"
    assert volume.prisms().surface_nodes == 20


def test_a_mesh_in_millimetres():
    volume = MeshFile(path=str(CASES / "mm.stl"), unit=LengthUnit.mm, thickness=10)
    right(volume.surface(), atol=1e-6)
    assert "merged" not in volume.group().attrs


def test_merging_leaves_small_triangles(tmp_path):
    """Corners are together only within a tenth of the shortest side."""
    path = tmp_path / "fine.stl"
    corners = [[0, 0, 0], [1e-4, 0, 0], [0, 1e-4, 0]], [[0, 0, 0], [-5, 0, 0], [0, -5, 0]]
    lines = ["solid"]
    for triangle in corners:
        lines += ["facet normal 0 0 1", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in triangle]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid"]))
    assert len(read_mesh(path, 1.0, False).position) == 5


WRONG = {
    "a face of five corners": ("v 0 0 0\n" * 5 + "f 1 2 3 4 5\n", "line 6: the face has 5 corners"),
    "no vertex": ("v 0 0 0\nf 1 2 3\n", "line 2: there is no vertex 2, but 1 so far"),
    "vertex 0": ("v 0 0 0\nf 0 1 1\n", "line 2: there is no vertex 0"),
    "far back": ("v 0 0 0\nf -2 -1 -1\n", "line 2: there is no vertex -2"),
    "a word": ("v 0 0 0\nf a b c\n", "line 2: 'a' names no vertex"),
    "behind a line that goes on": (
        "v 0 \\\n0 \\\r\n0\nf a b c\n",
        "line 4: 'a' names no vertex",
    ),
    "where a line begins that goes on": ("v 0 0 0\nf 1 \\\n1 a\n", "line 2: 'a' names no vertex"),
    "two coordinates": ("v 0 0\n", "line 1: a vertex needs x, y and z"),
    "no number": ("v 0 0 x\n", "line 1: a coordinate must be a number, not 'x'"),
    "nothing": ("", "has no cells, but neither triangles nor quadrilaterals"),
    "lines only": ("v 0 0 0\nv 1 0 0\nl 1 2\n", "has other, but neither triangles nor"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_obj_files_are_named(tmp_path, name):
    text, said = WRONG[name]
    path = tmp_path / "wrong.obj"
    path.write_text(text)
    with pytest.raises(UserError) as error:
        read_mesh(path, 1.0, False)
    assert said in str(error.value), str(error.value)
    assert str(path) in str(error.value)
