"""The budget of a field's uncertainty: parts add up, and their sum is what errors really are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sldvexp.field import FieldResult, View
from sldvexp.field.bounds.budget import OF_SEVERAL_LINES, SOURCES, by_source, not_included
from sldvexp.field.estimate import estimate_field
from sldvexp.field.visibility.projection import to_laser
from sldvexp.image import Interpolation
from sldvexp.laser import TwoMirror, direction_cosines
from sldvexp.reconstruction import Absolute, Contravariant
from sldvexp.volume import Grid, VisibilitySettings

Make = Callable[..., Any]
#: Wave number of the field along x and y, 1/m, and its size out of the plane, m/s.
WAVES, SIZE = (18.0, 9.0), 0.01
NOISE = 1.5e-4


def plate(interpolation: Interpolation, shape: tuple[int, int] = (16, 16)) -> Grid:
    sight = VisibilitySettings(interpolation=interpolation)
    return Grid(size=[0.28, 0.28], shape=list(shape), layers=2, thickness=0.004, sight=sight)


def truth(points: np.ndarray) -> np.ndarray:
    """Velocity of a thin plate that bends, shape (point, 3), m/s; a wave at some phase."""
    (k, m), (x, y, z) = WAVES, points.T
    w = SIZE * np.cos(k * x + 0.4) * np.cos(m * y)
    by_x = -SIZE * k * np.sin(k * x + 0.4) * np.cos(m * y)
    by_y = -SIZE * m * np.cos(k * x + 0.4) * np.sin(m * y)
    return np.stack([-z * by_x, -z * by_y, w], axis=1)


def images(views: list[View], laser: TwoMirror) -> list[View]:
    """What the views see of the plate's middle, without noise."""
    found = []
    for view in views:
        angle = laser.angle_from_dac(view.dac)
        along = -direction_cosines(angle) @ view.rotation
        start = np.zeros_like(along)
        start[:, 0] = laser.mirror_offset * np.tan(angle[:, 1])
        start = view.origin + start @ view.rotation
        points = start - along * (start[:, 2] / along[:, 2])[:, None]
        assert np.allclose(laser.dac_from_angle(angle), view.dac)
        assert (to_laser(view, points)[:, 2] > 0).all()
        found.append(replace(view, velocity=np.einsum("pi,pi->p", truth(points), -along)[:, None]))
    return found


def noisy(views: list[View], columns: int, rng: np.random.Generator) -> list[View]:
    """Every frequency another draw of the same image's noise."""
    noise = [rng.normal(size=(len(v.dac), columns, 2)) @ [1, 1j] * NOISE for v in views]
    return [
        replace(v, velocity=(1 + 0.5j) * v.velocity + n, std=np.full(len(v.dac), NOISE))
        for v, n in zip(views, noise, strict=True)
    ]


def squares(result: FieldResult, position: np.ndarray) -> np.ndarray:
    """Mean squares of errors of each part, shape (part, component)."""
    error = result.velocity - (1 + 0.5j) * truth(position)[..., None]
    return np.square(np.stack([error.real, error.imag])).mean(axis=(1, 3))


@pytest.mark.one_in(2)
@pytest.mark.parametrize("method", [Absolute(), Contravariant(rows="all")])
def test_parts_add_up_to_the_bound(make_views: Make, laser: TwoMirror, method: Any) -> None:
    pose = np.diag(np.square([3e-5] * 3 + [1e-4] * 3))
    views = noisy(
        images(make_views(5, pixels=20, covariance=pose), laser), 2, rng=np.random.default_rng(1)
    )
    result = estimate_field(
        views, laser, plate(Interpolation.auto, (7, 6)), method, frequency=[1, 2]
    )
    sources, variances = by_source(result.variance)
    assert sources == [name for name in SOURCES if name not in ("pointing", "calibration")]
    np.testing.assert_allclose(variances.sum(axis=0), result.std**2, rtol=1e-12)
    group = result.to_dataset()
    assert list(group["source"].values) == sources
    added = group["variance"].sum("source").transpose(*group["velocity_std"].dims)
    np.testing.assert_allclose(added, group["velocity_std"] ** 2, rtol=1e-12)
    assert (variances >= 0).all()


