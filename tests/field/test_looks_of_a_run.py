"""Looks at the same session are made once, and those at another are made anew."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import xarray as xr

import sldvexp.field.estimate as field_run
import sldvexp.field.visibility.visibility as field_looks
from sldvexp import dataset
from sldvexp.check import Examination
from sldvexp.check.agreement import agreement
from sldvexp.config.experiment import Experiment
from sldvexp.field import Direct, Iterative, View
from sldvexp.field.estimate import reconstruct, volume_visibility
from sldvexp.laser import TwoMirror
from sldvexp.pose import pose_to_dataset
from sldvexp.reconstruction import Absolute, Reconstruction
from sldvexp.volume import Coordinates, Grid

Make = Callable[..., list[View]]
VOLUME = Grid(size=[0.3, 0.3], shape=[4, 4], layers=3, thickness=0.02)


@pytest.fixture
def views(make_views: Make) -> list[View]:
    return make_views(4, pixels=9, covariance=1e-8 * np.eye(6))


def session(views: list[View]) -> dict[str, xr.Dataset]:
    """Poses, and images of noise."""
    rng = np.random.default_rng(5)
    poses = [(v.name, v.rotation, v.origin, v.covariance) for v in views]
    tree = {"pose": pose_to_dataset(*map(list, zip(*poses, strict=True)), [np.inf] * 4, 0.95)}
    for view in views:
        size = (len(view.dac), 1)
        tree[f"image/{view.name}"] = dataset.group(
            "image",
            {"pixel": np.arange(size[0]), "frequency": [200.0]},
            velocity=rng.normal(size=(*size, 2)) @ [1e-3, 1e-3j],
            velocity_std=np.full(size, 1e-3),
            dac=view.dac,
            flags=view.flags.astype(np.uint8),
        ).assign_attrs(shape=list(view.shape or ()))
    return tree


def test_the_same_session_is_looked_at_once(views: list[View], laser: TwoMirror) -> None:
    first = volume_visibility(session(views), laser, VOLUME)
    assert volume_visibility(session(views), laser, VOLUME) is first


def test_a_session_that_the_next_run_of_a_sweep_reads_is_the_same(
    views: list[View], laser: TwoMirror
) -> None:
    """Its arrays are kept from change, and what was one object may be two."""
    tree = session(views)
    first = volume_visibility(tree, laser, VOLUME)
    again = {name: group.copy(deep=True) for name, group in tree.items()}
    for group in again.values():
        for variable in group.variables.values():
            variable.values.setflags(write=False)
            variable.attrs = {k: json.loads(json.dumps(v)) for k, v in variable.attrs.items()}
    assert volume_visibility(again, laser, VOLUME) is first


@pytest.mark.parametrize("what", ["image", "pose", "laser", "volume"])
def test_another_session_is_looked_at_anew(views: list[View], laser: TwoMirror, what: str) -> None:
    tree, volume = session(views), VOLUME
    first = volume_visibility(tree, laser, VOLUME)
    if what == "image":
        tree["image/2"] = tree["image/2"].copy(deep=True)
        tree["image/2"]["velocity"][3] *= 1 + 1e-9
    elif what == "pose":
        tree["pose"] = tree["pose"].copy(deep=True)
        tree["pose"]["origin"][1] += 1e-9
    elif what == "laser":
        laser = replace(laser, mirror_offset=laser.mirror_offset + 1e-9)
    else:
        volume = replace(VOLUME, thickness=0.03)
    assert volume_visibility(tree, laser, volume) is not first


def test_the_last_field_is_recalled_by_the_same_method_alone(
    views: list[View], laser: TwoMirror, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As often as a run compares its field with the same method; nothing else is alike enough."""
    tree, solved, usual = session(views), [], field_run.solve_field

    def counted(*args: Any, **options: Any) -> Any:
        solved.append(args[1])
        return usual(*args, **options)

    monkeypatch.setattr(field_run, "solve_field", counted)
    seen = volume_visibility(tree, laser, VOLUME)
    assert seen.common is not None

    def made(method: Reconstruction, **other: Any) -> xr.Dataset:
        told = {"tree": tree, "volume": VOLUME, "solver": Iterative()} | other
        return reconstruct(told["tree"], seen, told["volume"], method, told["solver"])

    first, again = made(Absolute()), made(Absolute())
    assert len(solved) == 1
    xr.testing.assert_identical(first, again)
    again["velocity"].values[:] = 0.0  # which is no other's
    xr.testing.assert_identical(first, made(Absolute()))
    poses = tree["pose"].assign(covariance=4 * tree["pose"]["covariance"])
    others: list[dict[str, Any]] = [
        {"method": Absolute(confidence=0.9)},
        {"solver": Direct()},
        {"volume": replace(VOLUME, coordinates=Coordinates.local)},
        {"tree": tree | {"pose": poses}},
    ]
    for other in others:
        found = made(**{"method": Absolute()} | other)
        assert found.attrs != first.attrs or not found.equals(first), other
    assert len(solved) == 1 + len(others)


def test_large_images_are_not_kept(
    views: list[View], laser: TwoMirror, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(field_run, "CACHE_BYTES", 0)
    tree = session(views)
    assert volume_visibility(tree, laser, VOLUME) is not volume_visibility(tree, laser, VOLUME)


def test_agreement_is_the_same_part_by_part(
    views: list[View], laser: TwoMirror, monkeypatch: pytest.MonkeyPatch
) -> None:
    examined: list[Any] = []
    for most in (field_looks.CACHE_SAMPLES, 0):
        monkeypatch.setattr(field_looks, "CACHE_SAMPLES", most)
        experiment = Experiment(laser=laser, volume=VOLUME)
        run = Examination(session(views), rng=np.random.default_rng(), experiment=experiment)
        examined.append(agreement(run, 4))
    whole, parts = examined
    assert whole.freedom.shape[0] == 4
    assert whole.freedom.min() > 0
    np.testing.assert_array_equal(whole.freedom, parts.freedom)
    np.testing.assert_allclose(whole.misfit, parts.misfit, rtol=1e-12)
