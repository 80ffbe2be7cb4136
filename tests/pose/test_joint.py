"""All views adjusted together: what they share is found once, and their errors are correlated."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from sldvexp import dataset
from sldvexp.check import Examination
from sldvexp.check.pose_repeats import PoseRepeats
from sldvexp.errors import ConfigError, UserError
from sldvexp.geometry import rotation_from_euler, vector_from_rotation
from sldvexp.io.registration import RegistrationTable, write
from sldvexp.laser import TwoMirror, project
from sldvexp.pose import (
    INTRINSICS,
    JointCovariance,
    PointObservations,
    Registration,
    cross_covariance,
    nominal_intrinsics,
    solve_points,
    solve_points_together,
    true_angles,
)
from sldvexp.pose.bitangent import Bitangent
from sldvexp.pose.bundle_adjustment import Arrow
from sldvexp.pose.edge import Edge
from sldvexp.pose.manual import Manual
from sldvexp.targets import FiducialPoint, FiducialPoints
from sldvexp.virtual_lab.scene import MirrorError, MirrorErrors

INF = float("inf")
STEP = np.full(2, np.radians(25) / 4096)
DETERMINED = ("mirror_offset", "gain_up_down", "gain_left_right", "zero_left_right")
#: Points of two planes, m.
OBJECT = np.array(
    [[x, y, z] for z, corners in ((0.0, (0.0, 0.28)), (0.08, (0.1, 0.2)))
     for x in corners for y in corners] + [[0.14, 0.05, 0.02], [0.05, 0.2, 0.05]]
)  # fmt: skip
TRUE = {"mirror_offset": 0.045, "gain_up_down": 1.01, "gain_left_right": 0.995,
        "zero_left_right": 0.004}  # fmt: skip


@pytest.fixture
def poses(edge_lab):
    """True poses of the views."""
    views = edge_lab(views=5).scene.views
    return {n: (rotation_from_euler(v.euler), np.array(v.origin)) for n, v in views.items()}


def sights(poses, true, rng=None, std=None, size=1.0):
    """What the views see of the object, with noise of so many DAC steps."""
    intrinsics = nominal_intrinsics(0.0)
    intrinsics[[INTRINSICS.index(n) for n in true]] = list(true.values())
    found = []
    for name, (rotation, origin) in poses.items():
        angle = project((OBJECT - origin) @ rotation.T, intrinsics[0])
        recorded = (angle - intrinsics[2::2]) / intrinsics[1::2]
        if rng is not None:
            recorded = recorded + size * STEP * rng.standard_normal(angle.shape)
        np.testing.assert_allclose(true_angles(angle, nominal_intrinsics(0.0)), angle)
        known = None if std is None else np.full(len(OBJECT), std)
        found.append(PointObservations(name, OBJECT, recorded, known))
    return found


def together(seen, shared, adjusted=None, offset=0.03):
    found = solve_points_together(
        seen, step=STEP, mirror_offset=offset, adjust=adjusted, shared=shared, max_iterations=100
    )
    return found.solutions, found.joint.matrix


def first(poses, count):
    return dict(list(poses.items())[:count])


def errors_of(poses, solutions):
    return [
        np.append(vector_from_rotation(s.rotation @ rotation.T), s.origin - origin)
        for s, (rotation, origin) in zip(solutions, poses.values(), strict=True)
    ]


def test_an_arrow_is_solved_and_inverted_as_the_whole_matrix():
    rng = np.random.default_rng(1)
    jacobian = np.zeros((60, 3 + 4 + 2))
    jacobian[:30, :3], jacobian[30:, 3:7] = rng.normal(size=(30, 3)), rng.normal(size=(30, 4))
    jacobian[:, 7:] = rng.normal(size=(60, 2))
    whole = jacobian.T @ jacobian
    arrow = Arrow([whole[:3, :3], whole[3:7, 3:7]], [whole[:3, 7:], whole[3:7, 7:]], whole[7:, 7:])
    right = rng.normal(size=9)
    own, common = arrow.solve([right[:3], right[3:7]], right[7:])
    np.testing.assert_allclose(np.concatenate([*own, common]), np.linalg.solve(whole, right))
    np.testing.assert_allclose(arrow.covariance(), np.linalg.inv(whole), atol=1e-14)
    assert arrow.determined()


def test_an_arrow_says_what_nothing_determines():
    rng = np.random.default_rng(2)
    own, common = rng.normal(size=(30, 3)), rng.normal(size=(30, 2))
    common[:, 1] = own[:, 0]
    arrow = Arrow([own.T @ own], [own.T @ common], common.T @ common)
    assert not arrow.determined()
    np.testing.assert_allclose(arrow.undetermined_common(), [0, 1], atol=1e-6)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_points_without_noise_give_all_views_and_what_they_share(poses, count):
    some = first(poses, count)
    solutions, covariance = together(sights(some, TRUE), dict.fromkeys(TRUE, INF))
    np.testing.assert_allclose(errors_of(some, solutions), 0, atol=1e-9)
    for solution in solutions:
        for name, value in TRUE.items():
            assert solution.intrinsics[name] == pytest.approx(value, abs=1e-9)
    assert covariance.shape == (6 * count + 4,) * 2


@pytest.mark.one_in(2)
@pytest.mark.parametrize("count", [2, 3, 4, 5])
def test_edges_without_noise_give_all_views_and_what_they_share(edge_lab, make_circles, count):
    mirrors = MirrorErrors(0.015, MirrorError(gain=0.01), MirrorError(gain=-0.005, zero=0.004))
    lab = edge_lab(views=count, target=make_circles(0.0), mirrors=mirrors)
    found = lab.solve(lab.points(None), shared=dict.fromkeys(TRUE, INF))
    np.testing.assert_allclose(lab.errors(found), 0, atol=1e-9)
    for pose in found.poses:
        np.testing.assert_allclose(pose.intrinsics, [0.045, 1.01, 0, 0.995, 0.004], atol=1e-9)


def test_one_view_shares_with_itself(poses):
    seen = sights(first(poses, 1), {"mirror_offset": 0.045}, np.random.default_rng(3))
    (found,), covariance = together(seen, {"mirror_offset": INF})
    alone = solve_points(
        OBJECT, seen[0].angles, step=STEP, mirror_offset=0.03, adjust={"mirror_offset": INF}
    )
    np.testing.assert_allclose(found.rotation, alone.rotation, atol=1e-9)
    np.testing.assert_allclose(found.covariance, alone.covariance, rtol=1e-4)
    np.testing.assert_allclose(covariance, alone.covariance, rtol=1e-4)
    np.testing.assert_allclose(found.residual, alone.residual, atol=1e-5)
    assert found.s == pytest.approx(float(alone.s))
    assert found.dof == pytest.approx(float(alone.dof))


def test_views_add_their_knowledge_of_what_they_share(poses):
    """Views without other common errors: the information of each about the offset is summed."""
    seen = sights(poses, {"mirror_offset": 0.03}, std=1.0)

    def precision(some):
        solutions, _ = together(some, {"mirror_offset": INF})
        return [1 / s.covariance[6, 6] for s in solutions]

    alone = [precision([s])[0] for s in seen]
    np.testing.assert_allclose(precision(seen), sum(alone), rtol=1e-6)


def test_a_shared_offset_is_known_better_from_several_views(edge_lab):
    def std(views):
        lab = edge_lab(views=views)
        found = lab.solve(lab.points(np.random.default_rng(4)), shared={"mirror_offset": INF})
        return np.sqrt(np.diag(found.joint.matrix))

    one, three = std(1), std(3)
    # The same machining errors of the circles look different from each place.
    assert three[-1] < one[-1] / np.sqrt(3)
    assert (three[:6] < one[:6]).all()


def test_own_and_shared_intrinsics_and_priors_go_together(poses):
    some = first(poses, 3)
    seen = sights(some, {"mirror_offset": 0.04, "gain_up_down": 1.002})
    solutions, covariance = together(seen, {"gain_up_down": 0.002}, {"mirror_offset": INF})
    assert solutions[0].parameters[6:] == ("mirror_offset", "gain_up_down")
    np.testing.assert_allclose(errors_of(some, solutions), 0, atol=1e-6)
    assert covariance.shape == (22, 22)


def test_the_noise_is_that_of_all_views(poses):
    seen = sights(poses, {}, np.random.default_rng(13))
    solutions, _ = together(seen, {"mirror_offset": INF}, offset=0.0)
    angles = 5 * 2 * len(OBJECT)
    square = sum(np.sum(s.residual**2) for s in solutions)
    for s in solutions:
        assert s.dof == pytest.approx(angles - 5 * 6 - 1)
        assert s.s**2 == pytest.approx(square / s.dof, rel=1e-4)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("method", [Edge, Bitangent])
def test_what_is_only_assumed_stays_in_the_bounds(edge_lab, method):
    lab = edge_lab(views=2)
    tree = lab.tree(np.random.default_rng(14))
    pose = method(shared={"zero_up_down": 0.001}).estimate(lab.laser, lab.target, tree).pose
    std = np.sqrt(np.diag(pose["joint_covariance"].values))
    np.testing.assert_allclose(std[[0, 6, 12]], 0.001, rtol=0.01)
    # One zero for both: it turns both views alike.
    both = pose["joint_covariance"].sel(unknown="a/rotation_x", unknown2="b/rotation_x")
    assert float(both) == pytest.approx(1e-6, rel=0.01)
    assert "all views: zero_up_down is what was assumed" in pose.attrs["notes"]


def joint_errors(poses, shared, true, seed, repeats, size=1.0):
    """Errors of all unknowns, and their covariance, over repeats with noise of so many steps."""
    rng = np.random.default_rng(seed)
    errors, covariances = [], []
    for _ in range(repeats):
        solutions, covariance = together(sights(poses, true, rng, size=size), shared)
        common = [solutions[0].intrinsics[n] - true[n] for n in shared]
        errors.append(np.concatenate([*errors_of(poses, solutions), common]))
        covariances.append(covariance)
    return np.array(errors), np.array(covariances)


def check_joint(errors, covariances):
    """The errors are distributed as the joint covariance says, correlations between views too."""
    repeats, size = errors.shape
    distance = [e @ np.linalg.solve(c, e) for e, c in zip(errors, covariances, strict=True)]
    # The mean of chi-squares, a little larger since the noise is estimated.
    assert np.mean(distance) / size == pytest.approx(
        1.0, abs=0.05 + 4 * np.sqrt(2 / size / repeats)
    )
    mean = covariances.mean(axis=0)
    std = np.sqrt(np.diag(mean))
    np.testing.assert_allclose(errors.std(axis=0) / std, 1, atol=4.5 / np.sqrt(2 * repeats))
    expected = mean / np.outer(std, std)
    limit = 5 * (1 - expected**2) / np.sqrt(repeats) + 0.01
    assert (np.abs(np.corrcoef(errors.T) - expected) < limit).all()
    assert np.abs(expected[:6, 6:12]).max() > 0.2


@pytest.mark.whole
def test_points_scatter_as_the_joint_covariance_says(poses):
    true = {"mirror_offset": 0.045}
    check_joint(*joint_errors(first(poses, 2), {"mirror_offset": INF}, true, 5, 60))


@pytest.mark.long
def test_points_scatter_as_the_joint_covariance_says_in_many_repeats(poses):
    # With a whole step of noise ten points leave 24 mm of offset, beyond where the model is linear.
    shared = dict.fromkeys(TRUE, INF)
    check_joint(*joint_errors(first(poses, 3), shared, TRUE, 6, 500, size=0.2))


def edge_errors(lab, shared, seed, repeats):
    """The same for edges; each repeat has its own object."""
    rng = np.random.default_rng(seed)
    errors, covariances = [], []
    for _ in range(repeats):
        lab.machine(rng)
        found = lab.solve(lab.points(rng), shared=shared)
        true = nominal_intrinsics(lab.nominal + lab.scene.mirrors.mirror_offset)
        away = (found.poses[0].intrinsics - true)[[INTRINSICS.index(n) for n in shared]]
        errors.append(np.append(lab.errors(found), away))
        covariances.append(found.joint.matrix)
    return np.array(errors), np.array(covariances)


@pytest.mark.whole
def test_edges_scatter_as_the_joint_covariance_says(edge_lab):
    lab = edge_lab(views=2, mirrors=MirrorErrors(0.01))
    check_joint(*edge_errors(lab, {"mirror_offset": INF}, 7, 60))


@pytest.mark.long
@pytest.mark.parametrize("shared", [{}, {"mirror_offset": INF}], ids=["circles", "offset too"])
def test_edges_scatter_as_the_joint_covariance_says_in_many_repeats(edge_lab, shared):
    check_joint(*edge_errors(edge_lab(views=3), shared, 8, 300))


def test_what_no_view_determines_is_named(poses, edge_lab, make_circles):
    seen = sights(first(poses, 3), {})
    with pytest.raises(UserError, match="the angles of all views cannot tell zero_up_down from"):
        together(seen, {"mirror_offset": INF, "zero_up_down": INF})
    lab = edge_lab(views=2, target=make_circles(0.0))
    with pytest.raises(UserError, match="all views: the edges cannot tell zero_up_down from"):
        lab.solve(lab.points(None), shared={"zero_up_down": INF})
    few = [PointObservations("a", OBJECT[:3], seen[0].angles[:3])]
    with pytest.raises(UserError, match="6 angles in all views are too few for 7 unknowns"):
        together(few, {"mirror_offset": INF})


def test_a_view_without_a_pose_is_named(poses):
    seen = sights(first(poses, 2), {})
    seen[1] = PointObservations("b", OBJECT[:2], seen[1].angles[:2])
    with pytest.raises(UserError, match="view b: a pose needs at least 3 points"):
        together(seen, {"mirror_offset": INF})


def test_names_are_checked():
    with pytest.raises(ConfigError, match=r"shared\.mirror_ofset: cannot be adjusted; did"):
        Edge(shared={"mirror_ofset": 1.0})
    with pytest.raises(ConfigError, match=r"shared\.mirror_offset: is in adjust too"):
        Edge(adjust={"mirror_offset": 1.0}, shared={"mirror_offset": 1.0})


def files(folder, poses, true, rng):
    """Registration files of the views, by view."""
    paths = {}
    for seen in sights(poses, true, rng):
        paths[seen.name] = str(folder / f"{seen.name}.csv")
        number = np.arange(1, len(OBJECT) + 1)
        write(paths[seen.name], [RegistrationTable(seen.name, number, OBJECT, angle=seen.angles)])
    return paths


def test_groups_hold_the_joint_covariance(tmp_path, poses):
    laser = TwoMirror(mirror_offset=0.03)
    paths = files(tmp_path, first(poses, 3), TRUE, np.random.default_rng(9))
    method = Registration(path=paths, shared={"mirror_offset": INF}, adjust={"gain_up_down": 0.01})
    found = method.estimate(laser, None, {})
    pose = found.pose
    assert list(pose["unknown"].values[[0, 6, 7, -1]]) == [
        "a/rotation_x", "a/gain_up_down", "b/rotation_x", "mirror_offset"
    ]  # fmt: skip
    assert list(pose["adjusted"].values) == ["gain_up_down", "mirror_offset"]
    offset = pose["intrinsic"].sel(adjusted="mirror_offset").values
    assert (offset == offset[0]).all()
    dataset.save({"pose": pose}, {}, tmp_path / "run.nc")
    with dataset.load(tmp_path / "run.nc") as tree:
        kept = tree["pose"].to_dataset().load()
    block = cross_covariance(kept, ["c", "a"])
    assert block.shape == (2, 6, 2, 6)
    for k, view in enumerate(["c", "a"]):
        own = pose["covariance"].sel(view=view).values[:6, :6]
        np.testing.assert_allclose(block[k, :, k], own)
    assert np.abs(block[0, :, 1]).max() > 0
    np.testing.assert_allclose(block.reshape(12, 12), block.reshape(12, 12).T)
    examined = Examination(found.groups(), rng=np.random.default_rng(0))
    with pytest.raises(UserError, match=r"pose\.shared solved them together"):
        PoseRepeats().examine(examined)


def test_views_without_common_errors_are_independent(tmp_path, poses):
    paths = files(tmp_path, first(poses, 2), {}, np.random.default_rng(10))
    pose = Registration(path=paths).estimate(TwoMirror(), None, {}).pose
    assert "joint_covariance" not in pose
    block = cross_covariance(pose, ["a", "b"])
    assert not block[0, :, 1].any()
    np.testing.assert_allclose(block[1, :, 1], pose["covariance"].sel(view="b").values)


def test_unknowns_stand_where_their_names_say():
    joint = JointCovariance(["a", "b"], ["gain_up_down"], ["mirror_offset"], np.diag(range(15)))
    assert joint.unknowns()[7:9] == ["b/rotation_x", "b/rotation_y"]
    np.testing.assert_allclose(np.diag(joint.of_views()[1]), [7, 8, 9, 10, 11, 12, 13, 14])


def numbers_of(pose, truth):
    """Errors of all views in a row."""
    each = zip(pose["rotation"].values, pose["origin"].values, strict=True)
    return np.concatenate(
        errors_of(truth, [SimpleNamespace(rotation=r, origin=o) for r, o in each])
    )


def check_between_views(pose, shifts):
    """Two views have in common what the object's errors, one after the other, do to both."""
    moved = sum(np.outer(s, s) for s in shifts)[:6, 6:12]
    joint = pose["joint_covariance"].values
    std = np.sqrt(np.diag(joint))
    scale = np.outer(std[:6], std[6:12])
    assert np.abs(moved / scale).max() > 0.3
    np.testing.assert_allclose(joint[:6, 6:12] / scale, moved / scale, atol=0.01)
    for k, view in enumerate(pose["view"].values):
        own = slice(6 * k, 6 * k + 6)
        np.testing.assert_allclose(joint[own, own], pose["covariance"].sel(view=view))


