"""Circles whose motion grows over them are found where circles are that move evenly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from sldvexp.image import (
    ScanLineEdges,
    ScanLines,
    even_edges,
    even_motion,
    fit_circle,
    gradient_edges,
    profile_edges,
)

RADIUS, SPOT = 800.0, 80.0
#: Growth of the motion over a radius, as at 70 degrees at 1.5 m over 15 mm.
GROWTH = np.array([0.01, -0.004])
WINDOW = 3
Place = Callable[[ScanLines, int, int], ScanLineEdges]


def scanned(growth: np.ndarray, noise: float, seed: int = 0, lines: int = 44) -> ScanLines:
    """Fine lines from inside a circle of the centre (0, 0) across its edge, not quite centred."""
    rng = np.random.default_rng(seed)
    turn = 2 * np.pi * (np.arange(lines) + 0.3) / lines
    out = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    away = RADIUS + 17.0 * (np.arange(25) - 12) + rng.uniform(-20, 20, (lines, 1))
    position = away[..., None] * out[:, None]
    motion = 3.0 * ndtr((RADIUS - away) / SPOT) * (1.0 + position @ growth / RADIUS)
    std = np.full(motion.shape, 3.0 * max(noise, 1e-5))
    return ScanLines(
        motion + 3.0 * noise * rng.normal(size=motion.shape),
        std,
        position,
        np.zeros(motion.shape, bool),
    )


def centre(lines: ScanLines, method: Place = profile_edges) -> np.ndarray:
    return fit_circle(even_edges(lines, method, WINDOW))[0].ellipse.centre


@pytest.mark.parametrize("method", [profile_edges, gradient_edges])
def test_a_motion_that_grows_over_a_circle_does_not_displace_it(method: Place) -> None:
    """Uncorrected it does by 0.2 steps."""
    even, uneven = (centre(scanned(g, 0.0), method) for g in (0 * GROWTH, GROWTH))
    assert np.abs(uneven - even).max() < 0.01


def test_an_even_motion_stays_as_it_is() -> None:
    lines = scanned(0 * GROWTH, 0.0)
    even = even_motion(lines, even_edges(lines, profile_edges, WINDOW))
    assert np.abs(even.magnitude - lines.magnitude).max() < 3e-4 * 3.0


def test_pixels_and_edges_that_are_wrong_do_not_tell_the_motion() -> None:
    lines = scanned(GROWTH, 0.002)
    magnitude, flag = lines.magnitude.copy(), lines.flag.copy()
    magnitude[5, 2:5] *= 1.5
    magnitude[17] = magnitude[17, ::-1]
    magnitude[30, 4], flag[30, 4] = np.nan, True
    spoiled = replace(lines, magnitude=magnitude, flag=flag)
    assert centre(spoiled) == pytest.approx(centre(lines), abs=0.1)


def test_circles_on_which_nothing_moves_stay_as_they_are() -> None:
    lines = scanned(GROWTH, 0.002)
    edges = even_edges(lines, profile_edges, WINDOW)
    still = replace(lines, magnitude=np.zeros_like(lines.magnitude))
    assert np.array_equal(even_motion(still, edges).magnitude, still.magnitude)
    none = even_edges(still, profile_edges, WINDOW)
    assert even_motion(still, none) is still


@pytest.mark.whole
def test_bounds_of_the_centre_hold() -> None:
    """The growth that noise makes adds next to nothing."""
    scores = []
    for seed in range(60):
        fit, _ = fit_circle(even_edges(scanned(GROWTH, 0.005, seed), profile_edges, WINDOW))
        scores.append(fit.ellipse.centre / np.sqrt(np.diag(fit.ellipse.covariance)[:2]))
    assert np.mean(np.square(scores)) == pytest.approx(1.0, abs=4.5 * np.sqrt(2 / 120))
