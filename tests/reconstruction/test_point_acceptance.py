"""What every registered reconstruction method must do, whoever wrote it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sldvexp.config.registry import get, names
from sldvexp.geometry import rotation_from_vector
from sldvexp.reconstruction import Model, Reconstruction, Weights

#: Those of single points; others need a surface.
METHODS = [
    n for n in names("reconstruction") if issubclass(get("reconstruction", n), Reconstruction)
]
SEEDS = st.integers(0, 2**32 - 1)
FEW = settings(max_examples=25, deadline=None, derandomize=True)


def scene(seed: int, views: int, points: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Directions within about 50 deg of one side, true velocities, and what the views see."""
    rng = np.random.default_rng(seed)
    directions = np.concatenate(
        [0.8 * rng.uniform(-1, 1, (views, points, 2)), np.ones((views, points, 1))], axis=-1
    )
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    velocity = rng.normal(size=(points, 3, 2)) + 1j * rng.normal(size=(points, 3, 2))
    return directions, velocity, np.einsum("vpi,pif->vpf", directions, velocity)


def method_of(name: str, **fields: object) -> Reconstruction:
    return get("reconstruction", name)(**fields)


@pytest.mark.one_in(6)
@pytest.mark.parametrize("weights", Weights)
@pytest.mark.parametrize("name", METHODS)
@given(seed=SEEDS, views=st.integers(5, 9))
@FEW
def test_exact_data_is_recovered(name: str, weights: Weights, seed: int, views: int) -> None:
    directions, velocity, seen = scene(seed, views)
    result = method_of(name, weights=weights).reconstruct(directions, seen)
    for p in np.flatnonzero(result.observable.all(axis=1)):
        error = np.abs(result.velocity[p] - velocity[p]).max()
        assert error < 1e-13 / result.rcond[p]


@pytest.mark.one_in(4)
@pytest.mark.parametrize("name", METHODS)
@given(seed=SEEDS)
@FEW
def test_rotating_the_axes_rotates_the_velocity(name: str, seed: int) -> None:
    directions, _, seen = scene(seed, 6)
    rng = np.random.default_rng(seed)
    seen = seen + 0.1 * rng.normal(size=seen.shape)
    rotation = rotation_from_vector(rng.normal(size=3))
    rows = str(method_of(name).reconstruct(directions, seen).rows)
    before = method_of(name, rows=rows).reconstruct(directions, seen)
    after = method_of(name, rows=rows).reconstruct(directions @ rotation.T, seen)
    keep = before.rcond > 1e-4
    turned = np.einsum("ij,pjf->pif", rotation, before.velocity)
    np.testing.assert_allclose(after.velocity[keep], turned[keep], rtol=1e-8, atol=1e-8)
    covariance = np.einsum("ij,pjkf,lk->pilf", rotation, before.covariance, rotation)
    scale = np.abs(before.covariance).max(axis=(1, 2, 3), keepdims=True)
    difference = (after.covariance - covariance) / scale
    np.testing.assert_allclose(difference[keep], 0, atol=1e-8)


@pytest.mark.one_in(2)
@pytest.mark.parametrize("name", METHODS)
@given(seed=SEEDS, factor=st.floats(1e-6, 1e6))
@FEW
def test_scaling_the_data_scales_the_result(name: str, seed: int, factor: float) -> None:
    directions, _, seen = scene(seed, 5)
    seen = seen + np.random.default_rng(seed).normal(size=seen.shape)
    one = method_of(name).reconstruct(directions, seen)
    other = method_of(name).reconstruct(directions, factor * seen)
    for field in ("velocity", "std", "confidence"):
        np.testing.assert_allclose(getattr(other, field), factor * getattr(one, field), rtol=1e-9)


