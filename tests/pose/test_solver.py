"""The pose solver: exact data, noisy data, the instrument's own registration file, bad input."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sldvexp.errors import UserError
from sldvexp.geometry import rotation_from_vector, vector_from_rotation
from sldvexp.laser import project
from sldvexp.pose import INTRINSICS, PoseSolution, solve_points, standard_error
from sldvexp.pose.least_squares import Pose, PoseProblem, levenberg_marquardt, linearise

#: 12-bit-plus-sign board over +-25 deg.
STEP = np.full(2, np.radians(25) / 4096)
RANGE = np.radians(25)

#: Figure 4.28, as measured: x, y in inch; up-down, left-right in degrees.
FIGURE_4_28 = np.array(
    [
        [2.3490, 3.2156, 5.7240, 0.016338],
        [2.1653, 2.4277, 6.3252, 0.15252],
        [7.5578, 2.0048, 7.5321, -3.68404],
        [7.3725, 1.2100, 8.1404, -3.5342],
        [7.0696, 1.7066, 7.6883, -3.32194],
        [7.8611, 1.5078, 7.9869, -3.8966],
        [9.1017, 9.8073, 1.1459, -5.0806],
        [9.8976, 9.6075, 1.4373, -5.7101],
        [9.5079, 9.2973, 1.6583, -5.3927],
        [9.4905, 10.1177, 0.92188, -5.3952],
        [1.5890, 9.1396, 0.82673, 0.50844],
        [1.5721, 9.9408, 0.15990, 0.52678],
        [1.9797, 9.5806, 0.51099, 0.23635],
        [1.1823, 9.5003, 0.47595, 0.79599],
        [2.6598, 2.8623, 6.0526, -0.19674],
        [1.8549, 2.7813, 5.9968, 0.36480],
    ]
)
OBJECT = np.column_stack([FIGURE_4_28[:, :2] * 0.0254, np.zeros(16)])
ANGLES = np.radians(FIGURE_4_28[:, 2:])


class Scene:
    """A calibration object somewhere in the world, seen by a laser within its mirrors' range.

    Shapes: ``plane``; ``two`` parallel planes; ``tilted`` second plane; ``nearly`` plane.
    """

    SHAPES = ("plane", "two", "tilted", "nearly")
    SIZES = (4, 5, 6, 8, 12, 16, 24, 32, 48, 64)

    def __init__(
        self,
        rng: np.random.Generator,
        points: int | None = None,
        shape: str | None = None,
        mirror_offset: float | None = None,
    ):
        n = points or int(rng.choice(self.SIZES))
        self.mirror_offset = rng.uniform(0, 0.05) if mirror_offset is None else mirror_offset
        while not self._draw(rng, n, shape or str(rng.choice(self.SHAPES))):
            pass

    def _draw(self, rng: np.random.Generator, n: int, shape: str) -> bool:
        """Draw a scene; false if the object is nearly a line or leaves the mirrors' range."""
        size = rng.uniform(0.25, 1.0)
        local = self._object(rng, n, shape, size)
        spread = np.linalg.svd(local - local.mean(axis=0), compute_uv=False)
        distance = np.exp(rng.uniform(np.log(0.5), np.log(10.0)))
        azimuth, roll = rng.uniform(0, 2 * np.pi, 2)
        tilt = np.radians(rng.uniform(0, 60)) * np.array([np.cos(azimuth), np.sin(azimuth), 0])
        towards = np.diag([1.0, -1.0, -1.0]) if rng.random() < 0.5 else np.eye(3)
        local_to_laser = rotation_from_vector(tilt) @ towards @ rotation_from_vector([0, 0, roll])
        sight = np.array([*np.tan(np.radians(rng.uniform(-20, 20, 2))), 1.0])
        centre = distance * sight / np.linalg.norm(sight)
        in_laser = local @ local_to_laser.T + centre
        exact = project(in_laser, self.mirror_offset)
        if spread[1] < 0.25 * spread[0] or in_laser[:, 2].min() < 0.1 or abs(exact).max() > RANGE:
            return False
        to_world, shift = rotation_from_vector(rng.normal(size=3)), rng.normal(size=3)
        self.points = local @ to_world.T + shift
        self.rotation = local_to_laser @ to_world.T
        self.origin = shift - self.rotation.T @ centre
        self.exact = exact
        self.noisy = exact + rng.uniform(0, 1) * STEP * rng.normal(size=exact.shape)
        return True

    @staticmethod
    def _object(rng: np.random.Generator, n: int, shape: str, size: float) -> np.ndarray:
        local = rng.uniform(-0.5, 0.5, (n, 3)) * size
        second = np.arange(n) % 2 == 1
        if shape == "nearly":
            local[:, 2] *= 10 ** rng.uniform(-4, -1)
            return local
        local[:, 2] = 0.0
        if shape == "two":
            local[second, 2] = rng.uniform(0.05, 0.3) * size
        elif shape == "tilted":
            fold = rng.uniform(np.radians(20), np.radians(70))
            local[second, 2] = np.sin(fold) * (local[second, 1] + size / 2)
            local[second, 1] *= np.cos(fold)
        return local

    def solve(self, angles: np.ndarray, **options: object) -> PoseSolution:
        return solve_points(
            self.points, angles, step=STEP, mirror_offset=self.mirror_offset, **options
        )


