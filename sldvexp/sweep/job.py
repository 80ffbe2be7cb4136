"""One run of a sweep: done only if it is not done already, with a record of what became of it."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from itertools import count
from pathlib import Path

from omegaconf import DictConfig

from sldvexp.config.experiment import Retry
from sldvexp.config.paths import JOURNAL, RUN_FILE, locate
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import UserError
from sldvexp.pipeline import provenance, runner
from sldvexp.session import Watcher
from sldvexp.sweep import record
from sldvexp.sweep.collect import RunHeadlines
from sldvexp.sweep.lock import LOCK_FILE, locked
from sldvexp.sweep.record import Record, State, Stopwatch
from sldvexp.sweep.shared_steps import SHARED, Store
from sldvexp.writing import sweep_up


def perform(
    cfg: DictConfig,
    folder: str,
    overrides: list[str],
    tell: Callable[[Exception], str | None],
    watcher: Watcher | None = None,
) -> bool:
    """Do a run, unless its folder has what it would give, and leave a record of it.

    Parameters
    ----------
    cfg : DictConfig
        The composed configuration.
    overrides : list of str
        Of the command line, for this run.
    tell : callable
        The sentence about an exception, None if it is a defect of the program.
    watcher : Watcher, optional
        Shows how the run gets on.

    Returns
    -------
    bool
        Whether it was done now.
    """
    place, identity = Path(folder), provenance.identity(cfg)
    with locked(place / LOCK_FILE):  # a worker of a killed sweep may still be at it
        if is_current(place, identity, cfg.sweep.retry):
            return False
        _perform(cfg, place, identity, overrides, tell, watcher)
    return True


def _perform(
    cfg: DictConfig,
    place: Path,
    identity: str,
    overrides: list[str],
    tell: Callable[[Exception], str | None],
    watcher: Watcher | None,
) -> None:
    sweep_up(place, place / JOURNAL)
    _put_aside(place, identity, cfg.sweep.retry)
    watch, process = Stopwatch(), os.getpid()
    store = Store(cfg, place.parent / SHARED)

    def note(state: State, reason: str = "", inputs: dict[str, str] | None = None) -> None:
        about = (watch.seconds(), process, overrides, inputs or {}, store.seconds, store.reused)
        record.write(place, Record(state, identity, reason, *about))

    note(State.running)
    left: list[RunData] = []
    try:
        passed = runner.run(
            cfg, str(place), quiet=True, share=store, watcher=watcher, left=left.append
        )
    except Exception as error:  # what Ctrl-C or a signal stops stays noted as running
        note(State.failed, tell(error) or f"{type(error).__name__}: {error}")
        raise
    RunHeadlines.from_groups(left[0].groups).keep(place / RUN_FILE)
    inputs = json.loads(left[0].attributes["inputs_sha256"])
    note(State.done if passed else State.missed, inputs=inputs)


def _put_aside(folder: Path, identity: str, retry: Retry) -> None:
    """Keep scan lines that belong to another configuration under another name."""
    found, journal = record.read(folder), folder / JOURNAL
    other = found.identity != identity or retry is Retry.all or not _unchanged(found.inputs)
    if found.identity and other and journal.is_dir():
        aside = (folder / f"{JOURNAL}-{found.identity[:8]}-{i}" for i in count(1))
        journal.rename(next(path for path in aside if not path.exists()))


def is_current(folder: Path, identity: str, retry: Retry) -> bool:
    """Tell whether a folder has what its run would give again.

    Parameters
    ----------
    folder : Path
        Of the run.
    identity : str
        Of the run that is wanted, see `sldvexp.pipeline.provenance.identity`.
    """
    found = record.read(folder)
    if retry is Retry.failed and found.state in (State.waiting, State.done, State.missed):
        return True
    if retry is Retry.all or found.identity != identity or not _unchanged(found.inputs):
        return False
    if found.state is State.failed:
        return retry is Retry.missing
    return found.state.finished and (folder / RUN_FILE).is_file()


def _unchanged(inputs: dict[str, str]) -> bool:
    """Tell whether the files that a run read still have the same content."""
    try:
        return all(provenance.sha256(locate(path)) == digest for path, digest in inputs.items())
    except UserError:
        return False
