"""The elements of universal files as the surface of a volume."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.errors import UserError
from sldvexp.units import LengthUnit
from sldvexp.volume import MeshFile

PLATE = {5: [0, 0, 0], 7: [40, 0, 0], 9: [40, 30, 0], 11: [0, 30, 0], 13: [80, 0, 0]}


def mesh(path, **settings):
    return MeshFile(path=str(path), unit=LengthUnit.mm, thickness=1.0, layers=2, **settings)


@pytest.mark.parametrize("suffix", ["uff", "UNV"])
def test_triangles_and_quadrilaterals(uff, tmp_path, suffix):
    path = tmp_path / f"plate.{suffix}"
    elements = uff.elements([[5, 7, 9, 11]]) + uff.elements([[7, 13, 9]], kind=91)
    path.write_bytes(uff.units(1e-3) + uff.nodes(PLATE) + elements)
    surface = mesh(path).surface()
    np.testing.assert_allclose(surface.position, 1e-3 * np.array(list(PLATE.values())))
    a, b, c = np.moveaxis(surface.position[surface.triangles], 1, 0)
    np.testing.assert_allclose(np.cross(b - a, c - a)[:, 2].sum() / 2, 0.04 * 0.03 * 1.5)
    assert surface.named(2) == "the node 9"
    turned = mesh(path, flip=True).surface()
    np.testing.assert_array_equal(turned.triangles, surface.triangles[:, ::-1])


def test_what_is_refused(uff, tmp_path):
    path = tmp_path / "plate.uff"
    elements = uff.elements([[5, 7, 9, 11]])
    for content, said in (
        (uff.units(1.0) + uff.nodes(PLATE) + elements, "volume.unit in units of 0.001 m"),
        (uff.nodes(PLATE), "has neither triangles nor quadrilaterals (data set 2412)"),
        (uff.units(1e-3), "has no geometry"),
        (uff.nodes(PLATE) + uff.elements([[5, 7, 9, 12]]), "data set 2 (2412), line 17"),
    ):
        path.write_bytes(content)
        with pytest.raises(UserError) as error:
            mesh(path).surface()
        assert said in str(error.value), str(error.value)


def test_files_without_a_surface_say_what_they_have_and_a_way_on(uff, tmp_path):
    path = tmp_path / "plate.uff"
    nodes, solid = uff.nodes(PLATE), uff.elements([[5, 7, 9, 11]], kind=111)
    way = "write the surface's nodes as a table x_m,y_m,z_m for volume=points"
    for content, said in (
        (nodes + solid, ("but 5 nodes, 1 solid elements; ", way)),
        (nodes + uff.trace([5, 7, 0, 9, 11]), ("but 5 nodes and 2 lines; ", way)),
        (uff.units(1e-3) * 2, ("has no geometry", "but 2 data sets 164 (units)")),
    ):
        path.write_bytes(content)
        with pytest.raises(UserError) as error:
            mesh(path).surface()
        for part in said:
            assert part in str(error.value), str(error.value)


def test_an_element_that_is_given_twice_is_read_once(uff, tmp_path):
    path = tmp_path / "plate.uff"
    elements = uff.elements([[5, 7, 9, 11]])
    path.write_bytes(uff.nodes(PLATE) + elements)
    once = mesh(path).surface()
    path.write_bytes(uff.nodes(PLATE) + 2 * elements)
    np.testing.assert_array_equal(mesh(path).surface().triangles, once.triangles)