def costs_from_truth(group: list[Scene]) -> np.ndarray:
    """Least costs that are reached by starting from the true poses."""
    points = np.array([scene.points for scene in group]).swapaxes(1, 2)
    centroid = points.mean(axis=2)
    rotation = np.array([scene.rotation for scene in group])
    origin = np.array([scene.origin for scene in group])
    centre = np.einsum("mij,mj->mi", rotation, centroid - origin)
    intrinsics = np.array([[scene.mirror_offset, 1.0, 0.0, 1.0, 0.0] for scene in group])
    problem = PoseProblem(
        points=points - centroid[:, :, None],
        recorded=np.array([scene.noisy for scene in group]).swapaxes(1, 2),
        weight=np.broadcast_to(1 / STEP[:, None], (1, 2, points.shape[2])),
        adjusted=[],
        prior=np.empty((len(group), 0)),
        prior_weight=np.empty((len(group), 0)),
    )
    return levenberg_marquardt(problem, Pose(rotation, centre, intrinsics), 1, 500)[1]


def scenes(**kwargs: object) -> st.SearchStrategy[Scene]:
    return st.integers(0, 2**32).map(lambda seed: Scene(np.random.default_rng(seed), **kwargs))


quick = settings(max_examples=40, deadline=None, derandomize=True)


@pytest.mark.one_in(4)
@pytest.mark.parametrize("shape", Scene.SHAPES)
@quick
@given(data=st.data())
def test_noise_free_poses_are_recovered_exactly(shape: str, data: st.DataObject) -> None:
    scene = data.draw(scenes(shape=shape))
    found = scene.solve(scene.exact)
    assert found.converged
    np.testing.assert_allclose(found.rotation, scene.rotation, atol=1e-9)
    np.testing.assert_allclose(found.origin, scene.origin, atol=1e-9)
    assert found.cost < 1e-12


