"""The pose from edge points: exact model, efficient, honest bounds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sldvexp.errors import UserError
from sldvexp.geometry.rotation import (
    rotation_from_euler,
    rotation_from_vector,
    vector_from_rotation,
)
from sldvexp.laser.model import project
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.pose.edge_model import EdgePoints, angles_along, residuals
from sldvexp.pose.edge_solver import solve_edges
from sldvexp.target.plane import Plane

LASER = TwoMirror(mirror_offset=0.03)
EULER, ORIGIN = [-1.153, 2.547, 1.913], np.array([0.862, 0.508, 1.553])
ROTATION = rotation_from_euler(EULER)
INCH = 0.0254
# Table 4.1: x, y, diameter.
FRONT = [[2.2574, 2.8216, 0.8090], [7.4654, 1.6073, 0.8161],
         [9.4997, 9.7075, 0.8206], [1.5810, 9.5402, 0.8014]]  # fmt: skip
RAISED = Plane(origin=[0.0, 0.0, 4.0], normal=[0.2, 0.1, 1.0])
REPEATS = 300


def edges(planes=("front",), lines=44, std=0.02):
    """Exact edge points of the circles from the pose above, with their scan lines and errors."""
    parts = {name: [] for name in EdgePoints.__dataclass_fields__}
    dacs, directions = [], []
    index = 0
    for plane in (Plane() if p == "front" else RAISED for p in planes):
        axes = plane.axes()
        for x, y, diameter in FRONT:
            t = 2 * np.pi * np.arange(lines) / lines
            center = INCH * (np.array(plane.origin) + x * axes[0] + y * axes[1])
            rim = np.cos(t)[:, None] * axes[0] + np.sin(t)[:, None] * axes[1]
            near, far = (center + INCH * diameter / 2 * f * rim for f in (0.999, 1.001))
            dac = image(center + INCH * diameter / 2 * rim)
            along = image(far) - image(near)
            direction = along / np.linalg.norm(along, axis=-1, keepdims=True)
            angle, step = angles_along(LASER, dac, direction, np.full(lines, std))
            values = {
                "angle": angle,
                "along": step,
                "center": np.tile(center, (lines, 1)),
                "normal": np.tile(axes[2], (lines, 1)),
                "radius": np.full(lines, INCH * diameter / 2),
                "in_plane": np.tile(axes[:2], (lines, 1, 1)),
                "circle": np.full(lines, index),
            }
            for name, value in values.items():
                parts[name].append(value)
            dacs.append(dac)
            directions.append(direction)
            index += 1
    points = EdgePoints(**{n: np.concatenate(v) for n, v in parts.items()})
    return points, np.concatenate(dacs), np.concatenate(directions)


def image(points):
    """DAC steps, not rounded, that reach points of the world."""
    angle = project((points - ORIGIN) @ ROTATION.T, LASER.mirror_offset)
    return LASER.dac_from_angle(angle)


def solve(points, offset_std=0.0, circle_std=0.0):
    """From a start some millimetres and milliradians away."""
    start = rotation_from_vector([2e-3, -3e-3, 1e-3]) @ ROTATION
    return solve_edges(points, start, ORIGIN + np.array([2e-3, 1e-3, -3e-3]), LASER.mirror_offset,
                       offset_std, circle_std, 50, "view front")  # fmt: skip


def test_exact_edges_give_the_exact_pose():
    found = solve(edges()[0])
    np.testing.assert_allclose(found.rotation, ROTATION, atol=1e-10)
    np.testing.assert_allclose(found.origin, ORIGIN, atol=1e-10)
    assert abs(found.rim) < 1e-11


@settings(max_examples=15, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**32 - 1))
def test_derivatives_equal_differences(seed):
    rng = np.random.default_rng(seed)
    points = edges(("front", "raised"), lines=5)[0]
    rotation = rotation_from_vector(1e-6 * rng.normal(size=3)) @ ROTATION
    origin, moved, rim = ORIGIN + 1e-6 * rng.normal(size=3), 1e-7 * rng.normal(size=(8, 4)), 1e-7

    def at(change):
        return residuals(
            points,
            rotation_from_vector(change[:3]) @ rotation,
            origin + change[3:6],
            LASER.mirror_offset + change[6],
            moved + change[8:].reshape(8, 4),
            rim + change[7],
        )

    zero = np.zeros(8 + 32)
    jacobian = at(zero)[1]
    h = 1e-6
    for k in range(len(zero)):
        step = np.zeros_like(zero)
        step[k] = h
        difference = (at(step)[0] - at(-step)[0]) / (2 * h)
        scale = np.abs(jacobian[:, k]).max()
        # The standard errors' own change with the pose is of second order and left out.
        np.testing.assert_allclose(difference, jacobian[:, k], atol=1e-3 * scale)


def repeats(planes=("front",), offset_std=0.0, std=0.02):
    """Errors of the pose over their standard errors, its Cramer-Rao bound, and the coverage."""
    rng = np.random.default_rng(20)
    points, dac, direction = edges(planes, std=std)
    errors, inside, bound = [], [], None
    for _ in range(REPEATS):
        noisy = dac + std * rng.standard_normal(len(dac))[:, None] * direction
        found = solve(replace(points, angle=LASER.angle_from_dac(noisy)), offset_std)
        error = np.hstack(
            [
                vector_from_rotation(found.rotation @ ROTATION.T),
                found.origin - ORIGIN,
                found.mirror_offset - LASER.mirror_offset,
            ]
        )
        reported = np.sqrt(np.diag(found.covariance))[:7]
        bound = reported / found.s if bound is None else bound
        errors.append(error)
        inside.append(np.abs(error) <= 1.974 * reported)  # t of 169 degrees of freedom
    return np.array(errors), bound, np.mean(inside, axis=0)


@pytest.fixture(scope="module")
def one_plane():
    return repeats()


def test_spread_is_that_of_the_cramer_rao_bound(one_plane):
    errors, bound, _ = one_plane
    ratio = errors[:, :6].std(axis=0) / bound[:6]
    # Four standard errors of a standard deviation from so many repeats, about 1.
    np.testing.assert_allclose(ratio, 1.0, atol=4 / np.sqrt(2 * REPEATS))


def test_there_is_no_bias(one_plane):
    errors, bound, _ = one_plane
    assert (np.abs(errors[:, :6].mean(axis=0)) < 4 * bound[:6] / np.sqrt(REPEATS)).all()


def test_intervals_cover_the_truth(one_plane):
    np.testing.assert_allclose(one_plane[2][:6], 0.95, atol=4 * np.sqrt(0.95 * 0.05 / REPEATS))


def test_a_second_plane_makes_bounds_smaller_and_the_offset_determinable():
    def bounds(planes):
        found = solve(edges(planes)[0], offset_std=np.inf)
        return np.sqrt(np.diag(found.covariance)) / found.s

    one, two = bounds(("front",)), bounds(("front", "raised"))
    # Twice the edges alone would give the root of two.
    assert (two[:7] < one[:7] / np.sqrt(2)).all()
    assert two[6] < one[6] / 5


def test_machining_errors_widen_the_bounds():
    points = edges()[0]
    exact, real = solve(points), solve(points, circle_std=2e-6)
    wider = np.diag(real.covariance)[:6] / np.maximum(np.diag(exact.covariance)[:6], 1e-30)
    assert (wider > 1).all()


def test_a_rim_is_found_and_does_not_move_the_pose():
    points = edges()[0]
    found = solve(replace(points, radius=points.radius - 2e-5))
    assert found.rim == pytest.approx(2e-5, rel=1e-6)
    np.testing.assert_allclose(found.origin, ORIGIN, atol=1e-9)


def test_one_circle_does_not_determine_a_pose():
    points = edges()[0]
    one = EdgePoints(**{n: getattr(points, n)[:44] for n in EdgePoints.__dataclass_fields__})
    with pytest.raises(UserError, match="view front: the edges"):
        solve(one, offset_std=np.inf)
