"""Standard errors of nodal values: against simulated noise, moved poses, and one another."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import sldvexp.field.equations.regions as field_parts
import sldvexp.field.equations.sample_model as field_samples
import sldvexp.field.equations.system as field_system
from sldvexp.config.registry import get
from sldvexp.field import FieldResult, View, VolumeVisibility
from sldvexp.field.estimate import solve_field
from sldvexp.geometry import rotation_from_vector
from sldvexp.laser import TwoMirror
from sldvexp.reconstruction import Contravariant, Model, Reconstruction, Weights
from sldvexp.volume import SampleRule

Make = Callable[..., Any]
METHODS = [
    ("absolute", {}),
    ("absolute", {"model": Model.full}),
    ("relative", {}),
    ("combined", {"rows": "1-4,2,3"}),
    ("contravariant", {"rows": "1-4,2,3"}),
    ("contravariant", {"rows": "all"}),
]


def method_of(name: str, fields: dict[str, Any]) -> Reconstruction:
    method: Reconstruction = get("reconstruction", name)(**fields)
    return method


def estimate(looks: VolumeVisibility, method: Reconstruction, **options: Any) -> FieldResult:
    return solve_field(looks, method, get("solver", "iterative")(), **options)


def smooth(views: list[View]) -> list[View]:
    """Velocities that are linear in the steps, and so are interpolated exactly."""
    rng = np.random.default_rng(5)
    shape = views[0].velocity.shape
    return [
        replace(
            v, velocity=(v.dac / 1000 @ rng.normal(size=(2, 2)) + 1) @ [[1], [1j]] * np.ones(shape)
        )
        for v in views
    ]


@pytest.mark.one_in(4)
@pytest.mark.parametrize("local", [pytest.param(False, marks=pytest.mark.long), True])
@pytest.mark.parametrize(("name", "fields"), METHODS)
def test_noise_of_shared_pixels(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror,
    name: str, fields: dict[str, Any], local: bool,
) -> None:  # fmt: skip
    """Each frequency is one draw of the noise: its std over frequencies is the standard error."""
    draws = 300
    prisms = make_plate((4, 4), 3, radius=0.7 if local else 0.0)
    rng = np.random.default_rng(6)
    views = []
    for view in make_views(5, pixels=9, frequencies=draws):
        std = rng.uniform(0.5, 2, len(view.dac))
        noise = rng.normal(size=(*view.velocity.shape, 2)) @ [1, 1j]
        views.append(replace(view, std=std, velocity=std[:, None] * noise))
    result = estimate(
        VolumeVisibility(views, laser, prisms, six_points), method_of(name, fields), local=local
    )
    assert result.bounds_error == 0.0
    parts = np.concatenate([result.velocity.real, result.velocity.imag], axis=2)
    ratio = np.sqrt((parts**2).mean(axis=2)) / result.std_noise[:, :, 0]
    # The relative error of a std from n draws is 1 / sqrt(2 n); 4.5 of that for each value.
    assert np.abs(ratio - 1).max() < 4.5 / np.sqrt(4 * draws)
    np.testing.assert_allclose(result.std, result.std_noise)
    # The expected sum of squares: its own spread is above that of independent samples by the
    # number of samples that share a pixel, which is below 30 here.
    degrees = 2 * draws * len(views[0].dac)
    assert np.abs(result.chi2_ratio.mean(axis=1) - 1).max() < 4.5 * np.sqrt(2 * 30 / degrees)


@pytest.mark.one_in(8)
@pytest.mark.parametrize("local", [pytest.param(False, marks=pytest.mark.long), True])
@pytest.mark.parametrize(("name", "fields"), METHODS)
def test_derivative_by_the_poses(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror,
    name: str, fields: dict[str, Any], local: bool,
) -> None:  # fmt: skip
    """With one uncertain parameter, the standard error is the change with it."""
    prisms = make_plate((4, 4), 3, radius=0.7 if local else 0.0)
    views, method = smooth(make_views(5, pixels=9)), method_of(name, fields)
    h = 1e-6

    def velocity(k: int, step: np.ndarray) -> np.ndarray:
        turned = rotation_from_vector(step[:3]) @ views[k].rotation
        moved = replace(views[k], rotation=turned, origin=views[k].origin + step[3:])
        changed = [*views[:k], moved, *views[k + 1 :]]
        looks = VolumeVisibility(changed, laser, prisms, six_points)
        return estimate(looks, method, local=local, bounds=False).velocity

    every = ((0, 0), (1, 1), (2, 2), (3, 3), (1, 4), (2, 5))
    for k, parameter in every[:: 2 if local else 1]:
        step = h * np.eye(6)[parameter]
        slope = (velocity(k, step) - velocity(k, -step)) / (2 * h)
        covariance = np.zeros((30, 30))
        covariance[6 * k + parameter, 6 * k + parameter] = 1.0
        looks = VolumeVisibility(views, laser, prisms, six_points)
        result = estimate(looks, method, local=local, covariance=covariance)
        scale = np.abs(slope).max()
        np.testing.assert_allclose(result.std_pose[0], np.abs(slope.real), atol=2e-5 * scale)
        np.testing.assert_allclose(result.std_pose[1], np.abs(slope.imag), atol=2e-5 * scale)


def test_both_parts_add_up_and_poses_may_be_joint(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror
) -> None:
    prisms, method = make_plate((4, 4), 3), method_of("absolute", {"confidence": 0.9})
    root = np.random.default_rng(7).normal(size=(30, 30)) * 1e-3
    joint = root @ root.T
    own = [joint[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] for k in range(5)]
    views = smooth(make_views(5, pixels=9))
    by_view = [replace(v, covariance=c) for v, c in zip(views, own, strict=True)]
    result = estimate(VolumeVisibility(by_view, laser, prisms, six_points), method)
    both = np.sqrt(result.std_noise**2 + result.std_pose**2)
    np.testing.assert_allclose(result.std_by_part, both)
    np.testing.assert_allclose(result.confidence_by_part, 1.6448536 * both, rtol=1e-6)
    np.testing.assert_allclose(result.std, both.max(axis=0))
    blocks = np.zeros((30, 30))
    for k, c in enumerate(own):
        blocks[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = c
    again = estimate(VolumeVisibility(views, laser, prisms, six_points), method, covariance=blocks)
    np.testing.assert_allclose(again.std_pose, result.std_pose)
    other = estimate(VolumeVisibility(views, laser, prisms, six_points), method, covariance=joint)
    assert np.abs(other.std_pose / result.std_pose - 1).max() > 0.1
    none = estimate(VolumeVisibility(views, laser, prisms, six_points), method)
    assert none.std_pose is None
    assert "poses have no covariance" in none.messages[-1]
    np.testing.assert_allclose(none.std, result.std_noise)


@pytest.mark.one_in(6)
@pytest.mark.parametrize("at_once", [pytest.param(10**6, marks=pytest.mark.long), 0])
@pytest.mark.parametrize("uneven", [False, True])
@pytest.mark.parametrize(("name", "fields"), METHODS[:1] + METHODS[4:])
def test_large_fields(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror,
    monkeypatch: pytest.MonkeyPatch,
    name: str, fields: dict[str, Any], uneven: bool, at_once: int,
) -> None:  # fmt: skip
    """Bounds of large fields, computed part by part from what is near, are almost exact."""
    prisms, method = make_plate((10, 9), 4), method_of(name, fields)
    views = smooth(make_views(5, pixels=20, covariance=1e-6 * np.eye(6)))
    if uneven:
        views[4] = replace(views[4], flags=(views[4].dac[:, 1] > 300).astype(int))
        views[2] = replace(views[2], flags=(np.hypot(*(views[2].dac.T - 200)) < 250).astype(int))
    looks = VolumeVisibility(views, laser, prisms, six_points)
    exact = estimate(looks, method)
    monkeypatch.setattr(field_system, "SMALL", 0)
    monkeypatch.setattr(field_parts, "SAMPLES_IN_ALL", at_once)
    monkeypatch.setattr(field_parts, "SAMPLES_AT_ONCE", 1000)
    near = estimate(looks, method)
    known = exact.observable
    assert known.mean() > 0.7
    np.testing.assert_allclose(near.velocity, exact.velocity, atol=1e-9)
    noise = np.abs(near.std_noise / exact.std_noise - 1)[known]
    pose = np.abs(near.std_pose / exact.std_pose - 1)[:, known]
    # Where a view ends the field's own errors jump, and what is far counts for more.
    assert 0 < noise.max() < (0.02 if uneven else 0.005)
    assert 0 < pose.max() < (0.1 if uneven else 0.01)
    assert np.sqrt(np.mean(noise**2)) < 0.002
    assert np.sqrt(np.mean(pose**2)) < 0.01
    assert 0 < near.bounds_error < 0.1
    np.testing.assert_allclose(near.chi2_ratio, exact.chi2_ratio, rtol=2e-3)
    np.testing.assert_allclose(near.efficiency[known], exact.efficiency[known], rtol=0.1)
    np.testing.assert_allclose(
        np.median(near.efficiency[known]), np.median(exact.efficiency[known]), rtol=0.01
    )


@pytest.fixture
def smooth_looks(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror
) -> VolumeVisibility:
    views = smooth(make_views(5, pixels=12, covariance=1e-6 * np.eye(6)))
    return VolumeVisibility(views, laser, make_plate((7, 6), 3), six_points)


def test_samples_of_a_large_field_are_looked_at_twice(
    smooth_looks: VolumeVisibility, monkeypatch: pytest.MonkeyPatch
) -> None:
    """For the equations, with those of the interpolation's errors, and for the bounds."""
    at_once, ways = estimate(smooth_looks, Contravariant()), []
    for way in ("disjoint", "overlapping"):
        go = getattr(field_parts.RegionIterator, way)

        def gone(*args: Any, way: str = way, go: Any = go, **kwargs: Any) -> Any:
            ways.append(way)
            return go(*args, **kwargs)

        monkeypatch.setattr(field_parts.RegionIterator, way, gone)
    monkeypatch.setattr(field_system, "SMALL", 0)
    monkeypatch.setattr(field_parts, "SAMPLES_IN_ALL", 0)
    monkeypatch.setattr(field_parts, "SAMPLES_AT_ONCE", 300)
    in_parts = estimate(smooth_looks, Contravariant())
    assert ways == ["disjoint", "overlapping"]
    largest = np.abs(at_once.interpolation_error).max()
    assert largest > 0
    np.testing.assert_allclose(
        in_parts.interpolation_error, at_once.interpolation_error, rtol=0, atol=1e-10 * largest
    )


