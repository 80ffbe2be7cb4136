"""Homographies and camera matrices by the direct linear transformation."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.image.assignment import apply, fit_projection

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_exact_images_give_the_map_back(dimensions: int) -> None:
    points = RNG.uniform(-5.0, 5.0, (3, 20, dimensions))
    projection = RNG.normal(size=(3, 3, dimensions + 1)) * [[100.0], [100.0], [0.05]]
    projection[:, 2, -1] = 1.0
    image, _ = apply(projection, points)
    found, residual = fit_projection(points, image + 4000.0)
    assert np.all(residual < 1e-4)
    assert apply(found, points)[0] == pytest.approx(image + 4000.0, abs=1e-3)


def test_residual_is_the_root_mean_square_distance() -> None:
    """Of as many points as there are: the map's eight numbers take their part of the noise."""
    points = RNG.uniform(-5.0, 5.0, (200, 2))
    noise = RNG.normal(0.0, 0.5, (200, 2))
    _, residual = fit_projection(points, 100.0 * points + noise)
    assert residual == pytest.approx(np.sqrt((noise**2).sum(axis=1).mean()), rel=0.05)


def test_points_on_both_sides_of_the_horizon_are_no_image() -> None:
    points = RNG.uniform(-5.0, 5.0, (30, 2))
    horizon = np.array([[100.0, 0.0, 0.0], [0.0, 100.0, 0.0], [0.5, 0.0, 1.0]])
    image, depth = apply(horizon, points)
    assert depth.min() < 0 < depth.max()
    _, residual = fit_projection(points, image)
    assert np.isinf(residual)


def test_a_missing_image_point_spoils_only_its_own_map() -> None:
    points = RNG.uniform(-5.0, 5.0, (10, 2))
    images = np.stack([100.0 * points, 100.0 * points])
    images[0, 4] = np.nan
    _, residual = fit_projection(points, images)
    assert np.isinf(residual[0])
    assert residual[1] < 1e-6
