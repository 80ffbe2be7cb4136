"""Modes of many frequencies: few by Lanczos' method are those of the whole matrix."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.field.streaming import compression
from sldvexp.field.streaming.compression import FrequencyModes
from sldvexp.typing import Array

COLUMNS, PIXELS, NOISE = 600, 60, 1e-2


def data_of(modes: int, noise: float) -> list[Array]:
    """Make two views whose pixels move in some modes, one weaker than the other."""
    rng = np.random.default_rng(modes)
    shape = rng.normal(size=(modes, COLUMNS)) * np.geomspace(1.0, 0.1, modes)[:, None]
    return [
        rng.normal(size=(PIXELS, modes)) @ shape + noise * rng.normal(size=(PIXELS, COLUMNS))
        for _ in range(2)
    ]


def modes_of(data: list[Array], expected: float) -> Array:
    return FrequencyModes.from_data(data, np.full(COLUMNS, expected)).combination


@pytest.mark.one_in(2)
@pytest.mark.parametrize("modes", [1, 7, 40])
@pytest.mark.parametrize("noise", [0.0, NOISE])
def test_few_modes_are_those_of_the_whole_matrix(
    modes: int, noise: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They span the same, whether Lanczos' steps end at all of them or after more."""
    data, expected = data_of(modes, noise), 2 * PIXELS * noise**2
    few = modes_of(data, expected)
    gram = np.sum([d.T @ d for d in data], axis=0)
    of_gram = FrequencyModes.of_gram(gram, np.full(COLUMNS, expected)).combination
    monkeypatch.setattr(compression, "MANY", COLUMNS)
    whole = modes_of(data, expected)
    assert few.shape == of_gram.shape == whole.shape
    for found in (few, of_gram):
        np.testing.assert_allclose(found.T @ found, whole.T @ whole, atol=1e-10)


def test_nothing_moves() -> None:
    assert modes_of([np.zeros((PIXELS, COLUMNS))] * 2, 0.0).shape == (1, COLUMNS)


def test_data_of_as_many_modes_as_pixels_need_the_whole_matrix() -> None:
    rng = np.random.default_rng(3)
    data = [d + rng.normal(size=d.shape) for d in data_of(3, 0.0)]
    assert len(modes_of(data, 0.0)) > compression.MOST_LEADING * COLUMNS
