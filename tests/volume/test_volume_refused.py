"""Mistakes in volumes, each told in one sentence."""

from __future__ import annotations

import meshio
import numpy as np
import pytest

from sldvexp.errors import ConfigError, UserError
from sldvexp.volume import (
    Grid,
    MeshFile,
    PointSurface,
    SampleRule,
    SampleSettings,
    TriangulatedSurface,
    extruded,
    vertex_normals,
)
from sldvexp.volume.surface import check_prisms, check_surface

NAN = float("nan")
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"layers": 1}, "layers: must be 2 or more, with prisms between them, not 1"),
        ({"thickness": 0.0}, "thickness: must be a positive number, not 0.0"),
        ({"offset": NAN}, "offset: must be finite, not nan"),
        ({"depth": [0.1]}, "depth: must be 2 depths or more, with prisms between them, not 1"),
        (
            {"depth": [0.0, 0.1, 0.1]},
            "depth[2]: must be above 0.1, or the prisms in between have no volume, not 0.1",
        ),
        (
            {"depth": [0.0, -0.1]},
            "depth[1]: must be above 0, or the prisms in between have no volume, not -0.1",
        ),
        ({"depth": [0.0, NAN]}, "depth: must be finite, not nan"),
        ({"center": [0.0, 1.0]}, "center: must be 3 numbers, not 2"),
        ({"euler": [0.0, 1.0, NAN]}, "euler: must be finite, not nan"),
        ({"tangent": [0.0, 0.0, 0.0]}, "tangent: must be a direction, not zero"),
        ({"size": [0.1, -0.2]}, "size[1]: must be a positive number, not -0.2"),
        ({"size": [0.1]}, "size: must be 2 numbers, not 1"),
        ({"shape": [1, 7]}, "shape[0]: must be 2 nodes or more, not 1"),
        ({"shape": [9, 7, 2]}, "shape: must be 2 numbers, not 3"),
        (
            {"size": [1.0, 1.0], "radius": 0.1},
            "radius: must be finite and beyond +-0.159155 m, where the panel closes to a tube, "
            "not 0.1; null is flat",
        ),
        (
            {"samples": SampleSettings(4, 2)},
            "samples.triangle: must be one of 1, 3, 6, 7, 12 points, not 4",
        ),
        ({"samples": SampleSettings(3, 0)}, "samples.line: must be 1 point or more, not 0"),
        (
            {"samples": SampleSettings(parameters=[[1, 0, 0]])},
            "samples.parameters[0]: must be the four numbers [xi1, xi2, xi3, zeta], not [1, 0, 0]",
        ),
        (
            {"samples": SampleSettings(parameters=[[1, 0, "a", 0]])},
            "samples.parameters[0]: must be the four numbers [xi1, xi2, xi3, zeta], "
            "not [1, 0, 'a', 0]",
        ),
        (
            {"samples": SampleSettings(parameters=[7])},
            "samples.parameters[0]: must be the four numbers [xi1, xi2, xi3, zeta], not 7",
        ),
        (
            {"samples": SampleSettings(parameters=[[0.333, 0.333, 0.333, 0]])},
            "samples.parameters[0]: has xi1 + xi2 + xi3 = 0.999, which must be 1; a third may be "
            "written as 0.3333, 0.3333, 0.3334",
        ),
        (
            {"samples": SampleSettings(parameters=[[1, 0, 0, 0], [1.5, -0.5, 0, 0]])},
            "samples.parameters[1]: lies outside of the prism: xi must be from 0 to 1 and zeta "
            "from -1 to 1",
        ),
        (
            {"samples": SampleSettings(parameters=[[1, 0, 0, 1.1]])},
            "samples.parameters[0]: lies outside of the prism: xi must be from 0 to 1 and zeta "
            "from -1 to 1",
        ),
        (
            {"samples": SampleSettings(parameters=[[1, 0, 0, 1], [0, 1, 0, 1], [1, 0, 0, 1]])},
            "samples.parameters[2]: is the point 0 again",
        ),
    ],
)
def test_refused_settings(fields, message):
    with pytest.raises(ConfigError) as error:
        Grid(**fields)
    assert str(error.value) == message


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"towards": [0.0, 0.0, 0.0]}, "towards: must be a direction, not zero"),
        ({"slivers": 0.6}, "slivers: must be from 0 to 0.5, not 0.6"),
        ({"slivers": NAN}, "slivers: must be from 0 to 0.5, not nan"),
    ],
)
def test_refused_settings_of_points(fields, message):
    with pytest.raises(ConfigError) as error:
        PointSurface(path="points.csv", **fields)
    assert str(error.value) == message


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("x_m,y_inch,z_m", ": the columns x, y, z mix the units m and inch"),
        (
            "x_m,y_m\n0,0",
            ": the column z_m is missing; needed are x_U, y_U, z_U with U one of m, cm, mm, inch, "
            "ft",
        ),
        ("x_m,y_m,z_m\n0,0", ", line 2: has 2 values under 3 columns"),
        ("x_m,y_m,z_m\n0,0,up", ", line 2: z_m must be a number, not 'up'"),
        ("x_m,y_m,z_m\n0,0,0\n1,0,0", ": a surface needs three points or more, not 2"),
        (
            "x_m,y_m,z_m\n0,0,0\n1,2,3\n2,4,6\n3,6,9",
            ": all 4 points lie on one line; a surface needs some beside it",
        ),
        (
            "x_m,y_m,z_m\n0,0,0\n1,0,0\n0,1,0\n# again\n1,0,0",
            ": the points of lines 3 and 6 stand in one place, (1, 0, 0) m; every node must stand "
            "there once",
        ),
        (
            "x_m,y_m,z_m\n0,0,0\n0,1,0\n0,0,1\n0,1,1",
            ": towards: [0, 0, 1] lies in the plane of the points and chooses no side of it; "
            "[1, 0, 0] would",
        ),
    ],
)
def test_refused_points(tmp_path, lines, message):
    path = tmp_path / "points.csv"
    path.write_text(lines)
    with pytest.raises(UserError) as error:
        PointSurface(path=str(path)).prisms()
    assert str(error.value) == f"{path}{message}"


