"""A field made of arrays alone, without any configuration, is that of a run to the bit."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import xarray as xr

from sldvexp import dataset, field, reconstruction, volume
from sldvexp.errors import UserError
from sldvexp.image import Interpolation
from sldvexp.laser import Mirror, TwoMirror
from sldvexp.pose import cross_covariance

LASER = TwoMirror(up_down=Mirror(25), left_right=Mirror(25))
PLATE = volume.Grid(
    center=[0.42, 0.14, 0.0],
    size=[0.26, 0.21],
    shape=[3, 3],
    layers=3,
    thickness=0.024,
    sight=volume.VisibilitySettings(interpolation=Interpolation.cubic),
)


def views_of(tree: xr.DataTree) -> list[field.View]:
    """Views from a run's arrays."""
    views = []
    for name in map(str, tree["pose"]["view"].values):
        pose, image = tree["pose"].to_dataset().sel(view=name), tree[f"image/{name}"].to_dataset()
        views.append(
            field.View.from_arrays(
                name,
                pose["rotation"].values,
                pose["origin"].values,
                image["velocity"].values,
                image["velocity_std"].values,
                dac=image["dac"].values,
                covariance=pose["covariance"].values,
                flags=image["flags"].values,
                shape=tuple(map(int, image.attrs["shape"])),
                pointing_std=float(pose["pointing_std"]),
            )
        )
    return views


@pytest.mark.whole
def test_arrays_give_the_field_of_a_run(sldvexp: Callable[..., Any], tmp_path: Any) -> None:
    small = ("scan.structure.pixels=[9,11]", "volume.shape=[3,3]", "volume.layers=3", "check={}")
    run = sldvexp("experiment=plate", "expect={}", *small).tree
    method, names = (
        reconstruction.Contravariant(rows="all"),
        list(map(str, run["pose"]["view"].values)),
    )
    joint = cross_covariance(run["pose"].to_dataset(), names).reshape(30, 30)
    assert np.abs(joint[:6, 6:]).max() > 0  # errors that poses share
    known = {"frequency": [197.0], "covariance": joint}
    result = field.estimate_field(views_of(run), LASER, PLATE, method, **known)
    dataset.save({"field": result.to_dataset()}, {}, tmp_path / "field.nc")
    with dataset.load(tmp_path / "field.nc") as saved:
        made = saved["field"].to_dataset().load()
    assert made["velocity"].shape == (27, 3, 1)
    # Nodes at the rim whose pixels lie beside the plate, at rest, have no value.
    valued = np.isfinite(made["velocity"]).all(dim="component").values
    assert valued.sum() == 24
    np.testing.assert_array_equal(
        np.isfinite(made["velocity_std_pose"]).all(dim="component").values, valued
    )
    xr.testing.assert_identical(made, run["compare/samplewise"].to_dataset())
    apart = field.estimate_field(views_of(run), LASER, PLATE, method)
    np.testing.assert_array_equal(apart.velocity, result.velocity)
    assert not np.array_equal(apart.std_pose, result.std_pose)
    said = repr(result)
    assert "at 27 nodes and 1 frequency" in said
    assert f"{result.samples} samples of 5 views" in said
    assert f"largest bound {np.nanmax(result.confidence):.3g} m/s (95%)" in said


def pixels(**given: Any) -> field.View:
    angle = np.radians([[0, 0], [0, 5], [5, 0]])
    values = {"velocity": [1e-3j, 2e-3, np.nan], "std": 1e-6, "angle": angle, "laser": LASER}
    return field.View.from_arrays("a", np.eye(3), np.zeros(3), **values | given)


def test_angles_and_steps_say_the_same() -> None:
    view = pixels()
    by_step = pixels(angle=None, laser=None, dac=view.dac)
    np.testing.assert_allclose(LASER.angle_from_dac(by_step.dac)[1], np.radians([0, 5]))
    np.testing.assert_array_equal(by_step.usable, [True, True, False])
    np.testing.assert_array_equal(view.std, np.full(3, 1e-6))


@pytest.mark.parametrize("given", [{"angle": None}, {"laser": None}])
def test_places_of_pixels_are_needed(given: dict[str, Any]) -> None:
    with pytest.raises(UserError, match="view a: where its pixels are is not known; give dac"):
        pixels(**given)


def test_frequencies_are_needed_for_the_dataset_of_several(
    make_views: Callable[..., list[field.View]],
) -> None:
    rng, views = np.random.default_rng(3), []
    for v in make_views(4, frequencies=2):
        noise = rng.normal(size=(*v.velocity.shape, 2)) @ [1e-3, 1e-3j]
        views.append(field.View.from_arrays(v.name, v.rotation, v.origin, noise, v.std, dac=v.dac))
    plate = volume.Grid(size=[0.2, 0.2], shape=[3, 3], layers=2)
    result = field.estimate_field(views, LASER, plate, reconstruction.Absolute())
    assert result.velocity.shape[-1] == 2
    with pytest.raises(UserError, match="has 2 frequencies, but it is not said which"):
        result.to_dataset()