@quick
@given(scene=scenes(), seed=st.integers(0, 2**32))
def test_a_rigid_motion_of_the_world_moves_the_pose_only(scene: Scene, seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn, shift = rotation_from_vector(rng.normal(size=3)), rng.normal(size=3)
    here = scene.solve(scene.noisy)
    scene.points = scene.points @ turn.T + shift
    there = scene.solve(scene.noisy)
    np.testing.assert_allclose(there.cost, here.cost, rtol=1e-9)
    np.testing.assert_allclose(there.residual, here.residual, atol=1e-5)
    error = standard_error(here.covariance)
    moved = vector_from_rotation(there.rotation @ turn @ here.rotation.T)
    assert (np.abs(moved) < 1e-4 * error[:3]).all()
    np.testing.assert_allclose(
        there.origin, turn @ here.origin + shift, atol=1e-4 * error[3:].max()
    )


@pytest.mark.whole
@quick
@given(scene=scenes(), seed=st.integers(0, 2**32))
def test_the_order_of_the_points_does_not_matter(scene: Scene, seed: int) -> None:
    order = np.random.default_rng(seed).permutation(len(scene.points))
    here = scene.solve(scene.noisy)
    scene.points = scene.points[order]
    there = scene.solve(scene.noisy[order])
    np.testing.assert_allclose(there.residual, here.residual[order], atol=1e-5)
    assert (np.abs(there.origin - here.origin) < 1e-4 * standard_error(here.covariance)[3:]).all()
    np.testing.assert_allclose(there.covariance, here.covariance, rtol=1e-3, atol=1e-12)


def test_the_jacobian_is_that_of_finite_differences() -> None:
    rng = np.random.default_rng(4)
    m, n, p = 5, 7, 11
    problem = PoseProblem(
        points=rng.uniform(-0.3, 0.3, (m, 3, n)),
        recorded=rng.uniform(-0.3, 0.3, (m, 2, n)),
        weight=rng.uniform(0.5, 2.0, (m, 2, n)),
        adjusted=[0, 1, 2, 3, 4],
        prior=np.zeros((m, 5)),
        prior_weight=np.zeros((m, 5)),
    )
    pose = Pose(
        rotation_from_vector(rng.normal(size=(m, 3))),
        rng.uniform(-0.3, 0.3, (m, 3)) + np.array([0, 0, 2]),
        np.array([0.05, 1.1, 0.1, 0.9, -0.1]) + rng.uniform(0, 0.02, (m, 5)),
    )
    at = linearise(problem, pose)
    h = 1e-6
    for k in range(p):
        step = np.zeros((m, p))
        step[:, k] = h
        ahead = linearise(problem, pose.moved(step, problem.adjusted)).residual
        back = linearise(problem, pose.moved(-step, problem.adjusted)).residual
        np.testing.assert_allclose(at.jacobian[:, k], (back - ahead) / (2 * h), atol=1e-8)


@pytest.mark.whole
def test_the_global_optimum_is_found_without_a_start() -> None:
    rng, missed, trials = np.random.default_rng(2000), [], 0
    for points, _ in itertools.product(Scene.SIZES, range(4)):
        offset = rng.uniform(0, 0.05)
        group = [Scene(rng, points, mirror_offset=offset) for _ in range(50)]
        found = solve_points(
            [scene.points for scene in group],
            [scene.noisy for scene in group],
            step=STEP,
            mirror_offset=offset,
        )
        good = found.cost <= costs_from_truth(group) * (1 + 1e-6) + 1e-9
        missed += [(points, int(i)) for i in np.flatnonzero(~good)]
        trials += len(group)
    assert trials == 2000
    assert len(missed) <= trials / 1000, missed


@pytest.mark.parametrize("seed", [1023, 1923, 2427])
def test_four_points_with_three_valleys(seed: int) -> None:
    """Here the best rotation of the grid and its mirror image both lead into a wrong valley."""
    scene = Scene(np.random.default_rng(seed), 4)
    found = scene.solve(scene.noisy)
    assert found.cost <= costs_from_truth([scene])[0] * (1 + 1e-6)


def test_a_point_that_is_not_in_front_is_no_solution() -> None:
    problem = PoseProblem(
        points=np.array([[[-0.1, 0.0, 0.1], [0.1, -0.2, 0.1], [0.3, 0.0, -0.3]]]),
        recorded=np.zeros((2, 2, 3)),
        weight=np.ones((1, 2, 3)),
        adjusted=[],
        prior=np.empty((2, 0)),
        prior_weight=np.empty((2, 0)),
    )
    pose = Pose(
        np.tile(np.eye(3), (2, 1, 1)),
        np.array([[0.0, 0.0, 0.4], [0.0, 0.0, 0.2]]),
        np.tile([0.0, 1.0, 0.0, 1.0, 0.0], (2, 1)),
    )
    np.testing.assert_array_equal(np.isinf(linearise(problem, pose).cost), [False, True])


def figure_4_28(up_down: float = 1.0, **options: object) -> PoseSolution:
    """The instrument's own data, with the sign of the up-down angles as recorded or not."""
    return solve_points(OBJECT, ANGLES * [up_down, 1.0], step=STEP, **options)


@pytest.mark.parametrize("up_down", [1.0, -1.0])
@pytest.mark.parametrize(
    ("offset", "sse"), [(0.0, 0.000533), (0.02, 0.000564), (0.03, 0.000635), (0.04, 0.000745)]
)
def test_the_registration_of_figure_4_28(up_down: float, offset: float, sse: float) -> None:
    found = figure_4_28(up_down, mirror_offset=offset)
    assert found.converged
    assert found.sse_deg2 == pytest.approx(sse, abs=1e-6)
    assert found.sse_deg2 <= 0.00079
    assert found.dof == 26
    # With the angles as recorded the instrument stands behind the object's plane.
    assert math.copysign(1, found.origin[2]) == -up_down
    assert found.has_other
    assert found.other_cost > 100 * found.cost


@pytest.mark.parametrize("up_down", [1.0, -1.0])
def test_figure_4_28_barely_determines_the_mirror_offset(up_down: float) -> None:
    found = figure_4_28(up_down, adjust={"mirror_offset": math.inf})
    assert found.sse_deg2 <= 0.00054
    assert found.dof == 25
    error = standard_error(found.covariance)[found.parameters.index("mirror_offset")]
    assert found.intrinsics["mirror_offset"] == pytest.approx(0.0057, abs=1e-4)
    assert error == pytest.approx(0.0108, abs=1e-4)


def test_residuals_and_sums_of_squares_are_those_of_the_model() -> None:
    offset = 0.02
    found = figure_4_28(mirror_offset=offset)
    in_laser = (OBJECT - found.origin) @ found.rotation.T
    residual = ANGLES - project(in_laser, offset)
    np.testing.assert_allclose(found.residual, residual / STEP, atol=1e-9)
    assert found.sse_deg2 == pytest.approx((np.degrees(residual) ** 2).sum())
    assert found.cost == pytest.approx((found.residual**2).sum())
    assert found.s == pytest.approx(math.sqrt(found.cost / 26))


def test_the_other_solution_is_a_minimum_of_its_own() -> None:
    found = figure_4_28()

    def cost(rotation: np.ndarray, origin: np.ndarray) -> float:
        in_laser = (OBJECT - origin) @ rotation.T
        assert (in_laser[:, 2] > 0).all()
        return float((((ANGLES - project(in_laser)) / STEP) ** 2).sum())

    assert cost(found.other_rotation, found.other_origin) == pytest.approx(found.other_cost)
    for vector in np.vstack([np.eye(3), -np.eye(3)]) * 1e-3:
        turned = rotation_from_vector(vector) @ found.other_rotation
        assert cost(turned, found.other_origin) > found.other_cost
        assert cost(found.other_rotation, found.other_origin + vector) > found.other_cost


def test_a_batch_is_the_same_as_its_problems_one_by_one() -> None:
    rng = np.random.default_rng(11)
    group = [Scene(rng, 8, mirror_offset=0.03) for _ in range(300)]
    points, angles = [s.points for s in group], [s.noisy for s in group]
    batch = solve_points(points, angles, step=STEP, mirror_offset=0.03)
    assert batch.rotation.shape == (300, 3, 3)
    assert batch.intrinsics["mirror_offset"].shape == (300,)
    for i in (0, 1, 255, 256, 299):
        one = group[i].solve(angles[i])
        assert one.origin.shape == (3,)
        np.testing.assert_allclose(batch.rotation[i], one.rotation, atol=1e-7)
        np.testing.assert_allclose(batch.origin[i], one.origin, atol=1e-7)
        np.testing.assert_allclose(batch.covariance[i], one.covariance, rtol=1e-4)
        np.testing.assert_allclose(batch.other_cost[i], one.other_cost, rtol=1e-4)


def test_one_object_serves_a_whole_batch() -> None:
    angles = ANGLES + STEP * np.random.default_rng(3).normal(size=(5, 16, 2))
    shared = solve_points(OBJECT, angles, step=STEP)
    repeated = solve_points(np.broadcast_to(OBJECT, (5, 16, 3)), angles, step=STEP)
    np.testing.assert_allclose(shared.origin, repeated.origin, atol=1e-10)


def test_an_unreliable_point_counts_less() -> None:
    scene = Scene(np.random.default_rng(5), 16, "two")
    angles = scene.exact.copy()
    angles[3] += 50 * STEP
    std = np.ones(16)
    std[3] = 1e6
    spoilt = np.linalg.norm(scene.solve(angles).origin - scene.origin)
    weighted = np.linalg.norm(scene.solve(angles, std=std).origin - scene.origin)
    assert weighted < 1e-6 * spoilt


def test_known_noise_sets_the_scale_of_the_covariance() -> None:
    scene = Scene(np.random.default_rng(6), 16, "two")
    one, three = (scene.solve(scene.noisy, std=std) for std in (1.0, 3.0))
    np.testing.assert_allclose(three.origin, one.origin, atol=1e-9)
    np.testing.assert_allclose(three.covariance, 9 * one.covariance, rtol=1e-6)
    assert three.s == pytest.approx(one.s / 3)
    assert three.covariance_dof == math.inf
    unknown = scene.solve(scene.noisy)
    np.testing.assert_allclose(unknown.covariance, unknown.s**2 * one.covariance, rtol=1e-6)


# A deep object near the instrument, so that its angles determine every intrinsic but one.
DEEP = np.array(list(itertools.product((-0.2, 0.0, 0.2), (-0.2, 0.0, 0.2), (0.0, 0.15, 0.3))))
DEEP_ROTATION = rotation_from_vector([0.3, -0.2, 0.5])
DEEP_IN_LASER = DEEP @ DEEP_ROTATION.T + [0.02, -0.03, 0.7]


def recorded(true_intrinsics: dict[str, float]) -> np.ndarray:
    """Angles of the deep object as a nominal calibration records them."""
    true = {"gain_up_down": 1.0, "gain_left_right": 1.0} | true_intrinsics
    angle = project(DEEP_IN_LASER, true.get("mirror_offset", 0.0))
    zero = np.array([true.get("zero_up_down", 0.0), true.get("zero_left_right", 0.0)])
    return (angle - zero) / [true["gain_up_down"], true["gain_left_right"]]


def test_two_starts_that_meet_are_one_solution() -> None:
    found = solve_points(DEEP, recorded({}), step=STEP)
    assert found.converged
    assert not found.has_other
    assert np.isnan(found.other_origin).all()


def test_free_intrinsics_are_recovered() -> None:
    true = {
        "mirror_offset": 0.045,
        "gain_up_down": 1.02,
        "gain_left_right": 0.97,
        "zero_left_right": 0.01,
    }
    found = solve_points(DEEP, recorded(true), step=STEP, adjust=dict.fromkeys(true, math.inf))
    assert found.parameters[6:] == tuple(true)
    for name, value in true.items():
        assert found.intrinsics[name] == pytest.approx(value, abs=1e-9)
    np.testing.assert_allclose(found.rotation, DEEP_ROTATION, atol=1e-9)


def test_the_zero_of_the_up_down_mirror_is_a_rotation() -> None:
    angles = recorded({"zero_up_down": 0.01})
    with pytest.raises(UserError, match="cannot tell zero_up_down from a motion of the instrument"):
        solve_points(DEEP, angles, step=STEP, adjust={"zero_up_down": math.inf})
    found = solve_points(DEEP, angles, step=STEP, adjust={"zero_up_down": 0.002}, std=1.0)
    assert found.intrinsics["zero_up_down"] == pytest.approx(0.0, abs=1e-9)
    assert standard_error(found.covariance)[6] == pytest.approx(0.002)
    assert standard_error(found.covariance)[0] > 0.0019


@pytest.mark.parametrize("std", [None, 1.0])
def test_a_prior_lies_between_fixed_and_free(std: float | None) -> None:
    noise = STEP * np.random.default_rng(9).normal(size=(27, 2))
    angles = recorded({"mirror_offset": 0.045}) + noise

    def offset(nominal: float, prior: float) -> tuple[float, float]:
        adjust = {"mirror_offset": prior}
        found = solve_points(DEEP, angles, step=STEP, mirror_offset=nominal, adjust=adjust, std=std)
        assert found.converged
        return float(found.intrinsics["mirror_offset"]), float(standard_error(found.covariance)[6])

    free, error = offset(0.045, math.inf)
    nominal = free - error
    assert offset(nominal, 1e-3 * error)[0] == pytest.approx(nominal, abs=1e-3 * error)
    assert offset(nominal, 1e3 * error)[0] == pytest.approx(free, abs=1e-3 * error)
    # A prior as good as the data halves the way and the variance; the noise seems a little larger.
    value, bound = offset(nominal, error)
    assert value == pytest.approx((free + nominal) / 2, abs=0.02 * error)
    assert bound == pytest.approx(error / math.sqrt(2), rel=0.02)


def test_the_noise_behind_a_prior_is_that_of_the_residuals() -> None:
    rng = np.random.default_rng(10)
    true = recorded({"mirror_offset": 0.045})
    for size in (0.1, 3.0):
        angles = true + size * STEP * rng.normal(size=(200, 27, 2))
        found = solve_points(
            DEEP, angles, step=STEP, mirror_offset=0.044, adjust={"mirror_offset": 0.001}
        )
        assert found.converged.all()
        sse = (found.residual**2).sum(axis=(1, 2))
        np.testing.assert_allclose(found.s**2, sse / found.dof, rtol=1e-9)
        assert ((found.dof > 47) & (found.dof < 48)).all()
        known = solve_points(
            DEEP,
            angles[0],
            step=STEP,
            mirror_offset=0.044,
            adjust={"mirror_offset": 0.001},
            std=found.s[0],
        )
        np.testing.assert_allclose(known.covariance, found.covariance[0], rtol=1e-4)
        # 200 estimates of a variance with 47 degrees of freedom: 5 standard errors.
        assert np.mean(found.s**2) / size**2 == pytest.approx(1, abs=5 * math.sqrt(2 / 47 / 200))


def test_three_points_give_a_pose_without_bounds() -> None:
    found = solve_points(OBJECT[:3] * [1, 1, 0] + [0, 0, 0.1], ANGLES[:3], step=STEP)
    assert found.cost < 1e-12
    assert found.dof == 0
    assert found.s == math.inf
    assert np.isinf(found.covariance).all()
    known = solve_points(OBJECT[:3], ANGLES[:3], step=STEP, std=1.0)
    assert np.isfinite(known.covariance).all()


def test_a_pose_that_was_not_reached_says_so() -> None:
    found = figure_4_28(max_iterations=1)
    assert not found.converged
    assert np.isinf(found.covariance).all()
    assert not found.has_other
    assert np.isnan(found.other_cost)


def edited(array: np.ndarray, index: object, value: float) -> np.ndarray:
    changed = array.copy()
    changed[index] = value
    return changed


@pytest.mark.parametrize(
    ("points", "angles", "options", "message"),
    [
        (OBJECT[:, :2], ANGLES, {}, r"must be \(points, 3\) and \(points, 2\)"),
        (OBJECT[:5], ANGLES, {}, r"not \(5, 3\) and \(16, 2\)"),
        (OBJECT[:2], ANGLES[:2], {}, "at least 3 points, not 2"),
        (np.empty((0, 16, 3)), np.empty((0, 16, 2)), {}, "the batch is empty"),
        (edited(OBJECT, (3, 1), np.nan), ANGLES, {}, "coordinates of point 4 must be finite"),
        (OBJECT, edited(ANGLES, (6, 0), np.inf), {}, "angles of point 7 must lie between"),
        (OBJECT, edited(ANGLES, (6, 0), 1.6), {}, "angles of point 7 must lie between"),
        (OBJECT, np.tile(ANGLES[0], (16, 1)), {}, "angles must differ from point to point"),
        (
            OBJECT,
            edited(np.tile(ANGLES, (4, 1, 1)), (2, 6, 1), np.nan),
            {},
            "angles of point 7 of pose 3 of 4 must lie",
        ),
        (OBJECT[:, :1] * [1, 2, 3], ANGLES, {}, "lie on one line"),
        (np.ones((16, 3)), ANGLES, {}, "lie on one line"),
        (OBJECT, ANGLES, {"step": [1e-4, 0.0]}, "step must be positive"),
        (OBJECT, ANGLES, {"mirror_offset": math.nan}, "mirror_offset must be finite"),
        (OBJECT, ANGLES, {"std": np.ones(3)}, r"one value a point, \(16,\), not \(3,\)"),
        (OBJECT, ANGLES, {"std": edited(np.ones(16), 4, 0.0)}, "std of point 5 must be positive"),
        (OBJECT, ANGLES, {"adjust": {"mirror_ofset": 1.0}}, "did you mean mirror_offset"),
        (OBJECT, ANGLES, {"adjust": {"mirror_offset": 0.0}}, "prior of mirror_offset must be"),
        (OBJECT[:3], ANGLES[:3], {"adjust": {"mirror_offset": math.inf}}, "too few for 7 unknowns"),
        (OBJECT[:3], ANGLES[:3], {"adjust": {"mirror_offset": 0.01}}, "give std, or more points"),
    ],
)
def test_bad_input_is_explained(
    points: np.ndarray, angles: np.ndarray, options: dict[str, object], message: str
) -> None:
    with pytest.raises(UserError, match=message):
        solve_points(points, angles, **({"step": STEP} | options))


def test_every_intrinsic_can_be_adjusted_with_a_prior() -> None:
    found = figure_4_28(adjust=dict.fromkeys(INTRINSICS, 0.01))
    assert found.converged
    assert found.covariance.shape == (11, 11)
    assert (np.linalg.eigvalsh(found.covariance) > 0).all()
