"""Whatever comes in: a sentence in time, with little memory, and nothing outside is touched.

One of thirty-five with ``-m whole``, and all of them with ``-m long``; by default what refuses each
is tried in its own room.
"""

from __future__ import annotations

import shlex
import socket
import threading
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import inputs_configuration
import inputs_files
import inputs_folders
import inputs_others
import inputs_runs
import pytest
from bench import BESIDE, HERE, Bench
from inputs import FOLDER, NEIGHBOUR, RUNS, Hostile

INPUTS: list[Hostile] = [
    each
    for module in (
        inputs_configuration,
        inputs_files,
        inputs_runs,
        inputs_folders,
        inputs_others,
    )
    for each in module.INPUTS
]
#: One of so many is not left to the long tests.
OF = 35


@pytest.fixture(scope="module")
def bench() -> Iterator[Bench]:
    """The warm process from which all calls are forked."""
    warm = Bench()
    yield warm
    warm.close()


class Runs(dict[str, Path]):
    """Folders of runs that inputs spoil, each made for the first of them."""

    def __init__(self, bench: Bench, made: Callable[[str], Path]) -> None:
        self._bench, self._made = bench, made

    def __missing__(self, name: str) -> Path:
        folder = self._made(name)
        for place in (HERE, BESIDE):
            (folder / place).mkdir()
        done = self._bench.call(folder, [*shlex.split(RUNS[name]), "hydra.run.dir=given"])
        assert done.status == 0, done.err
        self[name] = folder / HERE / "given"
        return self[name]


@pytest.fixture(scope="module")
def runs(bench: Bench, tmp_path_factory: pytest.TempPathFactory) -> Runs:
    return Runs(bench, tmp_path_factory.mktemp)


@contextmanager
def served(talk: Callable[[Any], None] | None) -> Iterator[str]:
    """Let a device talk to whoever connects; its port."""
    if talk is None:
        yield ""
        return

    def meet(client: socket.socket) -> None:
        with suppress(OSError), client:
            talk(client)

    def wait() -> None:
        with suppress(OSError):
            while True:
                client, _ = door.accept()
                threading.Thread(target=meet, args=(client,), daemon=True).start()

    with socket.create_server(("127.0.0.1", 0)) as door:
        threading.Thread(target=wait, daemon=True).start()
        yield str(door.getsockname()[1])


def test_there_are_three_hundred_over_every_entrance():
    entrances = Counter(each.entrance for each in INPUTS)
    assert len(INPUTS) >= 300
    assert {"command line", "YAML", "run.nc", "run folder", "journal", "plugin"} <= set(entrances)
    assert {"CSV", "REG", "MAT", "netCDF", "UFF", "instrument"} <= set(entrances)
    assert max(Counter((each.entrance, each.name) for each in INPUTS).values()) == 1


@pytest.mark.parametrize(
    "hostile",
    [
        pytest.param(
            x,
            id=f"{x.entrance}: {x.name}",
            marks=pytest.mark.long if i % OF else pytest.mark.whole,
        )
        for i, x in enumerate(INPUTS)
    ],
)
def test_hostile_input_is_refused_in_a_sentence(hostile, bench, runs, tmp_path):
    hostile.lay(tmp_path, runs)
    places = {FOLDER: str(tmp_path / HERE), NEIGHBOUR: str(tmp_path / BESIDE)}
    with served(hostile.device) as port:
        words = hostile.words
        for mark, place in {**places, "<port>": port}.items():
            words = [word.replace(mark, place) for word in words]
        site = [str(tmp_path / "site")] if hostile.packages else []
        done = bench.call(tmp_path, words, site, hostile.environment)
    assert done.faults == [], f"{done.err}\n{done.out}"
    assert not hostile.refused or done.status == 1, f"{done.err}\n{done.out}"
    assert hostile.told in done.err
