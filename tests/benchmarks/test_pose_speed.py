"""Poses with bounds against OpenCV's iterative `solvePnP` on the same 16 points.

Figures are asserted at full size only, with ``SLDVEXP_BENCHMARK=1``; otherwise one small run checks
that both find the same pose.
"""

from __future__ import annotations

import os
import statistics
import time
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from sldvexp.geometry import rotation_from_vector
from sldvexp.laser import project
from sldvexp.pose import solve_points

FULL_SIZE = os.environ.get("SLDVEXP_BENCHMARK") == "1"
BATCH, RUNS, BATCH_RUNS = (1000, 200, 10) if FULL_SIZE else (3, 1, 1)
COLD_START_RATIO = 30.0
BATCH_RATIO = 3.0
STEP = np.full(2, np.radians(25) / 4096)
ROTATION = rotation_from_vector([0.5, 0.1, 0.3]) @ np.diag([1.0, -1.0, -1.0])
IN_FRONT = np.array([0.05, 0.1, 1.7])


def points(shape: str) -> np.ndarray:
    """16 points over a quarter of a metre, on one plane or on two, 80 mm apart."""
    xyz = np.random.default_rng(16).uniform(-0.13, 0.13, (16, 3))
    xyz[:, 2] = 0.0 if shape == "plane" else np.where(np.arange(16) % 2, 0.08, 0.0)
    return xyz


def angles(xyz: np.ndarray) -> np.ndarray:
    """Mirror angles of a batch of poses, with a DAC step of noise; the mirrors have no offset."""
    noise = np.random.default_rng(1).normal(size=(BATCH, 16, 2)) * STEP
    return project(xyz @ ROTATION.T + IN_FRONT) + noise


def solve_pnp(
    xyz: np.ndarray, angle: np.ndarray
) -> Callable[[], tuple[bool, np.ndarray, np.ndarray]]:
    """OpenCV's solution of one pose; a laser without mirror offset is a pinhole camera."""
    up_down, left_right = angle.T
    image = np.column_stack([np.tan(left_right) / np.cos(up_down), np.tan(up_down)])
    return lambda: cv2.solvePnP(xyz, image, np.eye(3), None, flags=cv2.SOLVEPNP_ITERATIVE)


def seconds(runs: int, *work: Callable[[], object]) -> list[float]:
    """Median time of each work, run in turns so that disturbances meet all alike."""
    times: list[list[float]] = [[] for _ in work]
    for _ in range(runs):
        for function, record in zip(work, times, strict=True):
            start = time.perf_counter()
            function()
            record.append(time.perf_counter() - start)
    return [statistics.median(record) for record in times]


@pytest.mark.parametrize("shape", ["plane", "two planes"])
def test_agrees_with_solve_pnp(shape: str) -> None:
    xyz = points(shape)
    exact = project(xyz @ ROTATION.T + IN_FRONT)
    _, vector, translation = solve_pnp(xyz, exact)()
    found = solve_points(xyz, exact, step=STEP)
    np.testing.assert_allclose(found.rotation, cv2.Rodrigues(vector)[0], atol=1e-6)
    np.testing.assert_allclose(-found.rotation @ found.origin, translation[:, 0], atol=1e-6)


@pytest.mark.parametrize("shape", ["plane", "two planes"])
def test_one_pose_from_a_cold_start(shape: str) -> None:
    xyz = points(shape)
    angle = angles(xyz)[0]
    ours, theirs = seconds(RUNS, lambda: solve_points(xyz, angle, step=STEP), solve_pnp(xyz, angle))
    print(f"one pose, {shape}: {ours * 1e6:.0f} us, {ours / theirs:.1f} x solvePnP")
    if FULL_SIZE:
        assert ours <= COLD_START_RATIO * theirs


@pytest.mark.parametrize("shape", ["plane", "two planes"])
def test_a_batch_of_poses(shape: str) -> None:
    xyz = points(shape)
    angle = angles(xyz)
    one = solve_pnp(xyz, angle[0])
    ours, theirs = seconds(BATCH_RUNS, lambda: solve_points(xyz, angle, step=STEP), one)
    print(f"a pose of {BATCH}, {shape}: {ours / BATCH * 1e6:.0f} us, {ours / BATCH / theirs:.2f} x")
    if FULL_SIZE:
        assert ours / BATCH <= BATCH_RATIO * theirs
