"""Volumes from grids, digitised points and mesh files."""

from __future__ import annotations

import sys
import time
import tracemalloc

import meshio
import numpy as np
import pytest
from omegaconf import OmegaConf

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.units import LengthUnit
from sldvexp.volume import (
    Diagonals,
    Grid,
    MeshFile,
    PointSurface,
    SampleSettings,
    sample_positions,
    shape_matrix,
)
from tests.composing import part

PLATE = "conf://data/plate_volume.csv"


def configured(name: str, *overrides: str):
    return OmegaConf.to_object(part(f"+volume={name}", *overrides))["volume"]


def accept(volume, tmp_path) -> None:
    """What every volume must give to those who use it."""
    prisms, rule = volume.prisms(), volume.rule()
    nodes, triangles = prisms.surface_nodes, len(prisms.triangles)
    assert prisms.position.shape == (prisms.layers * nodes, 3)
    assert prisms.frame.shape == (nodes, 3, 3)
    assert set(prisms.triangles.ravel()) == set(range(nodes))
    assert prisms.triangles.dtype == np.int64
    np.testing.assert_allclose(prisms.depth, volume.depths())
    given = prisms.position.reshape(-1, nodes, 3) - (
        prisms.depth[:, None, None] * prisms.frame[:, 2]
    )
    np.testing.assert_allclose(given, np.broadcast_to(given[0], given.shape), atol=1e-14)
    samples = prisms.gaps * triangles * rule.points
    assert shape_matrix(prisms, rule).shape == (samples, prisms.nodes)

    path = tmp_path / "run.nc"
    dataset.save({"volume": volume.group()}, {}, path)
    with dataset.load(path) as tree:
        group = tree["volume"].to_dataset().load()
    np.testing.assert_array_equal(group["position"], prisms.position)
    np.testing.assert_array_equal(group["element"], prisms.element)
    np.testing.assert_array_equal(group["frame"], prisms.frame)
    np.testing.assert_array_equal(group["depth"], prisms.depth)
    np.testing.assert_array_equal(group["node_layer"], prisms.layer)
    np.testing.assert_array_equal(group["sample_parameter"], rule.parameter)
    assert group.attrs["samples"] == samples
    accept_ugrid(group)


def accept_ugrid(group) -> None:
    """The conventions' demands on a mesh of volumes."""
    (mesh,) = (v for v in group.variables.values() if v.attrs.get("cf_role") == "mesh_topology")
    assert mesh.attrs["topology_dimension"] == 3
    connectivity = group[mesh.attrs["volume_node_connectivity"]]
    assert connectivity.attrs["cf_role"] == "volume_node_connectivity"
    assert connectivity.attrs["start_index"] == 0
    assert connectivity.dims[0] == mesh.attrs["volume_dimension"]
    coordinates = [group[name] for name in mesh.attrs["node_coordinates"].split()]
    np.testing.assert_array_equal(np.stack(coordinates, axis=1), group["position"])
    assert all(c.attrs["units"] == "m" for c in coordinates)
    shape = group[mesh.attrs["volume_shape_type"]]
    meanings = dict(
        zip(shape.attrs["flag_values"], shape.attrs["flag_meanings"].split(), strict=True)
    )
    assert {meanings[s] for s in shape.values} == {"wedge"}


def test_grid(tmp_path):
    accept(configured("grid"), tmp_path)
    accept(configured("grid", "volume.radius=-0.5", "volume.depth=[-0.01,0,0.02]"), tmp_path)


def test_plate_of_the_dissertation(tmp_path):
    volume = configured("dissertation")
    accept(volume, tmp_path)
    prisms = volume.prisms()
    assert (prisms.layers, prisms.surface_nodes, prisms.nodes) == (7, 63, 441)
    assert len(prisms.triangles) == 95
    assert len(prisms.element) * volume.rule().points == 3990
    # Table 5.7: unknowns of the partial and full model, rows of five views and four differences.
    assert (3 * prisms.nodes, 4 * prisms.nodes) == (1323, 1764)
    assert (5 * 3990, 4 * 3990) == (19950, 15960)
    # The plate, whose surface is digitised at z = 1.5 mm, lies between layers 3 and 4.
    z = prisms.position[:, 2].reshape(7, 63)
    assert (z[2] < 0.0015 - 0.0015).all()
    assert (z[3] > 0.0015 + 0.0015).all()


