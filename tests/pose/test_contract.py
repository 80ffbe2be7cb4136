"""The contract of pose methods: every registered one finds a known pose in noiseless data."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.config import registry
from sldvexp.errors import UserError
from sldvexp.geometry import (
    KnownPose,
    euler_from_rotation,
    rotation_from_euler,
    rotation_from_vector,
)
from sldvexp.image import ScanLineEdges
from sldvexp.io import read_mesh
from sldvexp.io.registration import RegistrationTable, to_dataset
from sldvexp.laser import PartOutline, project
from sldvexp.pose import EXTRINSICS, PROMISED, PoseResult
from sldvexp.pose.bundle import Distance
from sldvexp.session.circles import edges_to_dataset

METHODS = sorted(registry.BUILT_IN["pose"])
POSTS = {"low": [0.0, 0.0, 0.1], "med": [0.1, 0.0, 0.1], "high": [0.1, 0.2, 0.15]}
CORNERS = {"one": [0.0, 0.0, 0.0], "two": [0.28, 0.0, 0.0], "three": [0.28, 0.28, 0.0]}


#: A plate with a step in its outline, so that it looks like nothing else after half a turn.
PART = "v 0 0 0\nv 0.28 0 0\nv 0.28 0.2 0\nv 0.1 0.2 0\nv 0.1 0.28 0\nv 0 0.28 0\n" + (
    "f 1 2 3\nf 1 3 4\nf 1 4 5\nf 1 5 6\n"
)


def outline_of(part, laser, rotation, origin, path):
    """Exact edges of a part's outline, and a rough pose a little beside."""
    point, outward = part.outline(rotation, origin, laser, 60)
    found = part.crossings(point, outward, rotation, origin, laser, 5.0)
    place = point[found.line] + found.along[:, None] * outward[found.line]
    count = len(place)
    edges = ScanLineEdges(
        position=laser.dac_from_angle(place * laser.step),
        std=np.full(count, 0.02),
        direction=outward[found.line],
        width=np.zeros(count),
        line=np.arange(count),
        rising=np.zeros(count, bool),
        phase=np.zeros(count),
        rejected=(),
        lines=count,
        name="the outline",
    )
    group = edges_to_dataset([edges])
    turn = rotation_from_vector([0.01, -0.02, 0.015])
    rough = {"rough_rotation": (turn @ rotation).ravel(), "rough_origin": origin + 0.01}
    group.attrs |= {"part": path, "part_unit": "m", **rough}
    return group


class World:
    """Noiseless data of all kinds that a run can have, of one or two views.

    A circle's image is an ellipse only without a mirror offset, so that there is none here.
    """

    def __init__(self, lab):
        self.lab, self.laser, self.target = lab, lab.laser, lab.target
        self.truth = {name: lab.truth(name) for name in lab.names}
        points = lab.target.points()
        tables = [
            RegistrationTable(
                name, points.number, points.position, project((points.position - o) @ r.T)
            )
            for name, (r, o) in self.truth.items()
        ]
        tables = [
            RegistrationTable(t.name, t.number, t.object_point, t.angle,
                              self.laser.dac_from_angle(t.angle))
            for t in tables
        ]  # fmt: skip
        self.tree = {**lab.tree(None), "registration": to_dataset(tables)}

    def tree_for(self, name, folder):
        """The run's data: edges are those of circles, or of a part's outline."""
        if name != "part":
            return dict(self.tree)
        path = folder / "part.obj"
        path.write_text(PART)
        mesh = read_mesh(path, 1.0, False)
        part = PartOutline.from_mesh(mesh.position, mesh.triangles)
        outlines = {
            f"edge/{view}": outline_of(part, self.laser, r, o, str(path))
            for view, (r, o) in self.truth.items()
        }
        return {**self.tree, **outlines}

    def method(self, name, folder):
        """The method as a run has it: most find what they need in the run's data."""
        plugin = registry.get("pose", name)
        if name == "given":
            return plugin(
                views={
                    view: KnownPose(
                        euler_from_rotation(r).tolist(), o.tolist(), [0.0] * 3, [0.0] * 3
                    )
                    for view, (r, o) in self.truth.items()
                }
            )
        if name == "digitizer":
            view, (r, o) = next(iter(self.truth.items()))
            path = self.digitised(folder / "d.csv", r, o)
            return plugin(path, instrument_points=POSTS, object_points=CORNERS, view=view)
        if name == "bundle":
            if len(self.truth) < 2:
                pytest.skip("unknown points need two views")
            points = self.target.points()
            length = np.linalg.norm(points.position[0] - points.position[-1])
            ends = [int(points.number[0]), int(points.number[-1])]
            return plugin(distances=[Distance(ends, float(length))])
        return plugin()

    def digitised(self, path, rotation, origin):
        """A digitizer's file, in axes of its own."""
        axes, shift = rotation_from_euler([0.3, 0.2, -0.1]), np.array([-1.0, 0.4, 2.0])
        posts = {k: rotation.T @ np.array(v) + origin for k, v in POSTS.items()}
        lines = ["point,x_m,y_m,z_m"]
        for name, place in {**posts, **CORNERS}.items():
            xyz = axes @ place + shift
            lines += [",".join([name, *map(repr, xyz.tolist())])] * 3
        path.write_text("\n".join(lines) + "\n")
        return str(path)


