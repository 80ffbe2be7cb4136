"""The closed form of stands against analytic limits."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.config.planning import PlanCriterion
from sldvexp.planner.criterion import PRIOR, Goal, covariance_of, directions_wanted, variances

FRAME = np.eye(3)[None]
CRITERIA = (PlanCriterion.worst, PlanCriterion.mean)
#: Relative, of the prior: its share of information that is at least 0.5 along every axis.
SMALL = 2 / PRIOR


def cone(count: int, t: float) -> np.ndarray:
    """Lay stands evenly on a cone of half-angle t around z, (stand, 1, 3)."""
    turn = 2 * np.pi * np.arange(count) / count + 0.3
    d = [np.sin(t) * np.cos(turn), np.sin(t) * np.sin(turn), np.full(count, np.cos(t))]
    return np.stack(d, axis=-1)[:, None]


def goal_of(of: str | list[float], criterion: PlanCriterion = PlanCriterion.mean) -> Goal:
    return Goal.evenly(directions_wanted(of, FRAME), criterion)


@pytest.mark.parametrize("count", range(3, 9))
@pytest.mark.parametrize("degrees", [30, 45, 60])
def test_stands_on_a_cone_have_the_bounds_of_theory(count, degrees):
    t = np.radians(degrees)
    found = np.sqrt(np.diagonal(covariance_of(cone(count, t))[0]))
    along, across = np.sqrt(2 / count) / np.sin(t), 1 / (np.sqrt(count) * np.cos(t))
    np.testing.assert_allclose(found, [along, along, across], rtol=4 / PRIOR)
    np.testing.assert_array_less(found, [along, along, across])  # a prior knows something


@pytest.mark.one_in(6)
@pytest.mark.parametrize("count", range(3, 9))
def test_the_mean_of_a_cone_is_smallest_where_the_squared_tangent_is_two(count):
    goal = goal_of("all")
    angles = np.radians(np.linspace(30, 75, 4501))
    values = [goal.of(covariance_of(cone(count, t))) for t in angles]
    best = angles[np.argmin(values)]
    assert np.tan(best) ** 2 == pytest.approx(2, abs=0.01)
    assert min(values) == pytest.approx(np.sqrt(3 / count), rel=SMALL)


def test_one_more_stand_changes_bounds_as_its_information_does():
    rng = np.random.default_rng(2)
    looks = rng.standard_normal((9, 4, 3))
    looks /= np.linalg.norm(looks, axis=-1, keepdims=True)
    looks[7, 2] = 0  # this stand does not see that node
    for criterion in CRITERIA:
        goal = Goal.evenly(np.broadcast_to(np.eye(3), (4, 3, 3)), criterion)
        goal = goal.with_factor(np.array([1, 2, 0.5, 1]))
        fast = goal.with_one_more(covariance_of(looks[:5]), looks[5:])
        slow = [goal.of(covariance_of(looks[[0, 1, 2, 3, 4, k]])) for k in range(5, 9)]
        np.testing.assert_allclose(fast, slow, rtol=1e-10)


def test_the_worst_is_the_largest_of_all_nodes_and_directions():
    variance = np.array([[1.0, 4.0], [9.0, 1.0]])
    factor = np.array([2.0, 1.0])
    wanted = np.zeros((2, 2, 3))
    worst, mean = (Goal.evenly(wanted, each).with_factor(factor) for each in CRITERIA)
    assert worst.value(variance) == 4.0
    assert mean.value(variance) == pytest.approx(np.sqrt((4 + 16 + 9 + 1) / 4))


@pytest.mark.parametrize(
    ("of", "expected"),
    [
        ("all", np.eye(3)),
        ("y", [[0, 1, 0]]),
        ("in_plane", [[0, 1, 0], [0, 0, 1]]),
        ("n", [[1, 0, 0]]),
        ([0, 3, 4], [[0, 0.6, 0.8]]),
    ],
)
def test_directions_are_of_the_world_or_of_the_surface(of, expected):
    turned = np.array([[[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]])
    np.testing.assert_allclose(directions_wanted(of, turned)[0], expected)


def test_a_direction_that_no_stand_sees_keeps_the_prior():
    looks = np.broadcast_to([[0.0, 0, 1]], (3, 1, 3))
    found = variances(covariance_of(looks), np.eye(3)[None])[0]
    np.testing.assert_allclose(found, [PRIOR, PRIOR, 1 / (3 + 1 / PRIOR)])
