"""Test of the intercepts: its size with and without errors of the poses, its power, its formula."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import sldvexp.field.equations.system as field_system
from sldvexp.config.registry import get
from sldvexp.field import FieldResult, View, VolumeVisibility
from sldvexp.field.estimate import solve_field
from sldvexp.geometry import rotation_from_vector
from sldvexp.laser import TwoMirror, rays
from sldvexp.reconstruction import Model
from sldvexp.volume import SampleRule

Make = Callable[..., Any]
#: Of a pixel, m/s.
NOISE = 1e-4
#: What poses are known to, rad and m.
POSE_STD = np.repeat([3e-4, 1e-3], 3)
#: Rigid motion of real and imaginary part: velocity at the origin, m/s, and rotation, rad/s. Along
#: a beam it has one line-of-sight velocity at all depths, so that no layer makes an intercept.
MOTION = np.array(
    [[[0.004, 0.003, 0.020], [0.05, 0.04, 0.03]], [[0.002, -0.003, 0.010], [-0.03, 0.02, 0.05]]]
)
LEVEL = 0.05


def seen(view: View, laser: TwoMirror, pose_error: np.ndarray) -> np.ndarray:
    """Velocities of the moving plane z = 0 at a view's pixels, whose pose is off by so much."""
    rotation = rotation_from_vector(pose_error[:3]) @ view.rotation
    start, along = (a @ rotation for a in rays(laser.angle_from_dac(view.dac), laser.mirror_offset))
    start = start + view.origin + pose_error[3:]
    point = start - (start[:, 2] / along[:, 2])[:, None] * along
    parts = [-np.sum(along * (v + np.cross(w, point)), axis=1) for v, w in MOTION]
    return parts[0] + 1j * parts[1]


def drawn(
    views: list[View], laser: TwoMirror, draws: int, pose_std: np.ndarray, rng: np.random.Generator
) -> list[View]:
    """Images of which each frequency is a session: poses and noise of its own."""
    found = []
    for view in views:
        errors = rng.normal(size=(draws, 6)) * pose_std
        velocity = np.stack([seen(view, laser, e) for e in errors], axis=1)
        noise = NOISE * (rng.normal(size=(*velocity.shape, 2)) @ [1, 1j])
        found.append(replace(view, velocity=velocity + noise))
    return found


def full(looks: VolumeVisibility, **options: Any) -> FieldResult:
    method = get("reconstruction", "absolute")(model=Model.full)
    return solve_field(looks, method, get("solver", "iterative")(), **options)


def p_values(looks: VolumeVisibility) -> np.ndarray:
    test = full(looks).intercept_test
    assert test is not None
    return test.p_value


def require_size(p: np.ndarray) -> None:
    """Rejections at 5 % within three standard errors, and p uniform in the mean."""
    draws = len(p)
    assert abs(np.mean(p < LEVEL) - LEVEL) < 3 * np.sqrt(LEVEL * (1 - LEVEL) / draws)
    assert abs(p.mean() - 0.5) < 3 / np.sqrt(12 * draws)


@pytest.mark.whole
@pytest.mark.parametrize("poses", ["exact", "drawn"])
@pytest.mark.parametrize("layers", [1, 3])
def test_a_true_null_is_rejected_as_often_as_stated(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror,
    layers: int, poses: str,
) -> None:  # fmt: skip
    pose_std = POSE_STD * (poses == "drawn")
    views = make_views(5, pixels=20, std=NOISE, covariance=np.diag(pose_std**2))
    views = drawn(views, laser, 200, pose_std, np.random.default_rng(layers))
    prisms = make_plate((4, 4), layers + 1)
    require_size(p_values(VolumeVisibility(views, laser, prisms, six_points)))


@pytest.mark.long
@pytest.mark.parametrize("size", ["small", "large"])
@pytest.mark.parametrize("poses", ["exact", "drawn"])
@pytest.mark.parametrize("layers", [1, 3, 7])
def test_a_true_null_in_full_size(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror,
    monkeypatch: pytest.MonkeyPatch, layers: int, poses: str, size: str,
) -> None:  # fmt: skip
    """All intercepts of small fields, means over the parts of large ones; 20 sessions of 50."""
    if size == "large":
        monkeypatch.setattr(field_system, "SMALL", 0)
    pose_std, rng = POSE_STD * (poses == "drawn"), np.random.default_rng(10 + layers)
    prisms = make_plate((6, 5), layers + 1)
    views = make_views(5, pixels=30, std=NOISE, covariance=np.diag(pose_std**2))
    each = []
    for _ in range(20):
        images = drawn(views, laser, 50, pose_std, rng)
        each.append(p_values(VolumeVisibility(images, laser, prisms, six_points)))
    require_size(np.concatenate(each))