@pytest.fixture(scope="module", params=[1, 2], ids=["one view", "two views"])
def world(request, edge_lab, make_circles):
    return World(edge_lab(views=request.param, target=make_circles(1e-5), nominal=0.0))


def estimate(world, name, folder):
    tree = world.tree_for(name, folder)
    return world.method(name, folder).estimate(world.laser, world.target, tree)


@pytest.mark.one_in(10)
@pytest.mark.parametrize("name", METHODS)
def test_noiseless_data_gives_the_pose(world, name, tmp_path):
    found = estimate(world, name, tmp_path)
    assert isinstance(found, PoseResult)
    views = list(world.truth)[: 1 if name == "digitizer" else None]
    assert found.views == views
    for k, view in enumerate(views):
        rotation, origin = world.truth[view]
        np.testing.assert_allclose(found.rotation[k], rotation, atol=1e-8)
        np.testing.assert_allclose(found.origin[k], origin, atol=1e-8)
        assert f"view {view}: origin ({origin[0]:.4f}, " in repr(found)


@pytest.mark.one_in(10)
@pytest.mark.parametrize("name", METHODS)
def test_the_group_keeps_its_promises(world, name, tmp_path):
    found = estimate(world, name, tmp_path)
    pose = found.to_dataset()
    assert set(PROMISED) <= set(pose)
    assert set(pose.data_vars) <= set(dataset.VARIABLES["pose"])
    assert all({"units", "long_name"} <= set(pose[v].attrs) for v in pose.data_vars)
    assert list(pose["parameter"].values[:6]) == list(EXTRINSICS)
    covariance = pose["covariance"].values
    turned = covariance.swapaxes(1, 2)
    np.testing.assert_allclose(covariance, turned, rtol=0, atol=1e-13 * np.abs(covariance).max())
    assert (np.linalg.eigvalsh(covariance) >= -1e-12 * np.abs(covariance).max()).all()
    std = np.sqrt(np.einsum("vkk->vk", covariance))
    np.testing.assert_allclose(pose["origin_std"], std[:, 3:6])
    assert (pose["origin_confidence"] >= 1.9 * pose["origin_std"]).all()
    assert (pose["dof"] > 0).all()
    assert pose.attrs["confidence_level"] == 0.95
    assert all(isinstance(note, str) and note for note in found.notes)
    assert list(found.groups())[-1] == "pose"
    assert set(found.groups()) <= {"pose", "registration", "conic"}


@pytest.mark.one_in(10)
@pytest.mark.parametrize("name", METHODS)
def test_the_same_data_gives_the_same_bits_and_stays_as_it_is(world, name, tmp_path):
    before = {key: group.copy(deep=True) for key, group in world.tree.items()}
    one, two = (estimate(world, name, tmp_path) for _ in range(2))
    assert one.pose.identical(two.pose)
    assert all(group.identical(before[key]) for key, group in world.tree.items())


@pytest.mark.parametrize("name", METHODS)
def test_what_is_missing_is_said(world, name, tmp_path):
    method = world.method(name, tmp_path)
    if method.inputs() or name == "given":
        pytest.skip("needs nothing of the run")
    with pytest.raises(UserError):
        method.estimate(world.laser, world.target, {})
    with pytest.raises(UserError, match="choose one with laser=name"):
        method.estimate(None, world.target, world.tree_for(name, tmp_path))
