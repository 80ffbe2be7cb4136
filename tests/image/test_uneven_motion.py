"""Circles whose motion grows over them are found where circles are that move evenly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from sldvexp.geometry import conic
from sldvexp.geometry.blurred_disc import part_of_disc
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


def oblique(width: float, growth: float, noise: float, seed: int) -> tuple[ScanLines, np.ndarray]:
    """Fine lines across a circle at 60 degrees whose motion grows along its smaller axis.

    Parameters
    ----------
    width : float
        Of a round spot, over the smaller semi-axis; the lines lie .3 of it beside the circle.
    growth : float
        Over the smaller semi-axis.

    Returns
    -------
    ScanLines
    numbers : ndarray, shape (5,)
        Of the ellipse.
    """
    cosine, sine = np.cos(0.3 + 0.1 * seed), np.sin(0.3 + 0.1 * seed)
    axes = np.array([[cosine, sine], [-sine, cosine]])
    smaller = RADIUS / 2.0
    shape = axes.T @ np.diag([RADIUS**2, smaller**2]) @ axes
    numbers = np.array([-900.3, 1100.6, shape[0, 0], shape[1, 1], shape[0, 1]])
    spot, rng = width * smaller, np.random.default_rng(seed)
    rough = numbers + np.array([0.3 * spot, -0.2 * spot, 0.0, 0.0, 0.0])
    points, normals = conic.boundary(rough, 2 * np.pi * (np.arange(44) + 0.5) / 44)
    ahead = np.ceil(2.5 * spot / 12) * normals / np.abs(normals).max(axis=-1, keepdims=True)
    position = np.round(points[:, None] + (np.arange(25) - 12)[:, None] * ahead[:, None])
    away = position - numbers[:2]
    to_disc = np.linalg.inv(np.linalg.cholesky(shape))
    part = part_of_disc(away @ to_disc.T, spot**2 * to_disc @ to_disc.T)
    motion = part * (1.0 + growth / smaller * away @ axes[1])
    std = np.full(motion.shape, max(noise, 1e-4))
    noisy = motion + noise * rng.normal(size=motion.shape)
    return ScanLines(noisy, std, position, np.zeros(motion.shape, bool)), numbers


@pytest.mark.whole
@pytest.mark.parametrize("width", [0.36, 0.1, 0.3])
def test_a_wide_spot_does_not_hide_the_growth(width: float) -> None:
    """As the profile of a straight edge has it, a part of the growth is taken for width and place.

    Uncorrected the ellipse is displaced by .24, 2.0 and 2.9 steps.
    """
    lines, _ = oblique(width, 0.02, 0.0, 0)
    found = fit_circle(even_edges(lines, profile_edges, WINDOW))[0].ellipse
    still = fit_circle(even_edges(oblique(width, 0.0, 0.0, 0)[0], profile_edges, WINDOW))[0].ellipse
    assert np.abs(found.centre - still.centre).max() < 0.02


def scores(width: float, growth: float, seeds: range) -> np.ndarray:
    """Errors of the centre along larger and smaller axis, over what is stated, (seed, 2)."""
    found = []
    for seed in seeds:
        lines, numbers = oblique(width, growth, 0.005, seed)
        ellipse = fit_circle(even_edges(lines, profile_edges, WINDOW))[0].ellipse
        _, axes = conic.principal_axes(numbers)
        std = np.sqrt(np.diag(axes.T @ ellipse.covariance[:2, :2] @ axes))
        found.append((ellipse.centre - numbers[:2]) @ axes / std)
    return np.array(found)


@pytest.mark.whole
def test_the_growth_that_noise_makes_is_in_the_bounds_of_an_ellipse() -> None:
    """Without it the smaller axis' mean square is 6."""
    squares = np.mean(scores(0.36, 0.0, range(24)) ** 2, axis=0)
    assert squares == pytest.approx(1.0, abs=4.5 * np.sqrt(2 / 24))


@pytest.mark.long
@pytest.mark.parametrize("width", [0.1, 0.2, 0.3, 0.36])
def test_the_growth_that_noise_makes_is_in_the_bounds_of_many_ellipses(width: float) -> None:
    """Coverage of 95 %, too, within 4 standard errors."""
    found = scores(width, 0.02, range(200))
    assert np.mean(found**2, axis=0) == pytest.approx(1.0, abs=4.5 * np.sqrt(2 / 200))
    assert np.mean(np.abs(found) < 1.96) == pytest.approx(0.95, abs=4 * np.sqrt(0.0475 / 400))


def test_pixels_that_are_noisier_make_the_shared_error_larger() -> None:
    small, large = (
        even_edges(oblique(0.3, 0.0, noise, 1)[0], profile_edges, WINDOW).growth_std
        for noise in (0.001, 0.004)
    )
    assert np.linalg.norm(large) == pytest.approx(4.0 * np.linalg.norm(small), rel=0.2)


@pytest.mark.whole
def test_bounds_of_the_centre_hold() -> None:
    """With a spot of a tenth of the circle the growth that noise makes adds next to nothing."""
    scores = []
    for seed in range(60):
        fit, _ = fit_circle(even_edges(scanned(GROWTH, 0.005, seed), profile_edges, WINDOW))
        scores.append(fit.ellipse.centre / np.sqrt(np.diag(fit.ellipse.covariance)[:2]))
    assert np.mean(np.square(scores)) == pytest.approx(1.0, abs=4.5 * np.sqrt(2 / 120))


def without_gain(lines: ScanLines, edges_per_line: int, window: int) -> ScanLineEdges:
    return replace(profile_edges(lines, edges_per_line, window), gain=None)


def test_how_pixels_move_edges_tells_what_edges_that_are_found_anew_do() -> None:
    lines = scanned(GROWTH, 0.002)
    told, found = (even_edges(lines, method, WINDOW) for method in (profile_edges, without_gain))
    np.testing.assert_array_equal(told.position, found.position)
    shared, same = (e.growth_std @ e.growth_std.T for e in (told, found))
    assert np.linalg.norm(shared - same) < 0.03 * np.linalg.norm(same)


def test_edges_are_not_found_anew_for_the_error_of_the_growth() -> None:
    """Three times in all: as they are, and on lines that were made even once and twice."""
    calls = []

    def counted(lines: ScanLines, edges_per_line: int, window: int) -> ScanLineEdges:
        calls.append(lines)
        return profile_edges(lines, edges_per_line, window)

    even_edges(scanned(GROWTH, 0.002), counted, WINDOW)
    assert len(calls) == 3


def test_pixels_that_begin_to_stand_out_are_no_error_of_the_growth() -> None:
    """Mirrors move pixels on the slope, by chance as far as what still counts.

    Found anew on lines that a standard error of the growth has changed, edges jump by up to a third
    of their own errors where such a pixel comes or goes, by 0.06 of them else.
    """
    for seed in range(6):
        lines, rng = scanned(GROWTH, 0.001, seed), np.random.default_rng(100 + seed)
        away = np.linalg.norm(lines.position, axis=-1) + rng.normal(0.0, 2.0, lines.std.shape)
        shaken = 3.0 * ndtr((RADIUS - away) / SPOT)
        edges = even_edges(replace(lines, magnitude=shaken), profile_edges, WINDOW)
        assert edges.growth_std is not None
        assert np.abs(edges.growth_std / edges.std[:, None]).max() < 0.1
