"""Fields solved sample by sample, where flagged pixels leave few or nearly parallel views."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from sldvexp.config.registry import get
from sldvexp.field import View, VolumeVisibility
from sldvexp.field.equations.regions import RegionIterator
from sldvexp.field.equations.sample_model import FieldModel
from sldvexp.field.estimate import solve_field
from sldvexp.laser import TwoMirror, project
from sldvexp.reconstruction import Reconstruction, Weights
from sldvexp.volume import Grid

Make = Callable[..., Any]
NOISE = 3e-5
#: Where the instrument stands before the plate of the default experiment, from its middle, m.
STANDS = np.array(
    [
        [-0.130, 0.390, 1.655],
        [0.479, 0.424, 1.533],
        [0.188, 0.232, 1.656],
        [-0.347, -0.125, 1.680],
        [0.456, -0.104, 1.596],
    ]
)
SAMPLEWISE = {"rows": "all"}


def method_of(name: str, **fields: Any) -> Reconstruction:
    method: Reconstruction = get("reconstruction", name)(**fields)
    return method


def views_of_noise(laser: TwoMirror, shape: tuple[int, int], share: float, seed: int) -> list[View]:
    """Images of noise alone, so that every velocity is an error, without a share of the pixels."""
    rng, found = np.random.default_rng(seed), []
    for k, origin in enumerate(STANDS):
        z = -origin / np.linalg.norm(origin)
        x = np.cross([0.0, 1.0, 0.0], z) / np.linalg.norm(np.cross([0.0, 1.0, 0.0], z))
        rotation = np.stack([x, np.cross(z, x), z])
        corner = np.array([[i, j, m] for i in (-1, 1) for j in (-1, 1) for m in (-1, 1)])
        at = (corner * [0.15, 0.125, 0.0] - origin) @ rotation.T
        dac = laser.dac_from_angle(project(at, laser.mirror_offset))
        axes = [np.linspace(a, b, n) for a, b, n in zip(dac.min(0), dac.max(0), shape, strict=True)]
        lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        noise = NOISE * (rng.normal(size=(len(lattice), 4, 2)) @ [1, 1j])
        flags = (rng.random(len(lattice)) < share).astype(int)
        std = np.full(len(lattice), NOISE)
        view = View(str(k + 1), rotation, origin, None, lattice, noise, std, flags, shape)
        found.append(view)
    return found


def rms_error(looks: VolumeVisibility, method: Reconstruction) -> np.ndarray:
    """Of each component, over what is determined."""
    result = solve_field(looks, method, get("solver", "iterative")(), bounds=False)
    return np.sqrt(np.nanmean(np.abs(result.velocity) ** 2, axis=(0, 2)))


@pytest.mark.whole
@pytest.mark.parametrize("seed", [1, 2])
def test_errors_stay_near_those_of_all_views_together(laser: TwoMirror, seed: int) -> None:
    """A twentieth of the pixels is lost; elements are as small as pixels."""
    views = views_of_noise(laser, (21, 25), 0.05, seed)
    plate = Grid(size=[0.26, 0.21], shape=[17, 14], layers=3, thickness=0.024)
    looks = VolumeVisibility.from_volume(views, laser, plate)
    least = rms_error(looks, method_of("absolute"))
    samplewise = rms_error(looks, method_of("contravariant", **SAMPLEWISE))
    contravariant = rms_error(looks, method_of("contravariant"))
    trusting = rms_error(looks, method_of("contravariant", **SAMPLEWISE, weights=Weights.equal))
    assert np.all(samplewise < 1.5 * least)
    assert np.linalg.norm(contravariant) < 1.5 * np.linalg.norm(least)
    assert np.linalg.norm(trusting) > 3 * np.linalg.norm(least)


def contributions(looks: VolumeVisibility, method: Reconstruction) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the samples, and how many views see each."""
    parts = RegionIterator(looks, FieldModel.from_method(method, looks, local=False))
    (part,) = parts.disjoint()
    return part.at.information[:, 0, 0], part.samples.valid.sum(axis=1)


def test_samples_weigh_by_the_views_that_see_them(laser: TwoMirror) -> None:
    """As one seen by all, or less, in steps; without weights all that are solved weigh alike."""
    plate = Grid(size=[0.26, 0.21], shape=[17, 14], layers=3, thickness=0.024)
    looks = VolumeVisibility.from_volume(views_of_noise(laser, (21, 25), 0.05, 1), laser, plate)
    weight, seen = contributions(looks, method_of("contravariant", **SAMPLEWISE))
    np.testing.assert_array_equal(weight[seen == 5], 1.0)
    np.testing.assert_array_equal(weight[seen < 3], 0.0)
    kept = weight > 0
    np.testing.assert_allclose(2 * np.log2(weight[kept]), np.round(2 * np.log2(weight[kept])))
    means = [np.mean(weight[kept & (seen == n)]) for n in (3, 4, 5)]
    assert means[0] < 0.5 * means[1] < 0.5 * means[2]
    equal = method_of("contravariant", **SAMPLEWISE, weights=Weights.equal)
    assert set(contributions(looks, equal)[0]) == {0.0, 1.0}
    # All views see all: one matrix of the surface and one of the line.
    looks = VolumeVisibility.from_volume(views_of_noise(laser, (21, 25), 0.0, 1), laser, plate)
    np.testing.assert_array_equal(contributions(looks, method_of("contravariant"))[0], 1.0)


def test_others_stand_in_for_the_best_three_only(laser: TwoMirror) -> None:
    """Rows that are asked for by name are the only ones."""
    plate = Grid(size=[0.26, 0.21], shape=[17, 14], layers=3, thickness=0.024)
    looks = VolumeVisibility.from_volume(views_of_noise(laser, (21, 25), 0.05, 1), laser, plate)
    weight, _ = contributions(looks, method_of("contravariant"))
    by_all, _ = contributions(looks, method_of("contravariant", **SAMPLEWISE))
    np.testing.assert_array_equal(weight > 0, by_all > 0)
    for method in (
        method_of("contravariant", rows="3,5-1,4-2"),
        method_of("contravariant", weights=Weights.equal),
    ):
        by_name, _ = contributions(looks, method)
        assert np.mean(by_name > 0) < 0.7 * np.mean(weight > 0)


@pytest.mark.long
def test_default_session_with_lost_pixels(sldvexp: Callable[..., Any]) -> None:
    """Whole session on the virtual lab, one in twenty pixels without light."""
    run = sldvexp(
        "scene.vibrometer.drop_out=0.05",
        "compare={absolute: {plugin: absolute}, contravariant: {plugin: contravariant}}",
        "report=none",
    )
    assert run.status == 0, run.err
    truth = run.tree["truth"]["velocity"].values
    height = np.abs(run.tree["truth"]["height"].values)
    middle = height < height.min() + 1e-6
    size = {}
    for name in ("field", "compare/absolute", "compare/contravariant"):
        off = np.abs(run.tree[name]["velocity"].values - truth)[middle]
        size[name] = np.sqrt(np.nanmean(off**2, axis=(0, 2)))
    # What the worst nodes lose shows in the efficiency; most lose next to nothing.
    efficiency = run.tree["field"]["efficiency"].values
    assert np.nanmin(efficiency) < 0.5
    assert np.nanmedian(efficiency) > 0.9
    least = size["compare/absolute"]
    assert np.all(size["field"] < 1.5 * least)
    assert np.all(size["compare/contravariant"] < 1.5 * least)