def test_points_above_one_another_cannot_be_connected(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text(
        "x_m,y_m,z_m\n0,0,0\n1,0,0\n0,1,0\n1,1,0\n1,1,0.01\n0,0,0.01\n1,0,0.01\n0,1,0.01"
    )
    with pytest.raises(UserError, match=r"belongs to no triangle \(4 nodes in all\); leave"):
        PointSurface(path=str(path)).prisms()


@pytest.mark.parametrize(
    ("position", "triangles", "message"),
    [
        (SQUARE, [], "the surface has no triangles"),
        (SQUARE, [[0, 1, 2], [0, 2, 4]], "the triangle 1 names node 4, but there are 4 nodes, "
         "counted from 0"),
        (SQUARE * [1, 1, NAN], [[0, 1, 2], [0, 2, 3]],
         "the node 0 has a coordinate that is not a number"),
        (np.vstack([SQUARE, [[1, 1, 1e-9]]]), [[0, 1, 2], [0, 4, 3]],
         "the nodes 2 and 4 stand in one place, (1, 1, 0) m; every node must stand there once"),
        (SQUARE, [[0, 1, 2]], "the node 3 at (0, 1, 0) m belongs to no triangle; leave it out or "
         "connect it"),
        (np.vstack([SQUARE, [[3, 3, 3], [4, 4, 4]]]), [[0, 1, 2], [0, 2, 3]],
         "the node 4 at (3, 3, 3) m belongs to no triangle (2 nodes in all); leave it out or "
         "connect it"),
        (np.vstack([SQUARE, [[0.5, 0, 0]]]), [[0, 4, 1], [0, 1, 2], [0, 2, 3]],
         "the triangle of the nodes 0, 4 and 1 at (0, 0, 0) m has no area, so that its prisms "
         "have no volume"),
        (np.vstack([SQUARE, [[0, 0, 1]]]), [[0, 1, 2], [0, 2, 3], [2, 0, 4]],
         "3 triangles meet at the edge between the nodes 0 and 2 at (0, 0, 0) m; a surface has "
         "two at most"),
        (SQUARE, [[0, 1, 2], [0, 3, 2]],
         "the two triangles at the edge between the nodes 2 and 0 at (1, 1, 0) m face opposite "
         "ways, so that the prisms of one are inverted; order the corners of all triangles alike"),
        (np.vstack([SQUARE, SQUARE + np.array([3, 0, 0])]),
         [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]],
         "the surface has 2 parts that do not touch: the node 0 at (0, 0, 0) m is of one, the "
         "node 4 at (3, 0, 0) m of another; make a volume of each"),
    ],
)  # fmt: skip
def test_refused_surfaces(position, triangles, message):
    triangles = np.array(triangles, np.int64).reshape(-1, 3)
    with pytest.raises(UserError) as error:
        check_surface(TriangulatedSurface(position, triangles))
    assert str(error.value) == message


