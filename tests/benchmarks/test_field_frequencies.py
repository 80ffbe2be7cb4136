"""Many frequencies of a field against one of them: matrices do not depend on the frequency.

The ratio is asserted at full size only, with ``SLDVEXP_BENCHMARK=1``; otherwise a small problem is
checked: every column of many frequencies is what that frequency gives alone.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sldvexp.field import FieldResult, Iterative, VolumeVisibility
from sldvexp.field.bounds import compiled
from sldvexp.field.estimate import solve_field
from sldvexp.field.streaming.compression import FEW
from sldvexp.reconstruction import Absolute, Contravariant, Reconstruction

FULL_SIZE = os.environ.get("SLDVEXP_BENCHMARK") == "1"
SHAPE, PIXELS, FREQUENCIES = ((48, 48), 60, 256) if FULL_SIZE else ((4, 4), 12, 12)
#: Times one frequency; of the first of the methods 5.1 was measured on a busy machine.
MOST_TIME = 15.0
#: Bounds of many frequencies leave out what is below the noise (see `FrequencyModes`): 0.2 % here.
SAME, SAME_BOUNDS = 1e-12, 0.01
METHODS = [Contravariant(rows="all"), Absolute()]


@pytest.fixture(scope="module")
def many(make_looks: Callable[..., VolumeVisibility]) -> VolumeVisibility:
    return make_looks(SHAPE, PIXELS, FREQUENCIES)


def only(looks: VolumeVisibility, frequency: int | slice) -> VolumeVisibility:
    """The same views with one or some of their frequencies."""
    column = frequency if isinstance(frequency, slice) else slice(frequency, frequency + 1)
    views = [replace(v, velocity=v.velocity[:, column].copy()) for v in looks.views]
    return VolumeVisibility(views, looks.laser, looks.prisms, looks.rule)


def field(looks: VolumeVisibility, method: Reconstruction) -> FieldResult:
    return solve_field(looks, method, Iterative())


def columns(
    looks: VolumeVisibility, method: Reconstruction, names: Sequence[str]
) -> Iterator[tuple[str, Any, Any]]:
    """Results of some frequencies: among all frequencies, and alone."""
    together = field(looks, method)
    for frequency in (0, looks.views[0].velocity.shape[1] - 1):
        alone = field(only(looks, frequency), method)
        for name in names:
            yield name, getattr(together, name)[..., frequency], getattr(alone, name)[..., 0]


@pytest.mark.one_in(2)
@pytest.mark.skipif(FULL_SIZE, reason="done at small size")
@pytest.mark.parametrize("method", METHODS, ids=lambda m: type(m).__name__.lower())
def test_a_column_is_what_its_frequency_gives_alone(
    many: VolumeVisibility, method: Reconstruction
) -> None:
    for name, together, alone in columns(
        many, method, ["velocity", "std_noise", "sse", "residual_std_by_view"]
    ):
        scale = np.abs(alone).max()
        np.testing.assert_allclose(together, alone, rtol=0, atol=SAME * scale, err_msg=name)


@pytest.mark.whole
@pytest.mark.skipif(FULL_SIZE, reason="done at small size")
@pytest.mark.parametrize("method", METHODS, ids=lambda m: type(m).__name__.lower())
def test_bounds_of_many_frequencies(many: VolumeVisibility, method: Reconstruction) -> None:
    """The poses' part is that of a few combinations of frequencies, which leave out noise only.

    As many frequencies as such combinations are not combined: bounds are then the same.
    """
    few = only(many, slice(0, FEW // 2))  # of two columns each
    for looks, tolerance in ((few, SAME), (many, SAME_BOUNDS)):
        for _, together, alone in columns(looks, method, ["confidence"]):
            np.testing.assert_allclose(together, alone, rtol=tolerance, atol=0)


def seconds(work: Callable[[], object]) -> float:
    """Of the processor: what else the machine does counts little."""
    start = time.process_time()
    work()
    return time.process_time() - start


@pytest.mark.skipif(not FULL_SIZE, reason="takes minutes and 3 GB; set SLDVEXP_BENCHMARK=1")
@pytest.mark.parametrize("method", METHODS, ids=lambda m: type(m).__name__.lower())
def test_many_frequencies_cost_little_more_than_one(
    many: VolumeVisibility, method: Reconstruction, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With all bounds, of every frequency.

    Both without compiled kernels: these make faster what one frequency needs as many do, so that
    with them the ratio would say how good kernels are.
    """
    monkeypatch.setattr(compiled, "WORTHWHILE", sys.maxsize)
    one = only(many, FREQUENCIES // 2)
    took = {"one": np.inf}
    for _ in range(2):
        took["one"] = min(took["one"], seconds(lambda: field(one, method)))
    took["all"] = seconds(lambda: field(many, method))
    print(f"{type(method).__name__}, {many.prisms.nodes} nodes: 1 frequency", end=" ")
    print(f"{took['one']:.2f} s, {FREQUENCIES} frequencies {took['all']:.2f} s", end=", ")
    print(f"ratio {took['all'] / took['one']:.1f}")
    assert took["all"] < MOST_TIME * took["one"]


#: Of 4,096 frequencies over one, of a small field; measured 13. And MB; measured 1,530.
MOST_TIME_OF_THOUSANDS, LARGEST = 20.0, 2000

#: What a process of its own does, so that its largest memory is that of one field.
PROCESS = """
import time
from conftest import largest_memory, looks_at
from sldvexp.field import Iterative
from sldvexp.field.estimate import solve_field
from sldvexp.reconstruction import Contravariant

solve_field(looks_at((5, 5), 10), Contravariant(), Iterative())
looks = looks_at((8, 8), 30, {frequencies})
start = time.process_time()
solve_field(looks, Contravariant(), Iterative())
print(time.process_time() - start, largest_memory())
"""


@pytest.mark.skipif(not FULL_SIZE, reason="takes 2 GB; set SLDVEXP_BENCHMARK=1")
def test_thousands_of_frequencies() -> None:
    """With all bounds; the few modes of the data are found without those of the noise."""
    cost = {}
    for frequencies in (1, 256, 4096):
        made = subprocess.run(
            [sys.executable, "-c", PROCESS.format(frequencies=frequencies)],
            cwd=os.path.dirname(__file__),
            env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            capture_output=True,
            text=True,
            check=True,
        )
        cost[frequencies] = tuple(map(float, made.stdout.split()))
    print({f: f"{t:.2f} s, {mb:.0f} MB" for f, (t, mb) in cost.items()})
    assert cost[4096][0] <= MOST_TIME_OF_THOUSANDS * cost[1][0]
    assert cost[4096][1] <= LARGEST
