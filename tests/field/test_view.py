"""Views: what makes one, and how they come from the groups of a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.field import View
from sldvexp.field.visibility.view import views_of
from sldvexp.geometry import rotation_from_vector
from sldvexp.laser import TwoMirror
from sldvexp.pose import pose_to_dataset

ROTATION = rotation_from_vector([0.3, 0.1, 0.2])


def view() -> View:
    dac = np.stack(np.meshgrid([0.0, 5.0, 10.0], [0.0, 4.0], indexing="ij"), axis=-1)
    velocity, std = np.ones((6, 2), complex), np.full(6, 1e-5)
    flags = np.array([0, 0, 0, 0, 2, 0], np.uint8)
    return View("left", ROTATION, np.zeros(3), None, dac.reshape(-1, 2), velocity, std, flags,
                (3, 2))  # fmt: skip


def changed(array: np.ndarray, index: object, value: float) -> np.ndarray:
    array = array.copy()
    array[index] = value
    return array


def test_flagged_pixels_may_be_unknown() -> None:
    at = view()
    at = replace(at, velocity=changed(at.velocity, 4, np.nan), std=changed(at.std, 4, np.inf))
    assert at.usable.tolist() == [True, True, True, True, False, True]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda v: {"rotation": -v.rotation}, "not a proper rotation matrix"),
        (lambda v: {"rotation": 1.001 * v.rotation}, "not a proper rotation matrix"),
        (lambda v: {"origin": np.zeros(2)}, r"an origin of shape \(3,\), not \(3, 3\) and \(2,\)"),
        (lambda v: {"origin": np.full(3, np.nan)}, "not three finite numbers"),
        (lambda v: {"covariance": np.eye(5)}, r"must be \(6, 6\), not \(5, 5\)"),
        (lambda v: {"std": v.std[:-1]}, "of as many pixels"),
        (lambda v: {"flags": v.flags[:-1]}, "of as many pixels"),
        (lambda v: {"velocity": v.velocity[:, 0]}, "of as many pixels"),
        (lambda v: {"shape": (2, 2)}, "2 rows and 2 columns has 4 pixels, but there are 6"),
        (lambda v: {"dac": changed(v.dac, (3, 1), np.nan)}, "the DAC step of pixel 3"),
        (lambda v: {"velocity": changed(v.velocity, (5, 1), np.nan)}, "pixel 5 has no finite"),
        (lambda v: {"std": changed(v.std, 1, np.inf)}, "pixel 1 has no finite velocity"),
        (lambda v: {"std": changed(v.std, 1, -1.0)}, "pixel 1 has no finite velocity"),
    ],
)
def test_bad_views(change: Callable[[View], dict[str, object]], message: str) -> None:
    at = view()
    with pytest.raises(UserError, match=f"view left: .*{message}"):
        replace(at, **change(at))


def image(frequency: list[float], scale: float = 1.0) -> xr.Dataset:
    at = view()
    group = dataset.group(
        "image",
        {"pixel": np.arange(6), "frequency": frequency},
        velocity=scale * at.velocity[:, : len(frequency)],
        velocity_std=np.full((6, len(frequency)), 1e-5),
        dac=at.dac.astype(int),
        flags=at.flags,
    )
    group.attrs["shape"] = [3, 2]
    return group


def run(names: tuple[str, ...] = ("a", "b")) -> dict[str, xr.Dataset]:
    """Groups of a run; the pose of the second view has no covariance."""
    covariance = np.stack([np.diag(np.arange(1.0, 7.0)), np.full((6, 6), np.nan)])
    pose = pose_to_dataset(
        ["b", "a"], [ROTATION, ROTATION.T], [[1.0, 2, 3], [4, 5, 6]], covariance, [20.0, 20.0], 0.95
    )
    return {"pose": pose} | {f"image/{n}": image([200.0, 300.0], k) for k, n in enumerate(names)}


def test_views_of_a_run() -> None:
    b, a = views_of(run(), TwoMirror())
    assert (b.name, a.name) == ("b", "a")
    np.testing.assert_allclose(b.rotation, ROTATION)
    np.testing.assert_allclose(a.origin, [4, 5, 6])
    np.testing.assert_allclose(b.covariance, np.diag(np.arange(1.0, 7.0)))
    assert a.covariance is None
    assert b.shape == (3, 2)
    np.testing.assert_array_equal(b.velocity, np.ones((6, 2)))
    np.testing.assert_array_equal(b.dac, view().dac)
    assert not a.velocity.any()
    assert [v.name for v in views_of(run(("a",)), TwoMirror())] == ["a"]


def test_images_of_views_whose_pose_was_not_found_are_left_out() -> None:
    tree = run()
    pose = tree["pose"].sel(view=["b"]).assign_attrs(without_pose='["a"]')
    (b,) = views_of(tree | {"pose": pose}, TwoMirror())
    assert b.name == "b"
    with pytest.raises(UserError, match="of a no pose was found, so that no image is left"):
        views_of({"pose": pose, "image/a": tree["image/a"]}, TwoMirror())


def test_scattered_image_of_one_frequency() -> None:
    tree = run(("a",))
    one = tree["image/a"].isel(frequency=0, drop=True)
    del one.attrs["shape"]
    (a,) = views_of(tree | {"image/a": one}, TwoMirror())
    assert a.shape is None
    assert a.velocity.shape == (6, 1)
    assert a.std.shape == (6,)


def _in_mm(tree: dict[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    other = tree["image/b"].copy()
    other["velocity"] = other["velocity"].assign_attrs(units="mm/s")
    return tree | {"image/b": other}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: {"pose": t["pose"]}, "there are no velocity images"),
        (lambda t: {"image/a": t["image/a"]}, "the images of a have no poses; choose a pose"),
        (lambda t: t | {"image/c": t["image/a"]}, "view c: has an image but no pose; Valid: a, b"),
        (
            lambda t: t | {"image/b": image([200.0, 301.0])},
            r"view b: its frequencies \(200, 301 Hz, 2 in all\) are not those of view a \(200, 300",
        ),
        (lambda t: t | {"image/b": image([200.0])}, r"view b: its frequencies \(200 Hz, 1 in all"),
        (_in_mm, "view b: its velocities are in mm/s; they must be in m/s"),
    ],
)
def test_runs_without_views(
    change: Callable[[dict[str, xr.Dataset]], dict[str, xr.Dataset]], message: str
) -> None:
    with pytest.raises(UserError, match=message):
        views_of(change(run()), TwoMirror())
