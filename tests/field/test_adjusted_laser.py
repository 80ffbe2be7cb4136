"""Fields from poses that were solved together with the laser's intrinsics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr

from sldvexp.config.registry import get
from sldvexp.errors import UserError
from sldvexp.field import FieldResult, PoseErrors, View, VolumeVisibility
from sldvexp.field.estimate import solve_field
from sldvexp.field.visibility.view import adjusted, views_of
from sldvexp.image import Interpolation
from sldvexp.laser import Mirror, TwoMirror, project, rays
from sldvexp.pose import (
    JointCovariance,
    PointObservations,
    places,
    pose_to_dataset,
    solve_points_together,
    true_angles,
)
from sldvexp.volume import SampleRule

Make = Callable[..., Any]
OFFSET = "mirror_offset"


def estimate(
    looks: VolumeVisibility, errors: PoseErrors | None = None, **options: Any
) -> FieldResult:
    method, solver = get("reconstruction", "absolute")(), get("solver", "direct")()
    return solve_field(looks, method, solver, errors=errors, **options)


def test_adjusted_laser_has_the_true_angles(laser: TwoMirror) -> None:
    nominal = replace(laser, up_down=Mirror(25, 0.2, [0.3, -0.2]), left_right=Mirror(-24, 0.1))
    intrinsics = np.array([-0.001, 1.02, 0.003, 0.97, -0.002])
    dac = np.random.default_rng(1).uniform(-4000, 4000, (50, 2))
    found = adjusted(nominal, intrinsics, "view 1")
    expected = true_angles(nominal.angle_from_dac(dac), intrinsics)
    np.testing.assert_allclose(found.angle_from_dac(dac), expected, atol=1e-14)
    assert found.mirror_offset == -0.001
    assert nominal.mirror_offset == laser.mirror_offset
    with pytest.raises(UserError, match=r"view 1: the pose was solved with a laser that there is"):
        adjusted(nominal, np.array([0.0, -0.1, 0.0, 0.0, 0.0]), "view 1")


def moving(views: list[View], laser: TwoMirror, rng: np.random.Generator, std: float) -> list[View]:
    """Images of the plane z = 0, each of whose velocities is linear in x and y."""
    found = []
    for view in views:
        start, along = rays(laser.angle_from_dac(view.dac), laser.mirror_offset)
        start, along = start @ view.rotation + view.origin, along @ view.rotation
        place = start - along * (start[:, 2:] / along[:, 2:])
        velocity = -np.einsum("pi,pi->p", along, truth(place)) + 0j
        noise = std * rng.normal(size=(len(velocity), 2)) @ [1, 1j]
        found.append(replace(view, velocity=(velocity + noise)[:, None]))
    return found


def truth(place: np.ndarray) -> np.ndarray:
    """Steep, so that errors of the poses show."""
    x, y = place[..., 0], place[..., 1]
    return np.stack([0.02 + 0.05 * y, 0.05 * x, 0.3 * x - 0.2 * y], axis=-1)


def posed(
    views: list[View], laser: TwoMirror, nominal: TwoMirror, rng: np.random.Generator, std: float
) -> xr.Dataset:
    """The group ``pose`` from marks in front of the instrument, the mirror offset free."""
    marks = rng.uniform(-1, 1, (12, 3)) * [0.3, 0.3, 0.05]
    sights = []
    for view in views:
        angle = project((marks - view.origin) @ view.rotation.T, laser.mirror_offset)
        angle = angle + std * rng.normal(size=angle.shape)
        sights.append(
            PointObservations(view.name, marks, angle, np.full(len(marks), std) / nominal.step[0])
        )
    found = solve_points_together(
        sights,
        step=nominal.step,
        mirror_offset=nominal.mirror_offset,
        shared={OFFSET: np.inf},
        max_iterations=100,
    )
    return found.to_dataset()


def as_image(view: View) -> xr.Dataset:
    image = xr.Dataset(
        {
            "velocity": (("pixel",), view.velocity[:, 0], {"units": "m/s"}),
            "velocity_std": (("pixel",), view.std),
            "dac": (("pixel", "mirror"), view.dac),
            "flags": (("pixel",), view.flags),
        }
    )
    return image.assign_attrs(shape=list(view.shape or ()))


@pytest.mark.long
def test_bounds_hold_with_a_free_mirror_offset(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror
) -> None:
    """Errors over standard errors are normal numbers; with the laser as configured, far larger."""
    sessions, rng, std = 8, np.random.default_rng(11), 1e-5
    nominal, prisms = replace(laser, mirror_offset=0.0), make_plate((3, 3), 3, 0.0004)
    squares, as_configured = np.zeros((2, sessions))
    for k in range(sessions):
        true = moving(make_views(4, pixels=21, std=std), laser, rng, std)
        pose = posed(true, laser, nominal, rng, 1e-4)
        tree = {"pose": pose} | {f"image/{v.name}": as_image(v) for v in true}
        views = views_of(tree, nominal)
        looks = VolumeVisibility(views, nominal, prisms, six_points, Interpolation.cubic)
        errors = PoseErrors.from_dataset(pose, looks.names)
        assert errors is not None
        assert len(errors.pose) == 1
        result = estimate(looks, errors)
        assert result.std_by_part is not None
        there = truth(prisms.position.reshape(-1, 3))
        off = (result.velocity[..., 0].real - there) / result.std_by_part[0, ..., 0]
        squares[k] = np.mean(off**2)
        looks = replace(looks, views=[replace(v, intrinsics=None) for v in views])
        other = estimate(looks, bounds=False).velocity[..., 0].real
        as_configured[k] = np.mean(((other - there) / result.std_by_part[0, ..., 0]) ** 2)
    # Nodes of a session err alike; at worst a session is the square of one normal number.
    assert abs(squares.mean() - 1) < 3.5 * np.sqrt(2 / sessions)
    assert as_configured.mean() > 100


@pytest.mark.whole
@pytest.mark.parametrize("known", ["by view", "together", "shared"])
def test_zero_of_the_up_down_mirror_is_a_rotation_about_its_axis(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror, known: str
) -> None:
    """Known poses with an uncertain zero are those with an uncertain rotation; both may cancel."""
    prisms, rng, std = make_plate((3, 3), 2), np.random.default_rng(2), 1e-7
    views = moving(make_views(4, pixels=9), laser, rng, 0.0)
    own = ["zero_up_down", "gain_up_down"]
    names = [v.name for v in views]

    def variances(zero: float, rotation: float, both: float) -> np.ndarray:
        each = np.zeros((8, 8))
        each[6, 6], each[0, 0], each[0, 6], each[6, 0] = zero, rotation, both, both
        between = np.ones((4, 4)) if known == "shared" else np.eye(4)
        matrix = std**2 * np.einsum("vw,ij->viwj", between, each).reshape(32, 32)
        joint = None if known == "by view" else JointCovariance(names, own, [], matrix)
        if known == "shared":  # the first view's are those of all
            kept = [8 * v + i for v in range(4) for i in range(6)] + [6, 7]
            joint = JointCovariance(names, [], own, matrix[np.ix_(kept, kept)])
        pose = pose_to_dataset(
            names,
            [v.rotation for v in views],
            [v.origin for v in views],
            np.tile(std**2 * each, (4, 1, 1)),
            [np.inf] * 4,
            0.95,
            adjusted=own,
            intrinsic=np.tile([0.0, 1.0], (4, 1)),
            joint=joint,
        )
        intrinsics = np.array([laser.mirror_offset, 1.0, 0.0, 1.0, 0.0])
        intrinsics[places(own)] = pose["intrinsic"].values[0]
        looks = VolumeVisibility(
            [replace(v, intrinsics=intrinsics) for v in views], laser, prisms, six_points
        )
        variance = estimate(looks, PoseErrors.from_dataset(pose, names)).variance
        return np.sqrt(variance["pose"] + variance.get("calibration", 0.0))

    by_rotation = variances(0.0, 1.0, 0.0)
    size = by_rotation.max()
    np.testing.assert_allclose(variances(1.0, 0.0, 0.0), by_rotation, atol=1e-4 * size)
    # A point turned by w is seen at an angle smaller by w, and recorded smaller by the zero.
    doubled, cancelled = (variances(1.0, 1.0, sign) for sign in (1.0, -1.0))
    assert cancelled.max() < 1e-3 * size
    np.testing.assert_allclose(doubled, 2 * by_rotation, atol=1e-3 * size)


def test_unknown_covariance_of_adjusted_poses_is_none(make_views: Make) -> None:
    views = make_views(3)
    pose = pose_to_dataset(
        ["1", "2", "3"],
        [v.rotation for v in views],
        [v.origin for v in views],
        np.full((3, 7, 7), np.nan),
        [np.inf] * 3,
        0.95,
        adjusted=[OFFSET],
        intrinsic=np.zeros((3, 1)),
    )
    assert PoseErrors.from_dataset(pose, ["1", "2", "3"]) is None


def test_the_poses_whole_covariance_has_the_errors_that_go_with_the_intrinsics():
    with_intrinsics = np.array([[[0.1, 0, 0, 0, 0, 0.2], [0, 0.3, 0, 0, 0, 0]]])
    errors = PoseErrors(np.eye(12), with_intrinsics, np.zeros((1, 2, 5)))
    row = with_intrinsics.reshape(12)
    assert errors.whole == pytest.approx(np.eye(12) + np.outer(row, row))
    assert PoseErrors(np.eye(12), np.zeros((0, 2, 6)), np.zeros((0, 2, 5))).whole.shape == (12, 12)