def test_samples_of_the_dissertation_determine_every_node():
    volume = configured("dissertation")
    matrix = shape_matrix(volume.prisms(), volume.rule())
    eigenvalues = np.linalg.eigvalsh((matrix.T @ matrix).toarray())
    # Table 5.7 prints 245; the samples' parameters that gave it are not printed.
    assert 100 < eigenvalues[-1] / eigenvalues[0] < 245


@pytest.mark.parametrize("slivers", [0.05, 0.1, 0.3])
def test_rim_digitised_by_hand_has_no_slivers(slivers):
    surface = PointSurface(path=PLATE, slivers=slivers).surface()
    assert len(surface.triangles) == 95
    assert len(PointSurface(path=PLATE, slivers=0.0).surface().triangles) > 95  # the hull has dents
    corner = surface.position[surface.triangles]
    side = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=-1).max(axis=1)
    area = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert (np.linalg.norm(area, axis=1) / side**2 > 0.2).all()


def written(path, position, unit="m"):
    """A file of points."""
    rows = [f"{n}," + ",".join(repr(float(v)) for v in p) for n, p in enumerate(position)]
    path.write_text(f"name,x_{unit},y_{unit},z_{unit}\n" + "\n".join(rows) + "\n")
    return str(path)


@pytest.mark.parametrize("towards", [[0.0, 0.0, 1.0], [0.3, 0.2, -5.0]])
def test_points_on_a_grid_are_connected_like_one(tmp_path, towards):
    grid = Grid(center=[0.1, 0.2, 0.3], euler=[0.2, 0.3, 0.4], shape=[7, 5], layers=2).prisms()
    order = np.random.default_rng(1).permutation(35)
    position = grid.position.reshape(2, 35, 3).mean(axis=0)[order]
    path = written(tmp_path / "points.csv", position / 0.0254, "inch")
    volume = PointSurface(path=path, towards=towards, layers=2)
    accept(volume, tmp_path)
    prisms = volume.prisms()
    assert len(prisms.triangles) == 2 * 6 * 4  # each cell in two, none along the straight rim
    normal = grid.frame[0, 2] * np.sign(towards[2])
    np.testing.assert_allclose(prisms.frame[:, 2], np.tile(normal, (35, 1)), atol=1e-10)
    np.testing.assert_allclose(prisms.position.reshape(2, 35, 3).mean(axis=0), position, atol=1e-12)


def test_every_point_of_any_cloud_is_connected(tmp_path):
    for seed in range(60):
        rng = np.random.default_rng(seed)
        cloud = rng.uniform(size=(rng.integers(4, 40), 3)) * [1, 1, 0]
        path = written(tmp_path / "cloud.csv", cloud)
        PointSurface(path=path, slivers=0.2).prisms()  # complains of nodes without triangles


def ball(subdivisions: int):
    """Points and triangles of an icosahedron, its sides divided, on the unit sphere."""
    golden = (1 + np.sqrt(5)) / 2
    position = [[0, a, b * golden] for a in (-1, 1) for b in (-1, 1)]
    position = [p[turn:] + p[:turn] for turn in range(3) for p in position]
    position = np.array(position) / np.hypot(1, golden)
    from scipy.spatial import ConvexHull

    for _ in range(subdivisions):
        edges = {tuple(sorted(e)) for t in ConvexHull(position).simplices
                 for e in zip(t, np.roll(t, 1), strict=True)}  # fmt: skip
        middle = np.array([position[a] + position[b] for a, b in sorted(edges)])
        position = np.vstack([position, middle / np.linalg.norm(middle, axis=1, keepdims=True)])
    triangles = ConvexHull(position).simplices
    outwards = np.linalg.det(position[triangles]) > 0
    triangles[~outwards] = triangles[~outwards][:, ::-1]
    return position, triangles


def cap(subdivisions: int = 2):
    """The upper part of the ball, nodes renumbered."""
    position, triangles = ball(subdivisions)
    triangles = triangles[position[triangles, 2].min(axis=1) > 0.3]
    used, renumbered = np.unique(triangles, return_inverse=True)
    return position[used], renumbered.reshape(-1, 3)


