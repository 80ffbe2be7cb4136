"""Many frequencies of a field against one of them: matrices do not depend on the frequency.

The ratio is asserted at full size only, with ``SLDVEXP_BENCHMARK=1``; otherwise a small problem is
checked: every column of many frequencies is what that frequency gives alone.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sldvexp.field.estimate import estimate_field
from sldvexp.field.frequency_modes import FEW
from sldvexp.field.looks import Looks
from sldvexp.field.result import FieldResult
from sldvexp.field.solvers.iterative import Iterative
from sldvexp.field.view import View
from sldvexp.laser.model import project
from sldvexp.laser.two_mirror import Mirror, TwoMirror
from sldvexp.reconstruction.absolute import Absolute
from sldvexp.reconstruction.base import Reconstruction
from sldvexp.reconstruction.contravariant import Contravariant
from sldvexp.volume.base import Samples
from sldvexp.volume.grid import Grid

FULL_SIZE = os.environ.get("SLDVEXP_BENCHMARK") == "1"
SHAPE, PIXELS, FREQUENCIES = ((48, 48), 60, 256) if FULL_SIZE else ((4, 4), 12, 12)
#: Times one frequency.
MOST_TIME = 15.0
SAME, SAME_BOUNDS = 1e-12, 0.01
LASER = TwoMirror(mirror_offset=0.045, up_down=Mirror(25), left_right=Mirror(25))
STANDS = [[0.0, -0.5, 1.6], [0.6, 0.5, 1.5], [0.3, 0.3, 1.6], [-0.5, 0.4, 1.5], [0.6, -0.2, 1.5]]
SIDE, STD, MODES = 0.4, 1e-3, 6
METHODS = [Contravariant(rows="all"), Absolute()]


def view(name: str, origin: np.ndarray, rng: np.random.Generator) -> View:
    """A lattice of pixels over the plate that sees some modes, and noise; a pose to 0.1 mm."""
    z = -origin / np.linalg.norm(origin)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(z, x), z])
    corner = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-0.1, 0.1)])
    in_laser = (1.1 * SIDE / 2 * corner - origin) @ rotation.T
    dac = LASER.dac_from_angle(project(in_laser, LASER.mirror_offset))
    axes = np.linspace(dac.min(axis=0), dac.max(axis=0), PIXELS).T
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    shapes = np.cos(lattice @ (1e-3 * np.arange(1, 2 * MODES + 1).reshape(2, MODES)))
    lines = np.linspace(0.0, MODES, FREQUENCIES)
    response = 1 / (np.arange(MODES)[:, None] + 0.5 - lines + 0.05j)
    noise = STD * rng.normal(size=(len(lattice), FREQUENCIES, 2)).view(complex)[..., 0]
    covariance = np.diag([1e-4] * 6) ** 2
    std, flags = np.full(len(lattice), STD), np.zeros(len(lattice), int)
    velocity = shapes @ response + noise
    return View(name, rotation, origin, covariance, lattice, velocity, std, flags, (PIXELS, PIXELS))


@pytest.fixture(scope="module")
def many() -> Looks:
    rng = np.random.default_rng(29)
    views = [view(str(k + 1), np.array(stand), rng) for k, stand in enumerate(STANDS)]
    volume = Grid(size=[SIDE, SIDE], shape=list(SHAPE), layers=7, thickness=0.024)
    return Looks(views, LASER, volume.prisms(), Samples(3, 2).rule())


def only(looks: Looks, frequency: int | slice) -> Looks:
    """The same views with one or some of their frequencies."""
    column = frequency if isinstance(frequency, slice) else slice(frequency, frequency + 1)
    views = [replace(v, velocity=v.velocity[:, column].copy()) for v in looks.views]
    return Looks(views, looks.laser, looks.prisms, looks.rule)


def field(looks: Looks, method: Reconstruction) -> FieldResult:
    return estimate_field(looks, method, Iterative())


def columns(looks: Looks, method: Reconstruction, name: str) -> Iterator[tuple[Any, Any]]:
    """One result of some frequencies: among all frequencies, and alone."""
    together = field(looks, method)
    for frequency in (0, looks.views[0].velocity.shape[1] - 1):
        alone = getattr(field(only(looks, frequency), method), name)[..., 0]
        yield getattr(together, name)[..., frequency], alone


@pytest.mark.skipif(FULL_SIZE, reason="done at small size")
@pytest.mark.parametrize("method", METHODS, ids=lambda m: type(m).__name__.lower())
@pytest.mark.parametrize("name", ["velocity", "std_noise", "sse", "residual_std_by_view"])
def test_a_column_is_what_its_frequency_gives_alone(
    many: Looks, method: Reconstruction, name: str
) -> None:
    for together, alone in columns(many, method, name):
        scale = np.abs(alone).max()
        np.testing.assert_allclose(together, alone, rtol=0, atol=SAME * scale)


@pytest.mark.skipif(FULL_SIZE, reason="done at small size")
@pytest.mark.parametrize("method", METHODS, ids=lambda m: type(m).__name__.lower())
def test_bounds_of_many_frequencies(many: Looks, method: Reconstruction) -> None:
    """The poses' part is that of a few combinations of frequencies, which leave out noise only.

    As many frequencies as such combinations are not combined: bounds are then the same.
    """
    few = only(many, slice(0, FEW // 2))  # of two columns each
    for name, looks, tolerance in (("confidence", few, SAME), ("confidence", many, SAME_BOUNDS)):
        for together, alone in columns(looks, method, name):
            np.testing.assert_allclose(together, alone, rtol=tolerance, atol=0)


def seconds(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


@pytest.mark.skipif(not FULL_SIZE, reason="takes minutes and 3 GB; set SLDVEXP_BENCHMARK=1")
@pytest.mark.parametrize("method", METHODS, ids=lambda m: type(m).__name__.lower())
def test_many_frequencies_cost_little_more_than_one(
    many: Looks, method: Reconstruction, capsys: pytest.CaptureFixture[str]
) -> None:
    """With all bounds, of every frequency."""
    one = only(many, FREQUENCIES // 2)
    took = {"one": np.inf}
    for _ in range(2):
        took["one"] = min(took["one"], seconds(lambda: field(one, method)))
    took["all"] = seconds(lambda: field(many, method))
    with capsys.disabled():
        print(f"\n{type(method).__name__}, {many.prisms.nodes} nodes: 1 frequency", end=" ")
        print(f"{took['one']:.2f} s, {FREQUENCIES} frequencies {took['all']:.2f} s", end=", ")
        print(f"ratio {took['all'] / took['one']:.1f}")
    assert took["all"] < MOST_TIME * took["one"]