def test_harmonics_are_named_where_they_can_fall_on_another_line() -> None:
    """Of one line nothing is in its own way."""
    one, two = ({"noise": np.ones((2, 5, 3, lines))} for lines in (1, 2))
    assert OF_SEVERAL_LINES not in not_included(one)
    assert not_included(two) == [*not_included(one), OF_SEVERAL_LINES]


@pytest.mark.whole
@pytest.mark.parametrize("interpolation", ["linear", "cubic"])
@pytest.mark.parametrize(
    ("draws", "off"), [(50, 0.05), pytest.param(1000, 0.03, marks=pytest.mark.long)]
)
def test_sum_is_the_error_of_draws(
    make_views: Make, laser: TwoMirror, interpolation: str, draws: int, off: float
) -> None:
    """Noise, elements and interpolation together, of which the latter two may cancel."""
    exact = images(make_views(5, pixels=30), laser)
    volume, rng = plate(Interpolation(interpolation)), np.random.default_rng(2)
    stated, found = [], []
    for _ in range(draws // 50):  # a frequency is a draw
        views = noisy(exact, 50, rng)
        result = estimate_field(views, laser, volume, Absolute(), frequency=np.arange(50))
        stated.append(np.mean(result.std_by_part**2, axis=(1, 3)))
        found.append(squares(result, volume.prisms().position))
    ratio = np.sqrt(np.mean(found, axis=0) / np.mean(stated, axis=0))
    np.testing.assert_allclose(ratio, 1.0, atol=off)


@pytest.mark.whole
def test_pointing_noise_moves_the_field_as_stated(make_views: Make, laser: TwoMirror) -> None:
    """Pixels beside where they are said to be: what that does to nodal values, over 40 draws."""
    step, draws, rng = 8.0, 40, np.random.default_rng(3)
    views, volume = make_views(4, pixels=20), plate(Interpolation.cubic, (7, 7))
    quiet = [replace(v, std=np.full(len(v.dac), 1e-9)) for v in images(views, laser)]
    beside = [
        [
            replace(v, dac=v.dac + rng.normal(scale=step, size=v.dac.shape), shape=None)
            for _ in range(draws)
        ]
        for v in views
    ]
    seen = [np.hstack([images([b], laser)[0].velocity for b in each]) for each in beside]
    moved = [replace(v, velocity=s) for v, s in zip(quiet, seen, strict=True)]
    known = replace(laser, pointing_std=step)
    still = estimate_field(quiet, known, volume, Absolute())
    assert list(still.variance) == ["noise", "pointing", "interpolation", "elements"]
    off = estimate_field(moved, laser, volume, Absolute()).velocity - still.velocity
    found = np.sqrt(np.mean(off.real**2, axis=(0, 2)))
    stated = np.sqrt(still.variance["pointing"][0].mean(axis=0))[:, 0]
    np.testing.assert_allclose(stated, found, rtol=0.15)
    assert not still.variance["pointing"][1].any()  # nothing moves in the imaginary part
    by_pose = estimate_field(
        [replace(v, pointing_std=step) for v in quiet], laser, volume, Absolute()
    )
    np.testing.assert_array_equal(by_pose.variance["pointing"], still.variance["pointing"])


@pytest.mark.whole
def test_a_stated_zero_of_all_mirrors_is_a_rotation_of_all_views(
    make_views: Make, laser: TwoMirror
) -> None:
    """Points turned about the up-down mirror's axis are seen at other angles by as much."""
    std, volume = 1e-4, plate(Interpolation.cubic, (7, 7))
    shared = np.zeros((4, 6, 4, 6))
    shared[:, 0, :, 0] = std**2
    views = images(make_views(4, pixels=20), laser)
    by_pose = estimate_field(
        views, laser, volume, Absolute(), covariance=shared.reshape(24, 24)
    ).variance["pose"]
    mirror = replace(laser.up_down, zero_std=np.degrees(std))
    known = replace(laser, up_down=mirror)
    found = estimate_field(views, known, volume, Absolute()).variance["calibration"]
    np.testing.assert_allclose(found, by_pose, rtol=0.01, atol=1e-3 * by_pose.max())
    # As a coefficient of the polynomial it is another error, and both add up.
    bent = replace(mirror, polynomial=[0.0], polynomial_std=[0.1])
    both = estimate_field(views, replace(laser, up_down=bent), volume, Absolute())
    more = both.variance["calibration"]
    assert np.all(more >= found * (1 - 1e-9))
    assert more.max() > 1.01 * found.max()