@pytest.mark.parametrize("suffix", ["stl", "vtk", "vtu", "msh", "obj", "ply", "inp"])
def test_mesh_files(tmp_path, suffix, capsys):
    position, triangles = cap()
    path = tmp_path / f"cap.{suffix}"
    meshio.write(path, meshio.Mesh(position, [("triangle", triangles)]))
    volume = MeshFile(path=str(path), unit=LengthUnit.cm, thickness=0.2)
    capsys.readouterr()
    accept(volume, tmp_path)
    assert capsys.readouterr() == ("", "")
    prisms = volume.prisms()
    assert (prisms.surface_nodes, len(prisms.triangles)) == (len(position), len(triangles))
    np.testing.assert_allclose(prisms.depth[[0, -1]], [-0.001, 0.001])
    # Inside of the rim the weighted normals are nearly those of the sphere.
    outwards = prisms.position[3 * len(position) : 4 * len(position)] / 0.01
    np.testing.assert_allclose(np.linalg.norm(outwards, axis=1), 1.0, rtol=1e-6)
    inner = outwards[:, 2] > 0.6
    cosine = np.einsum("ni,ni->n", outwards, prisms.frame[:, 2])[inner]
    assert cosine.min() > np.cos(np.radians(2.0))
    flipped = MeshFile(path=str(path), unit=LengthUnit.cm, thickness=0.2, flip=True).prisms()
    np.testing.assert_allclose(flipped.frame[:, 2], -prisms.frame[:, 2], atol=1e-14)


def test_normals_of_a_symmetric_ball_are_radial(tmp_path):
    position, triangles = ball(0)
    meshio.write(path := tmp_path / "ball.vtk", meshio.Mesh(position, [("triangle", triangles)]))
    surface = MeshFile(path=str(path)).surface()
    from sldvexp.volume import vertex_normals

    np.testing.assert_allclose(vertex_normals(surface), position, atol=1e-12)


def test_normals_are_weighted_with_the_area(tmp_path):
    ridge = np.array([[0, 0, 0], [0, 1, 0], [-3.0, 0, 0], [0, 0, -1.0]])
    cells = [("triangle", [[0, 1, 2], [1, 0, 3]])]  # of areas 1.5 along z and 0.5 along x
    meshio.write(path := tmp_path / "ridge.vtk", meshio.Mesh(ridge, cells))
    frame = MeshFile(path=str(path), tangent=[0, 1, 0], thickness=0.01).prisms().frame
    np.testing.assert_allclose(frame[0, 2], np.array([1.0, 0, 3]) / np.sqrt(10), atol=1e-12)
    np.testing.assert_allclose(frame[2, 2], [0, 0, 1], atol=1e-12)


def test_quadrilaterals_are_cut_along_the_shorter_diagonal(tmp_path):
    place = np.array([[0, 0, 0], [1, 0, 0], [1.4, 1, 0], [0, 1, 0], [2.4, 0, 0.0]])
    mesh = meshio.Mesh(place, [("quad", [[0, 1, 2, 3]]), ("triangle", [[1, 4, 2]])])
    meshio.write(path := tmp_path / "mixed.vtk", mesh)
    triangles = {tuple(t) for t in MeshFile(path=str(path)).prisms().triangles.tolist()}
    assert triangles == {(1, 4, 2), (0, 1, 3), (1, 2, 3)}


def test_rectangles_are_all_cut_alike_and_keep_their_side(tmp_path):
    grid = Grid(center=[0, 0, 0], euler=[0.1, 0.2, 0.3], shape=[5, 4], layers=2)
    place = grid.surface().position @ np.linalg.qr(np.random.default_rng(3).random((3, 3)))[0]
    at = np.arange(20).reshape(5, 4)
    quads = np.stack([at[:-1, :-1], at[1:, :-1], at[1:, 1:], at[:-1, 1:]], axis=-1).reshape(-1, 4)
    meshio.write(path := tmp_path / "quads.vtk", meshio.Mesh(place, [("quad", quads)]))
    triangles = MeshFile(path=str(path), layers=2, tangent=[1, 2, 3]).prisms().triangles
    forward = Grid(shape=[5, 4], diagonals=Diagonals.forward).surface().triangles
    assert {tuple(t) for t in triangles.tolist()} == {tuple(t) for t in forward.tolist()}


def test_second_order_elements_and_lines_keep_only_corners_of_the_surface(tmp_path):
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    middles = (corners + np.roll(corners, -1, axis=0)) / 2
    place = np.vstack([[[9, 9, 9.0]], corners, middles, [[0, 2, 0.0]]])
    cells = [("vertex", [[0]]), ("line", [[3, 7]]), ("triangle6", [[1, 2, 3, 4, 5, 6]])]
    meshio.write(path := tmp_path / "second.vtu", meshio.Mesh(place, cells))
    prisms = MeshFile(path=str(path)).prisms()
    assert prisms.triangles.tolist() == [[0, 1, 2]]
    np.testing.assert_allclose(prisms.position[3 * 3 : 4 * 3], corners, atol=1e-15)


