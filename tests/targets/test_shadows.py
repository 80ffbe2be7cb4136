"""Circles at several depths hide one another as the virtual lab's washers do."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.geometry import KnownPose
from sldvexp.laser import project, rays
from sldvexp.targets import Circle, Circles, Plane, shaded_circles
from sldvexp.targets.shadows import REST, SPAN, Discs, hidden_behind_circles, shade_told, shaded

PLANES = {"front": Plane(), "raised": Plane(origin=[0, 0, 0.1])}
#: The raised circle stands between the first one and an instrument on the right.
STEP = Circles(
    circles={
        1: Circle(0.03, 0.03, 0.04),
        2: Circle(0.14, 0.03, 0.04, "raised"),
        3: Circle(0.15, 0.225, 0.04),
        4: Circle(0.03, 0.215, 0.04),
    },
    planes=PLANES,
)
RIGHT, FRONT = np.array([1.62, 0.11, 1.49]), np.array([0.1, 0.1, 2.0])


def met_first(origin, points, target):
    """Circle whose disc a beam meets first, by following it step by step, -1 for none."""
    part = np.linspace(0.8, 1.02, 22001)[:, None]
    found = []
    for point in points:
        way = origin + part * (point - origin)
        first, which = np.inf, -1
        for k, circle in enumerate(target.circles.values()):
            depth = target.planes[circle.plane].origin[2]
            crossing = np.flatnonzero(np.diff(np.sign(way[:, 2] - depth)))
            for i in crossing:
                beside = np.hypot(way[i, 0] - circle.x, way[i, 1] - circle.y)
                if beside <= circle.diameter / 2 + REST and i < first:
                    first, which = i, k
        found.append(which)
    return np.array(found)


def test_a_beam_is_stopped_by_the_circle_that_it_meets_first():
    rng = np.random.default_rng(4)
    points = STEP.outlines().reshape(-1, 3)
    own = np.repeat(np.arange(4), 16)
    some = 0
    for _ in range(6):
        origin = np.array([rng.uniform(-1.5, 1.8), rng.uniform(-0.9, 1.1), rng.uniform(0.8, 1.6)])
        hidden = hidden_behind_circles(origin[None], points, Discs.from_circles(STEP))[0]
        first = met_first(origin, points, STEP)
        np.testing.assert_array_equal(hidden.any(axis=1), first != own)
        some += int(hidden.sum())
    assert some > 0


def test_a_raised_circle_shades_the_one_behind_it_from_one_side_only():
    assert shaded_circles(RIGHT, STEP) == {1: [2]}
    assert shaded_circles(FRONT, STEP) == {}
    assert shade_told(1, [2]).startswith("circle 1 is hidden in part by circle 2")
    both = shaded(np.stack([FRONT, RIGHT]), Discs.from_circles(STEP))
    assert np.argwhere(both).tolist() == [[1, 0, 1]]


def test_a_circle_whose_edge_is_free_may_still_look_too_near_to_another():
    """Its lines go on beyond its edge and meet the hole of the other."""
    raised = Circle(0.192, 0.035, 0.05, "raised")
    near = Circles(circles=STEP.circles | {2: raised}, planes=PLANES)
    assert not hidden_behind_circles(
        RIGHT[None], near.outlines().reshape(-1, 3), Discs.from_circles(near)
    ).any()
    edge = near.outlines()[1]
    ends = edge.mean(axis=0) + SPAN * (edge - edge.mean(axis=0))
    there = RIGHT + RIGHT[2] / (RIGHT[2] - 0.1) * (ends - RIGHT)  # in the plane of the first one
    assert np.hypot(there[:, 0] - 0.03, there[:, 1] - 0.03).min() < 0.02
    assert shaded_circles(RIGHT, near) == {2: [1]}
    farther = Circle(0.2, 0.035, 0.05, "raised")
    assert not shaded_circles(RIGHT, Circles(circles=STEP.circles | {2: farther}, planes=PLANES))


def test_circles_of_one_plane_never_hide_one_another():
    flat = Circles(circles={n: Circle(c.x, c.y, 0.04) for n, c in STEP.circles.items()})
    rng = np.random.default_rng(0)
    origins = rng.uniform([-2, -1, 0.3], [2, 1, 2], (50, 3))
    assert not shaded(origins, Discs.from_circles(flat)).any()


@pytest.mark.parametrize("offset", [0.0, 0.05])
def test_the_offset_of_the_mirrors_moves_a_shadow_by_less_than_what_rests(offset):
    pose = KnownPose(origin=RIGHT.tolist(), look_at=[0.1, 0.1, 0.0])
    point = STEP.outlines()[0]
    angles = project((point - pose.place) @ pose.rotation.T, offset)
    begin, _ = rays(angles, offset)
    moved = np.linalg.norm(begin, axis=1).max() * 0.1 / RIGHT[2]
    assert moved < REST / 5
