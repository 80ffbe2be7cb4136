"""The light of a Gaussian spot inside a disc."""

from __future__ import annotations

import numpy as np
import pytest

from sldvexp.geometry.blurred_disc import part_and_changes, part_of_disc


@pytest.mark.parametrize("slender", [1.0, 2.0, 3.0])
@pytest.mark.parametrize("width", [0.01, 0.1, 0.3, 1.0])
def test_the_same_by_counting(width: float, slender: float) -> None:
    rng = np.random.default_rng(3)
    turned = np.array([[0.8, -0.6], [0.6, 0.8]])
    root = turned * (width * np.array([1.0, 1.0 / slender]))
    middle = np.array([0.9, 0.3])
    drawn = middle + rng.normal(size=(200_000, 2)) @ root.T
    share = np.mean(np.sum(drawn**2, axis=1) < 1.0)
    part = part_of_disc(middle, root @ root.T)
    assert float(part) == pytest.approx(share, abs=4.5 * 0.5 / np.sqrt(200_000))


def test_in_the_middle_of_a_disc() -> None:
    """A round spot there leaves out exp(-1 / (2 width^2))."""
    width = np.array([0.2, 0.5, 1.0, 3.0])
    covariance = width[:, None, None] ** 2 * np.eye(2)
    part = part_of_disc(np.zeros((4, 2)), covariance)
    assert part == pytest.approx(1.0 - np.exp(-0.5 / width**2), abs=1e-12)


def test_half_as_many_nodes() -> None:
    slender = np.diag([0.1, 0.1 / np.cos(np.radians(70.0))]) ** 2
    turn = np.linspace(0, np.pi, 50)
    middle = 1.1 * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    assert part_of_disc(middle, slender, 32) == pytest.approx(
        part_of_disc(middle, slender), abs=2e-5
    )


def test_without_extent_it_is_in_or_out() -> None:
    middle = np.array([[0.999, 0.0], [0.0, 1.001]])
    assert part_of_disc(middle, np.zeros((2, 2))).tolist() == [1.0, 0.0]


@pytest.mark.parametrize("width", [0.02, 0.1, 0.3, 1.0])
def test_changes_with_place_and_size(width: float) -> None:
    """As differences have them, also of spots that reach over the whole disc."""
    root = width * np.array([[0.8, -0.3], [0.6, 0.4]])
    light, rng = root @ root.T, np.random.default_rng(3)
    middle = np.array([0.9, 0.3]) + 2.0 * width * rng.uniform(-1.0, 1.0, (20, 2))
    part, gradient, hessian = part_and_changes(middle, light)
    assert part == pytest.approx(part_of_disc(middle, light), abs=0.0)
    for axis, step in enumerate(1e-4 * width * np.eye(2)):
        ends = [part_and_changes(middle + by, light)[:2] for by in (step, -step)]
        by_place, twice = ((a - b) / (2e-4 * width) for a, b in zip(*ends, strict=True))
        assert gradient[:, axis] == pytest.approx(by_place, abs=1e-6 / width)
        assert hessian[:, axis] == pytest.approx(twice, abs=1e-6 / width**2)
    wider = np.array([[0.0, 1.0], [1.0, 0.0]]) * 1e-4 * width**2
    by_size = (part_of_disc(middle, light + wider) - part_of_disc(middle, light - wider)) / 2e-4
    assert hessian[:, 0, 1] * width**2 == pytest.approx(by_size, abs=1e-6)