def test_file_and_its_own_numbers_are_named(tmp_path):
    place = np.vstack([[[5, 5, 5.0]], SQUARE, SQUARE[:1]])
    cells = [("vertex", [[0]]), ("triangle", [[1, 2, 3], [5, 3, 4]])]
    meshio.write(path := tmp_path / "twice.vtk", meshio.Mesh(place, cells))
    with pytest.raises(UserError, match=r"twice\.vtk: the nodes 1 and 5 stand in one place"):
        MeshFile(path=str(path)).prisms()


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.xyz", "0 0 0", "is not a mesh that can be read: Could not deduce file format"),
        ("a.stl", "solid\nfacet no", "is not a mesh that can be read: "),
        ("a.vtu", "<VTKFile", "is not a mesh that can be read: "),
        ("a.msh", "", "is not a mesh that can be read: "),
        ("a.vtk", "# vtk DataFile Version 3.0\nx\nASCII\nDATASET NONE\n", "is not a mesh that"),
    ],
)
def test_refused_mesh_files(tmp_path, capsys, name, content, message):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(UserError) as error:
        MeshFile(path=str(path)).prisms()
    told = str(error.value)
    assert told.startswith(f"{path}: {message}")
    assert "\n" not in told
    assert len(told) > len(f"{path}: {message}")
    assert capsys.readouterr() == ("", "")


def test_mesh_without_a_surface(tmp_path):
    corners = np.vstack([np.zeros(3), np.eye(3)])
    meshio.write(path := tmp_path / "solid.vtk", meshio.Mesh(corners, [("tetra", [[0, 1, 2, 3]])]))
    with pytest.raises(UserError, match=r"has tetra, but neither triangles nor quadrilaterals$"):
        MeshFile(path=str(path)).prisms()
    with pytest.raises(UserError, match=r"nowhere\.stl: there is no such file"):
        MeshFile(path=str(tmp_path / "nowhere.stl")).prisms()


@pytest.mark.parametrize("radius", [0.1, -0.1])
@pytest.mark.parametrize("beyond", [0.9999, 1.0, 1.0001, 1.5])
def test_layers_beyond_the_axis_of_a_panel_are_refused(radius, beyond):
    depth = sorted([-radius * beyond, 0.0])
    panel = Grid(size=[0.2, 0.1], radius=radius, depth=depth)
    if beyond < 1:
        assert panel.prisms().layers == 2
        return
    with pytest.raises(UserError) as error:
        panel.prisms()
    told = str(error.value)
    assert f"have no volume at a depth of {-radius:.4g} m and are inverted beyond" in told
    assert "because the normals meet there (96 triangles in all)" in told
    assert f"from {depth[0]:.4g} to {depth[1]:.4g} m" in told


def test_layers_that_skip_a_fold_are_refused():
    """Inside a ball the normals meet twice: beyond its center the prisms look upright again."""
    position = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    surface = TriangulatedSurface(position, np.array([[0, 1, 2]]))
    depth = np.array([-2.0, 0.0])
    prisms = extruded(position, surface.triangles, np.tile(position[:, None], (1, 3, 1)), depth)
    low = prisms.position[:3]
    assert np.linalg.det(low) < 0 < np.linalg.det(position)  # through the center
    area = np.cross(low[1] - low[0], low[2] - low[0])
    assert (position @ area > 0).all()  # and yet it faces the same way
    with pytest.raises(UserError, match=r"have no volume at a depth of -1 m and are inverted"):
        check_prisms(surface, position, depth)
    # Layers that all lie beyond the fold are refused as well.
    with pytest.raises(UserError, match=r"have no volume at a depth of -1 m and are inverted"):
        check_prisms(surface, position, np.array([-2.0, -1.5]))
    check_prisms(surface, position, np.array([-0.99, 5.0]))


def test_the_first_fold_is_the_one_that_is_told():
    sphere = np.eye(3)
    position = np.vstack([2 * sphere, 1 * sphere, 3 * sphere])
    surface = TriangulatedSurface(position, np.arange(9).reshape(3, 3))
    with pytest.raises(UserError) as error:
        check_prisms(surface, np.vstack([sphere] * 3), np.array([-2.5, 1.0]))
    assert "the triangle of the nodes 3, 4 and 5 at (1, 0, 0) m" in str(error.value)
    assert "at a depth of -1 m" in str(error.value)
    assert "(2 triangles in all)" in str(error.value)