@pytest.mark.long
def test_a_true_null_of_single_frequencies(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror
) -> None:
    """Slopes of one noisy image alone are no reason to reject either."""
    prisms, rng = make_plate((6, 5), 4), np.random.default_rng(3)
    views = make_views(5, pixels=30, std=NOISE, covariance=np.diag(POSE_STD**2))
    each = []
    for _ in range(200):
        images = drawn(views, laser, 1, POSE_STD, rng)
        each.append(p_values(VolumeVisibility(images, laser, prisms, six_points)))
    require_size(np.concatenate(each))


def test_noise_that_is_not_as_stated(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror
) -> None:
    """The residuals tell its size: the test stays the same to rounding."""
    views = make_views(5, pixels=20, std=NOISE, covariance=np.diag(POSE_STD**2))
    views = drawn(views, laser, 4, POSE_STD, np.random.default_rng(5))
    prisms = make_plate((4, 4), 3)
    right = p_values(VolumeVisibility(views, laser, prisms, six_points))
    views = [replace(v, std=v.std / 1.2) for v in views]
    np.testing.assert_allclose(
        p_values(VolumeVisibility(views, laser, prisms, six_points)), right, rtol=1e-6
    )


@pytest.mark.whole
def test_intercepts_and_errors_of_poses_are_told_apart(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror
) -> None:
    """A constant is found, though it is almost a velocity along z; errors of poses if unstated."""
    pose_std, prisms = POSE_STD / 10, make_plate((4, 4), 3)
    views = make_views(5, pixels=20, std=NOISE, covariance=np.diag(pose_std**2))
    views = drawn(views, laser, 20, pose_std, np.random.default_rng(6))
    offset = [replace(v, velocity=v.velocity + 30 * NOISE) for v in views]
    p = p_values(VolumeVisibility(offset, laser, prisms, six_points))
    assert np.mean(p < 1e-3) > 0.9
    views = drawn(views, laser, 20, POSE_STD, np.random.default_rng(7))
    exact = [replace(v, covariance=np.zeros((6, 6))) for v in views]
    p = p_values(VolumeVisibility(exact, laser, prisms, six_points))
    assert np.mean(p < LEVEL) > LEVEL + 3 * np.sqrt(LEVEL * (1 - LEVEL) / 20)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("several", [False, True])
def test_it_is_the_squared_distance_in_the_intercepts_own_covariance(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror, several: bool
) -> None:
    """Images of one pixel each give the matrix from pixels to intercepts."""
    prisms, views, rng = make_plate((3, 3), 3), make_views(5, pixels=9), np.random.default_rng(8)
    std = NOISE * rng.uniform(0.5, 2, (5, 81))
    # Noise of which each view has its own share at each frequency.
    factor = rng.uniform(0.5, 1.5, 5) if several else np.ones(5)
    factor = np.stack([factor, 2 - factor], axis=1)
    unit = np.eye(5 * 81).reshape(5, 81, -1)
    units = [replace(v, velocity=u + 0j, std=s) for v, u, s in zip(views, unit, std, strict=True)]
    alone = full(VolumeVisibility(units, laser, prisms, six_points), bounds=False).intercept
    assert alone is not None
    noise = std[..., None] * np.sqrt(factor)[:, None]
    velocity = noise * (rng.normal(size=(*noise.shape, 2)) @ [1, 1j])
    images = [replace(v, velocity=u, std=s) for v, u, s in zip(views, velocity, noise, strict=True)]
    result = full(VolumeVisibility(images, laser, prisms, six_points))
    test, nodes = result.intercept_test, prisms.nodes
    assert test is not None
    assert result.chi2_ratio is not None
    for f in range(2):
        matrix, beta = alone.real, alone.real @ velocity[..., f].ravel()
        covariance = (matrix * noise[..., f].ravel() ** 2) @ matrix.T
        distance = (beta.conj() @ np.linalg.solve(covariance, beta)).real
        expected = distance / result.chi2_ratio[0, f] / (2 * nodes)
        np.testing.assert_allclose(test.statistic[f], expected, rtol=1e-6)
        assert test.dof[0][f] == 2 * nodes


def test_only_intercepts_that_are_determined_are_tested(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror
) -> None:
    """Where views are lost there is no intercept, and no reason to reject."""
    prisms, rng = make_plate((7, 4), 3), np.random.default_rng(9)
    views = make_views(5, pixels=20, std=NOISE, covariance=np.diag(POSE_STD**2))
    views = drawn(views, laser, 40, POSE_STD, rng)
    for k in (2, 3, 4):
        lost = views[k].dac[:, 1] > views[k].dac[:, 1].mean()
        views[k] = replace(views[k], flags=lost.astype(int))
    result = full(VolumeVisibility(views, laser, prisms, six_points))
    assert result.intercept_test is not None
    assert result.intercept is not None
    known = np.isfinite(result.intercept[:, 0]).sum()
    assert 0.2 * prisms.nodes < known < 0.9 * prisms.nodes
    assert result.intercept_test.dof[0][0] <= 2 * known
    assert np.mean(result.intercept_test.p_value < LEVEL) < LEVEL + 3 * np.sqrt(LEVEL / 40)
