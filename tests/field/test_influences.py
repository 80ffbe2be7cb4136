"""Influences of a view's pixels, made gap by gap for several models, are those made at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_array

from sldvexp.field import View, VolumeVisibility
from sldvexp.field.bounds.inverse import ODD, ViewInfluence, _differ, _pseudo_inverse
from sldvexp.field.equations.elements import Patch, influence, influences_by_layers
from sldvexp.laser import TwoMirror
from sldvexp.volume import Prisms, SampleRule


def test_layers_beside_one_another(
    make_plate: Callable[..., Prisms],
    make_views: Callable[..., list[View]],
    laser: TwoMirror,
    six_points: SampleRule,
) -> None:
    prisms, rule = make_plate((5, 4), layers=4), six_points
    visibility = VolumeVisibility(make_views(1, 12), laser, prisms, rule)
    some = np.arange(3, 15)
    patch, samples = Patch.over(prisms, rule, some), visibility.at(some)
    weights, rng = samples.by_view[0].weights, np.random.default_rng(5)
    estimators = [rng.normal(size=(weights.shape[0], p)) for p in (3, 4)]
    estimators.insert(1, np.zeros((weights.shape[0], 3)))
    found = influences_by_layers(patch, estimators, weights)
    for beside, estimator in zip(found, estimators, strict=True):
        expected = influence(patch, estimator, weights).toarray()
        one = ViewInfluence(beside)
        np.testing.assert_allclose(one.apart.toarray(), expected, atol=1e-12)
        vectors = rng.normal(size=(2, len(expected)))
        np.testing.assert_allclose(
            one.transposed_times(vectors), expected.T @ vectors.T, atol=1e-12
        )


def test_a_view_that_sees_none_of_a_patch(
    make_plate: Callable[..., Prisms], six_points: SampleRule
) -> None:
    prisms = make_plate((4, 3), layers=3)
    patch = Patch.over(prisms, six_points, np.arange(len(prisms.triangles)))
    estimator = np.ones((np.prod(patch.sample_shape), 3))
    weights = csr_array((len(estimator), 7))
    (found,) = influences_by_layers(patch, [estimator], weights)
    assert found.shape == (3 * len(patch.nodes), 7 * 3)
    assert found.nnz == 0


def test_vectors_of_few_parameters(
    make_plate: Callable[..., Prisms],
    make_views: Callable[..., list[View]],
    laser: TwoMirror,
    six_points: SampleRule,
) -> None:
    """Vectors that have zeros in all but one parameter, as those of uncoupled parameters do."""
    prisms, rule = make_plate((4, 3), layers=3), six_points
    visibility = VolumeVisibility(make_views(1, 12), laser, prisms, rule)
    every = np.arange(len(prisms.triangles))
    patch, weights = Patch.over(prisms, rule, every), visibility.at(every).by_view[0].weights
    rng = np.random.default_rng(6)
    (beside,) = influences_by_layers(patch, [rng.normal(size=(weights.shape[0], 3))], weights)
    one = ViewInfluence(beside)
    vectors = rng.normal(size=(4, len(one.apart.indptr) - 1, 3)) * np.eye(3)[[0, 2, 2, 1]][:, None]
    vectors[1, :-2] = 0  # all but the last two nodes of the last layer
    flat = vectors.reshape(4, -1)
    expected = one.apart.toarray().T @ flat.T
    np.testing.assert_allclose(one.transposed_times(flat), expected, atol=1e-12)


def test_turns_that_differ_in_some_direction() -> None:
    rng = np.random.default_rng(7)
    turn = np.eye(3) + rng.normal(scale=ODD / 2, size=(200, 3, 3))
    expected = np.abs(np.linalg.eigvals(turn) - 1).max(axis=1) > ODD
    assert 20 < expected.sum() < 180
    np.testing.assert_array_equal(_differ(turn), expected)
    np.testing.assert_array_equal(_differ(turn[:, :1, :1]), np.abs(turn[:, 0, 0] - 1) > ODD)


def test_inverses_of_single_numbers() -> None:
    numbers = np.array([4.0, 0.0, 0.5])[:, None, None]
    np.testing.assert_array_equal(_pseudo_inverse(numbers).ravel(), [0.25, 0.0, 2.0])
