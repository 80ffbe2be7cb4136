"""Influences of a view's pixels, made gap by gap for several models, are those made at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sldvexp.field import View, VolumeVisibility
from sldvexp.field.bounds.inverse import ViewInfluence
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
