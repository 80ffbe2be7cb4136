"""`sldvexp check <experiments, folders, matrices>`: tries each and says what is not as expected."""

from __future__ import annotations

import gc
import time
from collections.abc import Iterable
from contextlib import redirect_stdout
from datetime import datetime
from io import StringIO
from pathlib import Path

from sldvexp.cli.list import files, folders
from sldvexp.errors import UserError, nearest
from sldvexp.progress import doing, span
from sldvexp.sweep.matrix import Cell, read_matrix
from sldvexp.sweep.trial import Trials, Verdict

EXPERIMENT, MATRIX = "experiment", "matrix"


def run(words: list[str], config_dir: str | None) -> int:
    """Try what the words name, and print a line for each combination.

    A word is an experiment, a folder of experiments, a matrix, the path of a file of one of these,
    or that of a folder with configurations of the user's own.

    Returns
    -------
    int
        2 if something is not as expected.

    Raises
    ------
    UserError
        If a word names nothing, or a matrix is no such file.
    """
    gc.enable()  # which composing turned off: many runs in one process make garbage
    if not words:
        raise UserError(
            "command line: check takes experiments, matrices, or a folder of yours that has them"
        )
    where = Path(f"outputs/{datetime.now():%Y-%m-%d/%H-%M-%S.%f}")
    wanted = [each for word in words for each in named(word, config_dir)]
    verdicts: list[Verdict] = []
    total = sum(len(cells) for cells, _ in wanted)
    for number, (cells, own) in enumerate(wanted):
        trials = Trials(cells, ["--config-dir", own] if own else [], where / str(number))
        for name in trials.cells:
            begun = time.monotonic()
            place = f"{len(verdicts) + 1} of {total}: {name}"
            with doing(place), redirect_stdout(StringIO()):  # what single runs say
                verdict = trials.judge(name)
            verdicts.append(verdict)
            state = "passed" if verdict.passed else "FAILED"
            print(f"{state}  {name}: {verdict.told} ({span(time.monotonic() - begun)})", flush=True)
    good = sum(verdict.passed for verdict in verdicts)
    runs = f"; runs are in {where}" if where.is_dir() else ""
    print(f"{good} of {len(verdicts)} as expected{runs}")
    return 0 if good == len(verdicts) else 2


def named(word: str, config_dir: str | None) -> list[tuple[list[Cell], str | None]]:
    """Find what a word stands for: combinations, and the user's folder that they belong to.

    Raises
    ------
    UserError
        If it stands for nothing.
    """
    path = Path(word)
    if path.is_file():
        return [_of_file(path, config_dir)]
    if any((path / group).is_dir() for group in (EXPERIMENT, MATRIX)):
        matrices = files(MATRIX, [path]).values()
        found = [_experiments(files(EXPERIMENT, [path])), *map(read_matrix, matrices)]
        return [(cells, word) for cells in found if cells]
    experiments, matrices_by_name = (files(g, folders(config_dir)) for g in (EXPERIMENT, MATRIX))
    if word in matrices_by_name:
        return [(read_matrix(matrices_by_name[word]), config_dir)]
    chosen = [n for n in experiments if n == word or n.startswith(f"{word.rstrip('/')}/")]
    if chosen:
        return [(_experiments(chosen), config_dir)]
    if path.is_dir():
        raise UserError(f"{word}: has neither a folder {EXPERIMENT} nor a folder {MATRIX}")
    valid = nearest(word, [*experiments, *matrices_by_name])
    raise UserError(f"command line: {word} is no file, experiment or matrix; {valid}")


def _of_file(path: Path, config_dir: str | None) -> tuple[list[Cell], str | None]:
    """Read an experiment's or a matrix's file.

    What it names may lie in the same folder of the user.
    """
    above = {parent.name: parent for parent in path.parents}
    folder = above.get(EXPERIMENT) or above.get(MATRIX)
    own = config_dir or (str(folder.parent) if folder else None)
    if EXPERIMENT in above:
        return _experiments([str(path.relative_to(above[EXPERIMENT]).with_suffix(""))]), own
    return read_matrix(path), own


def _experiments(names: Iterable[str]) -> list[Cell]:
    return [Cell(f"{EXPERIMENT}={name}", (f"{EXPERIMENT}={name}",)) for name in names]
