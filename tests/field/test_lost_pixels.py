"""Fields of which many pixels are lost at random: what is left has true bounds or no value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import sldvexp.field.equations.system as field_system
from sldvexp.config.registry import get
from sldvexp.field import VolumeVisibility
from sldvexp.field.bounds.efficiency import UNKNOWN
from sldvexp.field.estimate import solve_field
from sldvexp.laser import TwoMirror
from sldvexp.reconstruction import Model
from sldvexp.volume import SampleRule

Make = Callable[..., Any]
DRAWS = 200


@pytest.fixture
def spoiled(
    make_plate: Make, make_views: Make, six_points: SampleRule, laser: TwoMirror
) -> Callable[..., VolumeVisibility]:
    """Five views of noise, from whose pixels so large a part is lost, by the draws of a seed."""

    def looks(part: float, seed: int, draws: int = 1) -> VolumeVisibility:
        rng, views = np.random.default_rng(seed), make_views(5, pixels=20, frequencies=draws)
        views = [replace(v, flags=(rng.random(len(v.flags)) < part).astype(int)) for v in views]
        noise = np.random.default_rng(6)
        views = [
            replace(v, velocity=v.std[:, None] * (noise.normal(size=(400, draws, 2)) @ [1, 1j]))
            for v in views
        ]
        return VolumeVisibility(views, laser, make_plate((5, 5), 3), six_points)

    return looks


@pytest.mark.one_in(6)
@pytest.mark.parametrize(
    ("name", "fields", "part", "seed"),
    [
        ("contravariant", {"rows": "all"}, 0.3, 5),  # of 33 variances 8 were negative
        ("contravariant", {"rows": "1-4,2,3"}, 0.2, 4),
        ("absolute", {}, 0.2, 0),
        ("absolute", {}, 0.3, 1),
        ("absolute", {"model": Model.full}, 0.2, 2),
        ("relative", {}, 0.2, 2),  # largest standard error: 5e15 m/s
    ],
)
def test_values_that_are_left_have_bounds_that_hold(
    spoiled: Callable[..., VolumeVisibility],
    name: str, fields: dict[str, Any], part: float, seed: int,
) -> None:  # fmt: skip
    method = get("reconstruction", name)(**fields)
    result = solve_field(spoiled(part, seed, DRAWS), method, get("solver", "direct")())
    assert result.std_noise is not None
    known = result.observable
    assert 0 < known.sum() < known.size
    assert np.isfinite(result.velocity[known]).all()
    assert np.isfinite(result.std_noise[known]).all()
    assert np.isnan(result.velocity[~known]).all()
    assert set(result.flagged_node) == set(np.flatnonzero(~known.all(axis=1)))
    parts = np.concatenate([result.velocity.real, result.velocity.imag], axis=2)[known]
    ratio = np.sqrt((parts**2).mean(axis=1)) / result.std_noise[known][:, 0]
    assert np.abs(ratio - 1).max() < 4.5 / np.sqrt(4 * DRAWS)
    assert result.cond > 0


@pytest.mark.parametrize(
    ("part", "seed", "small"),
    [(0.4, 3, True), pytest.param(0.3, 5, True, marks=pytest.mark.whole), (0.4, 3, False)],
)
def test_efficiency_that_is_not_known_is_said(
    spoiled: Callable[..., VolumeVisibility],
    monkeypatch: pytest.MonkeyPatch, part: float, seed: int, small: bool,
) -> None:  # fmt: skip
    """The best field of all views may be open where that of samples one by one is not."""
    if not small:
        monkeypatch.setattr(field_system, "SMALL", 0)
    method = get("reconstruction", "contravariant")(rows="all")
    result = solve_field(spoiled(part, seed), method, get("solver", "iterative")())
    assert result.observable.any()
    assert result.efficiency is not None
    assert np.isnan(result.efficiency).all()
    assert UNKNOWN in result.messages
    assert "efficiency" not in repr(result)
