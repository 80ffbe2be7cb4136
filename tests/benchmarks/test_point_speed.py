"""Point velocities with bounds against a loop of `lstsq`, and against copying the same arrays.

Figures are asserted at full size only, with ``SLDVEXP_BENCHMARK=1``; otherwise a small problem is
checked for agreement with the loop.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping

import numpy as np
import pytest

from sldvexp.reconstruction import Absolute, Combined, Relative

FULL_SIZE = os.environ.get("SLDVEXP_BENCHMARK") == "1"
VIEWS, POINTS, FREQUENCIES = (5, 100_000, 64) if FULL_SIZE else (5, 300, 4)
LOOP_POINTS = 1000 if FULL_SIZE else 30
FASTER_THAN_LOOP = 5.0
SLOWER_THAN_COPY = 4.0


@pytest.fixture(scope="module")
def data() -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(17)
    directions = rng.normal(size=(VIEWS, POINTS, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    velocity = np.empty((VIEWS, POINTS, FREQUENCIES), complex)
    for view in velocity:
        view.real, view.imag = rng.normal(size=(2, POINTS, FREQUENCIES))
    return directions, velocity


def seconds(works: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Shortest time of each in several rounds of all: the one that others disturbed least."""
    shortest = dict.fromkeys(works, np.inf)
    for _ in range(rounds):
        for name, work in works.items():
            start = time.perf_counter()
            work()
            shortest[name] = min(shortest[name], time.perf_counter() - start)
    return shortest


def loop(directions: np.ndarray, velocity: np.ndarray, points: range) -> list[np.ndarray]:
    """What a user would write, without any bounds: every frequency is a right-hand side."""
    return [np.linalg.lstsq(directions[:, p], velocity[:, p], rcond=None)[0] for p in points]


def test_agrees_with_the_loop(data: tuple[np.ndarray, np.ndarray]) -> None:
    points = range(0, POINTS, POINTS // LOOP_POINTS)
    result = Absolute().reconstruct(*data)
    np.testing.assert_allclose(result.velocity[points], loop(*data, points), rtol=1e-9, atol=1e-9)


@pytest.mark.skipif(not FULL_SIZE, reason="takes half a minute and 3 GB; set SLDVEXP_BENCHMARK=1")
def test_faster_than_a_loop_and_near_the_speed_of_copying(
    data: tuple[np.ndarray, np.ndarray],
) -> None:
    """Velocity, std and confidence are all computed into new arrays within the time counted.

    The copy's destinations exist and were written to before: it pays for no new pages.
    """
    method = Absolute()
    result = method.reconstruct(*data)
    sources = (data[1], result.velocity, result.std, result.confidence)
    targets = [np.ones_like(a) for a in sources]

    def copy() -> None:
        for target, source in zip(targets, sources, strict=True):
            np.copyto(target, source)

    points = range(0, POINTS, POINTS // LOOP_POINTS)
    took = seconds(
        {
            "ours": lambda: method.reconstruct(*data),
            "copy": copy,
            "loop": lambda: loop(*data, points),
        },
        rounds=9,
    )
    took["loop"] *= POINTS / LOOP_POINTS
    others = {
        "relative": lambda: Relative().reconstruct(*data),
        "combined, best": lambda: Combined().reconstruct(*data),
    }
    took |= seconds(others, rounds=2)
    print(f"{POINTS} points x {VIEWS} views x {FREQUENCIES} frequencies, seconds:")
    print(", ".join(f"{name} {time:.3f}" for name, time in took.items()))
    assert took["loop"] > FASTER_THAN_LOOP * took["ours"]
    assert took["ours"] < SLOWER_THAN_COPY * took["copy"]