def test_samples_of_one_part_are_in_memory_at_a_time(
    smooth_looks: VolumeVisibility, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[weakref.ref[field_parts.RegionSamples]] = []
    make = field_parts.RegionSamples.from_region

    def look(*args: Any, **kwargs: Any) -> field_parts.RegionSamples:
        assert not any(ref() for ref in made)
        part = make(*args, **kwargs)
        made.append(weakref.ref(part))
        return part

    monkeypatch.setattr(field_parts.RegionSamples, "from_region", look)
    monkeypatch.setattr(field_system, "SMALL", 0)
    monkeypatch.setattr(field_parts, "SAMPLES_IN_ALL", 0)
    monkeypatch.setattr(field_parts, "SAMPLES_AT_ONCE", 300)
    estimate(smooth_looks, Contravariant())
    assert len(made) > 4


@pytest.mark.parametrize("lost", [False, True])
def test_what_rows_determine_is_looked_at_once(
    smooth_looks: VolumeVisibility, monkeypatch: pytest.MonkeyPatch, lost: bool
) -> None:
    """For the equations; and for the bounds again where the rows left any sample open."""
    views = list(smooth_looks.views)
    if lost:  # where other views stand in for the first of the best rows'
        flags = (np.arange(len(views[0].dac)) % 7 == 0).astype(int)
        views = [replace(view, flags=flags) for view in views[:2]] + views[2:]
    looks = VolumeVisibility(views, smooth_looks.laser, smooth_looks.prisms, smooth_looks.rule)
    monkeypatch.setattr(field_system, "SMALL", 0)
    at_once, ranked = estimate(looks, Contravariant()), []
    rank_of = field_samples.rank_of

    def counted(*args: Any) -> Any:
        ranked.append(len(args[0]))
        return rank_of(*args)

    monkeypatch.setattr(field_samples, "rank_of", counted)
    monkeypatch.setattr(field_parts, "SAMPLES_IN_ALL", 0)
    monkeypatch.setattr(field_parts, "SAMPLES_AT_ONCE", 300)
    in_parts = estimate(looks, Contravariant())
    samples = looks.prisms.gaps * len(looks.prisms.triangles) * looks.rule.points
    once = 2 * samples  # in the method's model and in that of least variance
    assert sum(ranked) > once if lost else sum(ranked) == once
    np.testing.assert_allclose(in_parts.velocity, at_once.velocity, atol=1e-11)
    np.testing.assert_allclose(in_parts.std_noise, at_once.std_noise, rtol=0.05)


@pytest.mark.whole
@pytest.mark.parametrize(("name", "fields"), METHODS[:1] + METHODS[4:])
def test_large_fields_with_a_hole(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror,
    monkeypatch: pytest.MonkeyPatch, name: str, fields: dict[str, Any],
) -> None:  # fmt: skip
    """Around nodes that no view sees, which are held at zero, bounds are those of small fields."""
    prisms, method = make_plate((10, 9), 4), method_of(name, fields)
    views = smooth(make_views(5, pixels=24, covariance=1e-6 * np.eye(6)))
    for k, view in enumerate(views):
        middle = view.dac.mean(axis=0)
        unseen = np.hypot(*(view.dac - middle).T) < 0.2 * np.ptp(view.dac)
        views[k] = replace(view, flags=unseen.astype(int))
    looks = VolumeVisibility(views, laser, prisms, six_points)
    exact = estimate(looks, method)
    monkeypatch.setattr(field_system, "SMALL", 0)
    near = estimate(looks, method)
    known = exact.observable
    assert 0.5 < known.mean() < 1
    np.testing.assert_array_equal(near.observable, known)
    noise = np.abs(near.std_noise / exact.std_noise - 1)[known]
    pose = np.abs(near.std_pose / exact.std_pose - 1)[:, known]
    # At the rim of the hole what is far counts for more, and the poses' part errs the most.
    assert np.percentile(noise, 99) < 0.02
    assert np.percentile(pose, 95) < 0.05
    assert noise.max() < 0.1
    assert pose.max() < 0.5


def test_many_frequencies(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror
) -> None:
    """Poses' part of many frequencies comes from what is above the noise of all of them."""
    prisms, method = make_plate((5, 4), 3), method_of("absolute", {})
    views = smooth(make_views(5, pixels=9, covariance=1e-8 * np.eye(6)))
    rng = np.random.default_rng(8)
    response = rng.normal(size=(40, 2)) @ [1, 1j] * np.logspace(0, -3, 40)
    many = []
    for view in views:
        noise = 1e-3 * rng.normal(size=(len(view.dac), 40, 2)) @ [1, 1j]
        many.append(replace(view, velocity=view.velocity * response + noise))
    result = estimate(VolumeVisibility(many, laser, prisms, six_points), method)
    for f in (0, 20, 39):
        one = [replace(v, velocity=v.velocity[:, f : f + 1]) for v in many]
        alone = estimate(VolumeVisibility(one, laser, prisms, six_points), method)
        np.testing.assert_allclose(result.velocity[..., f], alone.velocity[..., 0], rtol=1e-9)
        np.testing.assert_allclose(result.std_noise[..., f], alone.std_noise[..., 0])
        total = alone.std_by_part[..., 0]
        assert np.abs(result.std_by_part[..., f] / total - 1).max() < 0.005
        assert alone.std_pose.max() > 1e-5 or f


def test_noise_that_changes_with_frequency(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror
) -> None:
    prisms, method = make_plate((4, 4), 3), method_of("absolute", {})
    views = make_views(5, pixels=9, frequencies=2)
    std = np.random.default_rng(9).uniform(1, 2, len(views[0].dac))
    two = [replace(v, std=std[:, None] * [1.0, 3.0]) for v in views]
    result = estimate(VolumeVisibility(two, laser, prisms, six_points), method)
    same = [replace(v, std=std) for v in views]
    one = estimate(VolumeVisibility(same, laser, prisms, six_points), method)
    np.testing.assert_allclose(result.std_noise, one.std_noise * [1.0, 3.0])


@pytest.mark.whole
def test_efficiency(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror
) -> None:
    """Absolute with noise weights is the best; the ratio of variances is the efficiency."""
    prisms = make_plate((5, 5), 3)
    rng, views = np.random.default_rng(10), make_views(5, pixels=20)
    views = [replace(v, flags=(rng.random(len(v.flags)) < 0.05).astype(int)) for v in views]
    looks = VolumeVisibility(views, laser, prisms, six_points)
    best = estimate(looks, method_of("absolute", {}))
    np.testing.assert_array_equal(best.efficiency, 1.0)
    trusting = ("contravariant", {"rows": "all", "weights": Weights.equal})
    for name, fields in [*METHODS[1:], trusting]:
        other = estimate(looks, method_of(name, fields))
        ratio = (best.std_noise / other.std_noise)[..., 0] ** 2
        # Samples' errors are shared, so that another method may be better by little.
        np.testing.assert_allclose(other.efficiency, np.minimum(ratio, 1), rtol=1e-6)
        known = np.isfinite(ratio)  # nodes around flagged pixels may have too few samples
        few_rows = name == "contravariant" and fields["rows"] != "all"
        assert known.mean() > (0.9 if few_rows else 0.99)  # 0.907 and 1 at this seed
        assert np.median(ratio[known]) < 1.02
    # Samples that few views see spoil their nodes, and it says so.
    assert np.nanmin(other.efficiency) < 0.2