@pytest.mark.parametrize("name", ["absolute", "relative"])
@given(seed=SEEDS)
@FEW
def test_order_of_views_does_not_matter(name: str, seed: int) -> None:
    """Also for differences from the first view: weighted by their covariance they are all alike."""
    directions, _, seen = scene(seed, 6)
    rng = np.random.default_rng(seed)
    seen, std = seen + rng.normal(size=seen.shape), rng.uniform(0.5, 2, 6)
    order = rng.permutation(6)
    one = method_of(name).reconstruct(directions, seen, std)
    other = method_of(name).reconstruct(directions[order], seen[order], std[order])
    np.testing.assert_allclose(other.velocity, one.velocity, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(other.std, one.std, rtol=1e-7)


@pytest.mark.one_in(3)
@pytest.mark.parametrize("weights", Weights)
@pytest.mark.parametrize("name", METHODS)
@given(seed=SEEDS, with_std=st.booleans())
@FEW
def test_no_method_beats_gauss_and_markov(
    name: str, weights: Weights, seed: int, with_std: bool
) -> None:
    directions, _, seen = scene(seed, 6)
    std = np.random.default_rng(seed).uniform(0.1, 10, 6) if with_std else None
    result = method_of(name, weights=weights).reconstruct(directions, seen, std)
    efficiency = result.efficiency[result.observable]
    assert np.all(efficiency > 0)
    assert np.all(efficiency <= 1 + 1e-9)


@pytest.mark.parametrize("with_std", [False, True])
def test_all_views_by_their_noise_are_as_good_as_can_be(monkeypatch, with_std) -> None:
    """No other estimator is set up to find that; the two would be the same."""
    directions, _, seen = scene(3, 6)
    std = np.random.default_rng(3).uniform(0.1, 10, seen.shape) if with_std else None
    result = method_of("absolute").reconstruct(directions, seen, std)
    best = result.system.best_fit(slice(None), intercept=False)
    np.testing.assert_array_equal(best.root, result.system.fit(slice(None)).root)
    monkeypatch.setattr("sldvexp.reconstruction.system.point_fit", None)
    frequencies = seen.shape[2] if with_std else 1
    np.testing.assert_array_equal(result.efficiency, np.ones((3, 3, frequencies)))


@pytest.mark.parametrize("name", METHODS)
def test_one_point_is_a_set_of_one_point(name: str) -> None:
    directions, _, seen = scene(1, 5)
    alone = method_of(name).reconstruct(directions[:, 0], seen[:, 0])
    among = method_of(name).reconstruct(directions[:, :1], seen[:, :1])
    assert alone.velocity.shape == (1, 3, 2)
    for field in ("velocity", "std", "confidence", "rcond"):
        np.testing.assert_array_equal(getattr(alone, field), getattr(among, field))


@pytest.mark.parametrize("name", METHODS)
def test_std_is_the_diagonal_of_the_covariance(name: str) -> None:
    directions, _, seen = scene(2, 5)
    seen = seen + np.random.default_rng(2).normal(size=seen.shape)
    result = method_of(name).reconstruct(directions, seen)
    diagonal = np.einsum("piif->pif", result.covariance)
    np.testing.assert_allclose(np.sqrt(diagonal), result.std, rtol=1e-12)
    np.testing.assert_allclose(
        result.confidence, result.std * result.factor[:, None, None], rtol=1e-12
    )


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_named(name: str, value: float) -> None:
    from sldvexp.errors import UserError

    directions, _, seen = scene(3, 5)
    seen[:, 2, 1] = value
    with pytest.raises(UserError, match="velocity of view 1 at point 2, frequency 1"):
        method_of(name).reconstruct(directions, seen)


@pytest.mark.parametrize("name", METHODS)
@pytest.mark.parametrize(
    ("fields", "match"),
    [
        ({"rows": " "}, "rows: must name rows"),
        ({"confidence": 1.0}, "confidence: must lie between 0 and 1"),
        ({"confidence": float("nan")}, "confidence: must lie between 0 and 1"),
        ({"rank_tolerance": 0.0}, "rank_tolerance: must lie between 1e-12"),
    ],
)
def test_bad_fields(name: str, fields: dict[str, object], match: str) -> None:
    from sldvexp.errors import ConfigError

    with pytest.raises(ConfigError, match=match):
        method_of(name, **fields)


@pytest.mark.parametrize("name", METHODS)
def test_full_model_only_where_an_intercept_shows(name: str) -> None:
    from sldvexp.errors import ConfigError

    if name == "relative":
        with pytest.raises(ConfigError, match="model: must be partial"):
            method_of(name, model=Model.full)
    else:
        directions, velocity, seen = scene(4, 6)
        result = method_of(name, model=Model.full).reconstruct(directions, seen + 0.25)
        np.testing.assert_allclose(result.velocity, velocity, atol=1e-9)
        assert result.intercept is not None
        np.testing.assert_allclose(result.intercept, 0.25, atol=1e-9)