def bumpy(seed: int):
    """A random surface over a grid."""
    rng = np.random.default_rng(seed)
    flat = Grid(size=[1.0, 1.0], shape=[6, 6]).surface()
    height = rng.uniform(0.01, 0.3)
    position = flat.position + height * rng.uniform(-1, 1, flat.position.shape) * [0.2, 0.2, 1]
    return TriangulatedSurface(position, flat.triangles), np.sort(rng.uniform(-0.3, 0.3, 2))


def test_prisms_are_refused_just_when_they_are_inverted_somewhere():
    grid = np.array([(i, j, 4 - i - j) for i in range(5) for j in range(5 - i)]) / 4
    outcomes = []
    for seed in range(120):
        surface, depth = bumpy(seed)
        normal = vertex_normals(surface)
        try:
            check_prisms(surface, normal, depth)
            outcomes.append(True)
        except UserError:
            outcomes.append(False)
        # The Jacobian itself, of the map from (xi, depth) to space, on a fine net.
        low, high = min(depth[0], 0), max(depth[1], 0)
        place, turn = surface.position[surface.triangles], normal[surface.triangles]
        least = np.inf
        for d in np.linspace(low, high, 41):
            corner = place + d * turn
            area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
            least = min(least, np.einsum("ti,pc,tci->tp", area, grid, turn).min())
        if abs(least) > 1e-4:  # nearer to zero the net may miss the least
            assert outcomes[-1] == (least > 0)
    assert 20 < sum(outcomes) < 100


def test_surface_folded_sharply_is_refused():
    # A ridge whose sides stand at 20 degrees to one another.
    wall = np.tan(np.radians(80))
    position = np.array(
        [[0, 0, 0], [0, 1, 0], [-1, 0, -wall], [1, 0, -wall], [0.3, 0.5, -3 * wall]]
    )
    surface = TriangulatedSurface(position, np.array([[0, 1, 2], [1, 0, 3], [0, 4, 3]]))
    with pytest.raises(UserError, match=r"are inverted: the normal of the node \d at .* points to"):
        check_prisms(surface, vertex_normals(surface), np.array([-0.01, 0.01]))
    closed = TriangulatedSurface(SQUARE[:3], np.array([[0, 1, 2], [0, 2, 1]]))
    with pytest.raises(UserError, match=r"the node 0 at .* has no normal, because the triangles"):
        vertex_normals(closed)


def test_tangent_along_a_normal_is_refused():
    with pytest.raises(UserError) as error:
        Grid(tangent=[0.0, 0.0, 2.0]).prisms()
    assert str(error.value) == (
        "tangent: [0, 0, 2] is parallel to the normal of the node 0 at (-0.15, -0.125, 0) m; "
        "choose a direction that lies along the surface, as [1, 0, 0] does there"
    )
    # Half of a tube, with nodes beside the place where the tangent turns round, and none on it.
    tube = {"size": [0.3, 0.1], "shape": [24, 3], "radius": 0.06, "thickness": 0.01}
    with pytest.raises(UserError, match="has projections that turn by 90 degrees or more between"):
        Grid(**tube).prisms()
    Grid(**tube, tangent=[0, 1, 0]).prisms()


def test_factors_of_a_list_of_parameters_are_not_invented():
    with pytest.raises(AssertionError):
        SampleRule(np.array([[1.0, 0, 0, 0]])).triangle_shape()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ["volume.radius=0.3", "volume.depth=[-0.4, 0.0]"],
            "volume: the prisms on the triangle of the nodes 7, 14 and 8 at (-0.102869, -0.115, ",
        ),
        (["volume.thickness=0"], "volume.thickness must be a positive number, not 0"),
    ],
)
def test_the_user_of_the_command_sees_the_sentence(sldvexp, change, message):
    done = sldvexp("~experiment", "volume=grid", *change)
    assert done.status == 1
    assert message in done.err
    assert "Traceback" not in done.err


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ("0,0,0 1,0,0 0,1,0 1,0,0", "stand in one place, (1, 0, 0) m; every node must stand there"),
        ("0,0,0 1,0,0 2,0,0 3,0,0", "all 4 points lie on one line; a surface needs some beside it"),
    ],
)
def test_digitised_points_are_refused_by_the_command(sldvexp, tmp_path, rows, message):
    path = tmp_path / "points.csv"
    path.write_text("\n".join(["x_m,y_m,z_m", *rows.split()]))
    done = sldvexp("~experiment", "volume=points", f"volume.path={path}")
    assert done.status == 1
    assert f"volume: {path}: " in done.err.replace("\n", " ").replace("  ", " ")
    assert message in done.err.replace("\n", " ")