@pytest.mark.whole
def test_marks_that_stand_elsewhere_move_all_views(tmp_path, poses):
    """Each coordinate of a mark is moved by its standard deviation, and every pose found anew."""
    some, numbers = first(poses, 2), np.arange(1, len(OBJECT) + 1)
    marks = {int(n): FiducialPoint(*p) for n, p in zip(numbers, OBJECT, strict=True)}
    target, laser = FiducialPoints(accuracy=4e-4, fiducials=marks), TwoMirror(mirror_offset=0.03)

    def solved(moved):
        paths = {}
        for name, (rotation, origin) in some.items():
            paths[name] = str(tmp_path / f"{name}.csv")
            angle = project((moved - origin) @ rotation.T, 0.03)
            write(paths[name], [RegistrationTable(name, numbers, OBJECT, angle=angle)])
        return Manual(path=paths, pointing=0.5).estimate(laser, target, {}).pose

    shifts = []
    for k in range(OBJECT.size):
        moved = OBJECT.copy()
        moved.flat[k] += target.points().std[0, 0]
        shifts.append(numbers_of(solved(moved), some))
    check_between_views(solved(OBJECT), shifts)


@pytest.mark.long
def test_circles_that_stand_elsewhere_move_all_views(edge_lab, poses):
    """Each number of a circle is moved by its standard deviation, and every pose found anew."""
    lab, some = edge_lab(views=2), first(poses, 2)
    thing = lab.lab.calibration_object
    std = lab.target.unit.value * lab.target.accuracy / np.sqrt(3)

    def solved(center, radius):
        lab.lab.objects = [replace(thing, center=center, radius=radius)]
        return Bitangent().estimate(lab.laser, lab.target, lab.tree(np.random.default_rng(11))).pose

    known = solved(thing.center, thing.radius)
    shifts = []
    for circle in range(4):
        for k in range(4):
            center, radius = thing.center.copy(), thing.radius.copy()
            if k < 3:
                center[circle, k] += std
            else:
                radius[circle] += std / 2
            shifts.append(numbers_of(solved(center, radius), some) - numbers_of(known, some))
    check_between_views(known, shifts)


@pytest.mark.whole
@pytest.mark.parametrize("method", [Edge, Bitangent])
def test_scanned_views_share_an_offset(edge_lab, method):
    lab = edge_lab(views=3, mirrors=MirrorErrors(0.01))
    tree = lab.tree(np.random.default_rng(12))
    pose = method(shared={"mirror_offset": INF}).estimate(lab.laser, lab.target, tree).pose
    error = pose["intrinsic"].values[:, 0] - 0.04
    assert (np.abs(error) < 4 * pose["intrinsic_std"].values[:, 0]).all()
    for k, name in enumerate(lab.names):
        found = SimpleNamespace(
            rotation=pose["rotation"][k].values, origin=pose["origin"][k].values
        )
        std = np.sqrt(np.diag(pose["covariance"][k].values))[:6]
        assert (np.abs(lab.error(name, found)) < 4 * std).all()
    assert "barely" not in pose.attrs["notes"]
