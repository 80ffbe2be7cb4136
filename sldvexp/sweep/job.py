"""One run of a sweep: done only if it is not done already, with a record of what became of it."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path

from omegaconf import DictConfig

from sldvexp import provenance
from sldvexp.errors import UserError
from sldvexp.paths import locate
from sldvexp.runner import RUN_FILE
from sldvexp.sweep import record
from sldvexp.sweep.record import Record, State, Stopwatch


def is_current(folder: Path, identity: str, retry: str) -> bool:
    """Whether a folder has what its run would give again.

    Parameters
    ----------
    folder : Path
        Of the run.
    identity : str
        Of the run that is wanted, see `sldvexp.provenance.identity`.
    retry : str
        ``unfinished`` runs what is missing, failed or changed; ``failed`` only what failed;
        ``missing`` all but what failed; ``all`` everything.
    """
    found = record.read(folder)
    same = found.identity == identity and _inputs_unchanged(found.inputs)
    if retry == "all":
        return False
    if found.state is State.failed:
        return retry == "missing" and same
    return found.state.finished and same and (folder / RUN_FILE).is_file()


def _inputs_unchanged(inputs: dict[str, str]) -> bool:
    """Whether the files that a run read still have the same content."""
    try:
        return all(provenance.sha256(locate(path)) == digest for path, digest in inputs.items())
    except UserError:
        return False


def perform(
    cfg: DictConfig,
    folder: Path,
    overrides: list[str],
    work: Callable[[], bool],
    tell: Callable[[Exception], str | None],
) -> Record:
    """Do a run and leave the record of it.

    Parameters
    ----------
    cfg : DictConfig
        The composed configuration.
    folder : Path
    overrides : list of str
        Of the command line, for this run.
    work : callable
        Does the run; whether all expectations were met.
    tell : callable
        The sentence about an exception, None if it is a defect of the program.
    """
    about = {"identity": provenance.identity(cfg), "process": os.getpid(), "overrides": overrides}
    watch = Stopwatch()
    record.write(folder, Record(State.running, **about))
    try:
        passed = work()
    except BaseException as error:
        told = tell(error) if isinstance(error, Exception) else "interrupted"
        reason = told or f"{type(error).__name__}: {error}"
        record.write(folder, Record(State.failed, reason=reason, seconds=watch.seconds(), **about))
        raise
    state = State.done if passed else State.missed
    inputs = json.loads(_attribute(folder / RUN_FILE, "inputs_sha256"))
    found = Record(state, seconds=watch.seconds(), inputs=inputs, **about)
    record.write(folder, found)
    return found


def _attribute(path: Path, name: str) -> str:
    import netCDF4

    with netCDF4.Dataset(path) as file:
        return str(file.getncattr(name))
