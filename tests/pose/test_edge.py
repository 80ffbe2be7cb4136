"""The pose from edge points: exact model, efficient, honest bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sldvexp.errors import UserError
from sldvexp.geometry import rotation_from_vector
from sldvexp.pose import EdgePoints, nominal_intrinsics
from sldvexp.pose.edge import Edge
from sldvexp.pose.edge_solver import EdgeScene, residuals, spread
from sldvexp.statistics import student_factor
from sldvexp.targets import std_of_bound
from sldvexp.virtual_lab.scene import MirrorError, MirrorErrors

REPEATS, MANY = 120, 1000
INF = float("inf")


@pytest.fixture(scope="module")
def exact(edge_lab, make_circles):
    """Circles without machining errors."""
    return edge_lab(target=make_circles(accuracy=0.0))


def bounds(found):
    return np.sqrt(np.diag(found.joint.matrix))


def test_exact_edges_give_the_exact_pose(exact):
    found = exact.solve(exact.points(None))
    np.testing.assert_allclose(exact.errors(found), 0, atol=1e-12)
    assert abs(found.poses[0].rim) < 1e-12


@pytest.mark.whole
@settings(max_examples=15, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_derivatives_equal_differences(edge_lab, make_circles, seed):
    rng = np.random.default_rng(seed)
    lab = edge_lab(target=make_circles(planes=2))
    points = lab.points(rng)[0]
    rotation, origin = lab.truth("a")
    at_rest = EdgeScene(
        rotation_from_vector(1e-3 * rng.normal(size=3)) @ rotation,
        origin + 1e-3 * rng.normal(size=3),
        1e-5,
        nominal_intrinsics(0.03) + 1e-3 * rng.normal(size=5),
        1e-5 * rng.normal(size=(8, 4)),
    )

    def at(change):
        scene = EdgeScene(
            rotation_from_vector(change[:3]) @ at_rest.rotation,
            at_rest.origin + change[3:6],
            at_rest.rim + change[6],
            at_rest.intrinsics + change[7:12],
            at_rest.moved + change[12:].reshape(8, 4),
        )
        return residuals(points, scene)

    jacobian = at(np.zeros(12 + 32))[1]
    h = 1e-6
    for k in range(jacobian.shape[1]):
        step = np.zeros(jacobian.shape[1])
        step[k] = h
        difference = (at(step)[0] - at(-step)[0]) / (2 * h)
        np.testing.assert_allclose(difference, jacobian[:, k], atol=1e-6)


def repeated(lab, repeats, seed):
    """Errors of the pose and their standard errors over repeats, each with its own object."""
    rng = np.random.default_rng(seed)
    errors, std, dof = [], [], []
    for _ in range(repeats):
        lab.machine(rng)
        found = lab.solve(lab.points(rng))
        errors.append(lab.errors(found))
        std.append(bounds(found))
        dof.append(found.poses[0].dof)
    return np.array(errors), np.array(std), np.array(dof)


def cramer_rao(lab):
    """Standard errors that no unbiased estimate of the pose can beat, for edges of known noise."""
    points, (rotation, origin) = lab.points(None)[0], lab.truth("a")
    none = np.zeros((len(lab.target.circles), 4))
    scene = EdgeScene(rotation, origin, 0.0, nominal_intrinsics(lab.nominal), none)
    jacobian = residuals(points, scene)[1] / spread(points, scene)[:, None]
    jacobian = np.delete(jacobian, range(7, 12), axis=1)
    unit = lab.target.unit.value * std_of_bound(lab.target.accuracy)
    prior = np.append(np.zeros(7), np.tile(unit * np.array([1, 1, 1, 0.5]), none.shape[0]) ** -2.0)
    return np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian + np.diag(prior))))[:6]


def check_figures(bound, errors, std, dof):
    """Spread, bias and coverage as they should be, within four standard errors of each figure."""
    count = len(errors)
    np.testing.assert_allclose(errors.std(axis=0) / bound, 1.0, atol=4 / np.sqrt(2 * count))
    np.testing.assert_allclose(np.sqrt(np.mean(std**2, axis=0)) / bound, 1.0, atol=0.02)
    assert (np.abs(errors.mean(axis=0)) < 4 * bound / np.sqrt(count)).all()
    cover = np.mean(np.abs(errors) <= student_factor(0.95, dof)[:, None] * std, axis=0)
    np.testing.assert_allclose(cover, 0.95, atol=4 * np.sqrt(0.95 * 0.05 / count))
    return cover


@pytest.mark.whole
@pytest.mark.parametrize(
    "accuracy",
    [pytest.param(1e-9, id="exact circles", marks=pytest.mark.long),
     pytest.param(0.00005, id="machined circles")],
)  # fmt: skip
def test_spread_bias_and_coverage_are_as_they_should_be(edge_lab, make_circles, accuracy):
    lab = edge_lab(target=make_circles(accuracy))
    check_figures(cramer_rao(lab), *repeated(lab, REPEATS, seed=20))


@pytest.mark.long
@pytest.mark.parametrize("std", [0.007, 0.02])
def test_many_repeats_reach_the_cramer_rao_bound(edge_lab, std):
    lab = edge_lab(std=std)
    bound = cramer_rao(lab)
    errors, reported, dof = repeated(lab, MANY, seed=21)
    cover = check_figures(bound, errors, reported, dof)
    assert (errors.std(axis=0) / bound <= 1.1).all()
    assert ((cover > 0.93) & (cover < 0.97)).all()


def test_a_second_plane_makes_bounds_smaller_and_the_offset_determinable(edge_lab, make_circles):
    def of(planes):
        lab = edge_lab(target=make_circles(0.0, planes))
        return bounds(lab.solve(lab.points(None), {"mirror_offset": INF}))

    one, two = of(1), of(2)
    # Twice the edges alone would give the root of two.
    assert (two < one / np.sqrt(2)).all()
    assert two[6] < one[6] / 5


def test_machining_errors_widen_the_bounds(edge_lab, exact):
    wide = edge_lab()
    found, real = exact.solve(exact.points(None)), wide.solve(wide.points(None))
    assert (bounds(real) > 2.5 * bounds(found)).all()


def test_a_rim_is_found_and_does_not_move_the_pose(exact):
    points = exact.points(None)[0]
    found = exact.solve([replace(points, radius=points.radius - 2e-5)])
    assert found.poses[0].rim == pytest.approx(2e-5, rel=1e-6)
    np.testing.assert_allclose(exact.errors(found), 0, atol=1e-9)


def test_one_circle_does_not_determine_a_pose(exact):
    points = exact.points(None)[0]
    one = EdgePoints(**{n: getattr(points, n)[:44] for n in EdgePoints.__dataclass_fields__})
    with pytest.raises(UserError, match="view a: the edges do not determine the pose"):
        exact.solve([one])


def test_few_edges_are_refused(exact):
    points = exact.points(None)[0]
    few = EdgePoints(**{n: getattr(points, n)[::30] for n in EdgePoints.__dataclass_fields__})
    with pytest.raises(UserError, match="view a: 6 edges are too few"):
        exact.solve([few])


def test_gains_and_zeros_are_found_besides_the_offset(edge_lab, make_circles):
    errors = MirrorErrors(0.012, MirrorError(gain=0.01), MirrorError(gain=-0.005, zero=0.004))
    lab = edge_lab(target=make_circles(0.0, planes=2), mirrors=errors)
    names = ["mirror_offset", "gain_up_down", "gain_left_right", "zero_left_right"]
    found = lab.solve(lab.points(None), dict.fromkeys(names, INF))
    np.testing.assert_allclose(found.poses[0].intrinsics, [0.042, 1.01, 0, 0.995, 0.004], atol=1e-9)
    np.testing.assert_allclose(lab.errors(found), 0, atol=1e-9)


def test_the_zero_of_the_up_down_mirror_is_a_rotation(exact):
    points = exact.points(None)
    with pytest.raises(UserError, match="view a: the edges cannot tell zero_up_down from a motion"):
        exact.solve(points, {"zero_up_down": INF})
    noisy = exact.points(np.random.default_rng(4))
    assumed = exact.solve(noisy, {"zero_up_down": 0.002})
    assert bounds(assumed)[6] == pytest.approx(0.002)
    assert bounds(assumed)[0] > 0.0019


def test_what_is_barely_determined_is_noted(edge_lab, make_circles):
    def notes(planes, **adjust):
        lab = edge_lab(target=make_circles(planes=planes))
        tree = lab.tree(np.random.default_rng(3))
        return Edge(adjust=adjust).estimate(lab.laser, lab.target, tree).pose.attrs["notes"]

    barely = notes(1, mirror_offset=INF)
    assert "view a: this data barely determines mirror_offset: 0.03" in barely
    assert "so that 0.03 is as good" in barely
    assert notes(2, mirror_offset=INF) == ""
    assert "mirror_offset is what was assumed of it beforehand" in notes(1, mirror_offset=1e-5)