def test_mesh_needs_meshio(monkeypatch):
    monkeypatch.setitem(sys.modules, "meshio", None)
    with pytest.raises(UserError, match=r"volume=mesh needs the package meshio; install it with"):
        MeshFile(path="any.stl").prisms()


def test_units_scale_every_length():
    one = Grid(size=[3, 2], radius=4, center=[1, 2, 3], thickness=0.5, offset=0.1)
    small = Grid(**{**vars(one), "unit": LengthUnit.mm})
    np.testing.assert_allclose(small.prisms().position, 1e-3 * one.prisms().position, atol=1e-17)
    np.testing.assert_allclose(small.prisms().depth, 1e-3 * one.prisms().depth)


def test_layers_about_their_offset_or_at_given_depths():
    np.testing.assert_allclose(
        Grid(layers=4, thickness=0.03, offset=0.005).depths(), [-0.01, 0, 0.01, 0.02], atol=1e-17
    )
    given = Grid(depth=[-1.0, 0.0, 3.0], unit=LengthUnit.cm).depths()
    np.testing.assert_allclose(given, [-0.01, 0.0, 0.03])


@pytest.mark.parametrize(
    ("diagonals", "meeting"),
    [(Diagonals.alternate, 8), (Diagonals.forward, 6), (Diagonals.backward, 6)],
)
def test_diagonals(diagonals, meeting):
    surface = Grid(shape=[3, 3], diagonals=diagonals).surface()
    assert (surface.triangles == 4).sum() == meeting  # triangles at the node in the middle
    forward = {(0, 4), (3, 7)} if diagonals is Diagonals.forward else set()
    edges = {(a, b) for t in surface.triangles.tolist() for a in t for b in t if a < b}
    assert edges >= forward


def test_tangent_chooses_the_first_axis():
    flat = Grid(tangent=[1.0, 1.0, 5.0]).prisms().frame
    np.testing.assert_allclose(flat[:, 0], np.tile([np.sqrt(0.5)] * 2 + [0], (63, 1)), atol=1e-14)
    tube = Grid(size=[0.3, 0.2], shape=[25, 3], radius=0.06, tangent=[0, 1, 0], thickness=0.02)
    np.testing.assert_allclose(tube.prisms().frame[:, 0], np.tile([0, 1, 0], (75, 1)), atol=1e-14)


def test_configured_parameters_may_be_whole_numbers():
    volume = configured("grid", "volume.samples.parameters=[[1,0,0,-1],[0.5,0.25,0.25,0]]")
    np.testing.assert_array_equal(volume.rule().parameter, [[1, 0, 0, -1], [0.5, 0.25, 0.25, 0]])


def test_volume_is_a_step_of_a_run(sldvexp, tmp_path):
    done = sldvexp("~experiment", "volume=dissertation")
    assert done.status == 0
    group = done.tree["volume"]
    assert (group.attrs["nodes"], group.attrs["samples"]) == (441, 3990)
    assert "plate_volume.csv" in str(done.tree.attrs)
    refused = sldvexp("~experiment", "volume=points", "volume.path=nowhere.csv")
    assert refused.status != 0
    assert "volume: nowhere.csv: there is no such file" in refused.err


@pytest.mark.whole
def test_million_nodes_take_less_than_a_loop_and_little_memory():
    volume = Grid(shape=[378, 378], radius=0.5, samples=SampleSettings(1, 1))
    tracemalloc.start()
    start = time.process_time()
    prisms = volume.prisms()
    part = sample_positions(prisms, volume.rule(), slice(0, 10_000))
    spent = time.process_time() - start
    some = prisms.position[:10_000]
    start = time.process_time()
    for position in some:
        position / np.linalg.norm(position)
    loop = (time.process_time() - start) * prisms.nodes / len(some)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert prisms.nodes > 1_000_000
    assert part.shape == (6, 10_000, 1, 3)
    assert peak < 4 * prisms.position.nbytes + 10 * prisms.frame.nbytes  # 0.2 GB
    assert spent < loop  # processor time of about 1.5 s against 9 s
