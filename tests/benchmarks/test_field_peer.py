"""Point by point against the peer `pyCFS`: `combine_3D` of its `data.extras.psv_io`, three views.

The peer (MIT licence) is not among the extras of this package: it pins numpy to one older version,
pulls in numba, matplotlib and h5py, and takes seconds to import. Where it is installed, these tests
run; ``pip install pyCFS`` into an environment of its own beside this package.

It solves one 3 x 3 system for every point, frequency, and real and imaginary part, whose rows are
multiplied by the velocities themselves; so where a velocity is exactly 0 its matrix is singular.
Its right-hand sides are vectors as numpy 1 took them; numpy 2 refuses them, so its call of `solve`
gets numpy 1's rule here. Ratios are asserted at full size only, with ``SLDVEXP_BENCHMARK=1``.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from unittest import mock

import numpy as np
import pytest

from sldvexp.reconstruction import Absolute

FULL_SIZE = os.environ.get("SLDVEXP_BENCHMARK") == "1"
POINTS, FREQUENCIES = (4000, 256) if FULL_SIZE else (200, 8)
#: Measured 39, in seconds of the processor.
FASTER_THAN_PEER = 25.0
STANDS = np.array([[0.0, -0.5, 1.6], [0.6, 0.5, 1.5], [-0.5, 0.4, 1.5]])
STD = 1e-6

Arrays = tuple[np.ndarray, np.ndarray, np.ndarray]


@pytest.fixture(scope="module")
def combine() -> Callable[..., dict]:
    return pytest.importorskip("pyCFS.data.extras.psv_io").combine_3D


@pytest.fixture(scope="module")
def data() -> Arrays:
    """Points of a bent surface, their true velocities, and what three views see of them."""
    rng = np.random.default_rng(23)
    x, y = rng.uniform(-0.2, 0.2, (2, POINTS))
    position = np.stack([x, y, 0.1 * x**2], axis=1)
    truth = rng.normal(size=(POINTS, 3, FREQUENCIES, 2)).view(complex)[..., 0] * [[1], [1], [50]]
    return position, truth, np.einsum("vpa,paf->vpf", towards(position), truth)


def towards(position: np.ndarray) -> np.ndarray:
    """Direction cosines from every point to the three instruments."""
    sight = STANDS[:, None] - position
    return sight / np.linalg.norm(sight, axis=-1, keepdims=True)


def of_peer(combine: Callable[..., dict], position: np.ndarray, seen: np.ndarray) -> np.ndarray:
    solve = np.linalg.solve

    def solve_vectors(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return solve(a, b[..., None])[..., 0]

    views = [
        {"Coordinates": position, "psv_coord": stand, "data": v}
        for stand, v in zip(STANDS, seen, strict=True)
    ]
    with mock.patch("numpy.linalg.solve", solve_vectors):
        return np.swapaxes(combine(*views)["data3D"], 1, 2)


def ours(position: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """The velocity; its standard errors and bounds are computed as well."""
    return Absolute().reconstruct(towards(position), seen, std=[STD] * len(STANDS)).velocity


def test_same_answer_as_the_peer(combine: Callable[..., dict], data: Arrays) -> None:
    position, truth, seen = data
    found = ours(position, seen)
    scale = np.abs(truth).max()
    np.testing.assert_allclose(found, of_peer(combine, position, seen), rtol=0, atol=1e-9 * scale)
    np.testing.assert_allclose(found, truth, rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("part", [1, 1j, 1 + 1j], ids=["real", "imaginary", "both"])
def test_a_velocity_of_exactly_zero_is_no_failure(data: Arrays, part: complex) -> None:
    """A view sees nothing of a point: its velocity is at right angles to that beam."""
    position, truth, seen = data
    seen = seen.copy()
    at, line = POINTS // 2, FREQUENCIES // 2
    value = seen[1, at, line]
    seen[1, at, line] = value - (value.real * part.real + 1j * value.imag * part.imag)
    result = Absolute().reconstruct(towards(position), seen, std=[STD] * len(STANDS))
    assert all(np.isfinite(a).all() for a in (result.velocity, result.std, result.confidence))
    expected = np.linalg.solve(towards(position)[:, at], seen[:, at, line])
    np.testing.assert_allclose(result.velocity[at, :, line], expected, rtol=1e-10)
    others = np.ones(truth.shape, bool)
    others[at, :, line] = False
    scale = np.abs(truth).max()
    np.testing.assert_allclose(result.velocity[others], truth[others], rtol=0, atol=1e-12 * scale)


def test_the_peer_fails_at_zero(combine: Callable[..., dict], data: Arrays) -> None:
    """Which is why it is compared where it is defined."""
    position, _, seen = data
    seen = seen[:, :10].copy()
    seen[1, 5, 0] = 0
    with pytest.raises(np.linalg.LinAlgError):
        of_peer(combine, position[:10], seen)


@pytest.mark.skipif(not FULL_SIZE, reason="takes half a minute; set SLDVEXP_BENCHMARK=1")
def test_faster_than_the_peer(combine: Callable[..., dict], data: Arrays) -> None:
    """Ours has standard errors and bounds of every number, the peer has none."""
    position, _, seen = data
    took = {"ours": np.inf, "peer": np.inf}
    for _ in range(5):
        for name, work in {
            "ours": lambda: ours(position, seen),
            "peer": lambda: of_peer(combine, position, seen),
        }.items():
            start = time.process_time()
            work()
            took[name] = min(took[name], time.process_time() - start)
    print(f"{POINTS} points x 3 views x {FREQUENCIES} frequencies, seconds:")
    print(", ".join(f"{name} {t:.4f}" for name, t in took.items()), end="; ")
    print(f"ratio {took['peer'] / took['ours']:.1f}")
    assert took["peer"] > FASTER_THAN_PEER * took["ours"]
