"""A run from Python: what the command does, in this process, with its result in hand."""

from __future__ import annotations

import logging
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path

from omegaconf import DictConfig

from sldvexp import dataset, session
from sldvexp.cli.command import Command, hydra_raises
from sldvexp.cli.commands import KEY
from sldvexp.config.paths import JOURNAL, RUN_FILE
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.limits import shown
from sldvexp.session.interruption import (
    EndedScanError,
    InterruptedRun,
    UnfinishedError,
    has_lines,
    kept_lines,
)
from sldvexp.session.journal import lines_kept
from sldvexp.stopping import handlers_kept

__version__ = version("sldvexp")


def run(*settings: str, config_dir: str | Path | None = None, quiet: bool = False) -> xr.DataTree:
    """Compose one run from settings, do it in this process, and return its dataset.

    It leaves in ``outputs/`` what ``sldvexp`` with the same settings leaves.

    Parameters
    ----------
    *settings : str
        As on the command line, such as ``"experiment=point"`` or ``"laser.mirror_offset=0.045"``.
    config_dir : str or Path, optional
        Folder with experiments and choices of your own.
    quiet : bool
        Whether it prints neither a bar nor its closing table, whose notes are in the dataset too.

    Returns
    -------
    xarray.DataTree
        The run's groups, in memory. ``encoding["source"]`` is the file that they are kept in.

    Raises
    ------
    UserError
        For a mistake in the settings or the data, with the sentence that the command prints.

    Examples
    --------
    >>> import sldvexp
    >>> tree = sldvexp.run("experiment=point", "report=none", quiet=True)
    >>> sorted(tree.children)
    ['check', 'line_of_sight', 'point', 'verdict']
    """
    for setting in settings:
        is_setting = isinstance(setting, str) and ("=" in setting or setting.startswith("~"))
        if not is_setting or setting.startswith(("-", KEY)):
            raise UserError(
                f"run: {setting!r} is no setting, as 'experiment=point' is; options, sweeps and "
                "resume= are for the command, and folders of your own for config_dir="
            )
    added = ["--config-dir", str(config_dir)] if config_dir is not None else []
    call = _Call([*settings, *added], quiet)
    with hydra_raises(), _as_a_command(call.arguments), handlers_kept():
        call.run()
    if call.told:
        raise UserError("\n".join(call.told))
    assert call.folder is not None  # a call that is refused says so
    path = call.folder / RUN_FILE
    found = dataset.open_run(path)
    found.encoding["source"] = str(path)
    return found


def watched_run(
    settings: Sequence[str],
    config_dir: str,
    watcher: session.Watcher,
    operator: session.Operator,
) -> Path:
    """Do one run in this process for somebody who watches and is asked; give its folder.

    Parameters
    ----------
    settings : sequence of str
        As on the command line; with ``resume=<folder>`` it goes on with a run.
    config_dir : str
        Folder of the user's own experiments; it may be missing.

    Raises
    ------
    UserError
        For a mistake in the settings or the data, with the sentence that the command prints.
    UnfinishedError, InterruptedRun
        If some of its scan is kept; it says too how it goes on.
    """
    added = ["--config-dir", config_dir] if Path(config_dir).is_dir() else []
    call = _Call([*settings, *added], quiet=True)
    call.watcher, call.operator = watcher, operator
    try:
        with hydra_raises(), _as_a_command(call.arguments), handlers_kept():
            call.run()
    except KeyboardInterrupt as stop:
        if call.folder is None or not has_lines(call.folder):
            raise
        raise InterruptedRun("interrupted", call.folder) from stop
    if call.told:
        if isinstance(call.ended, EndedScanError):
            raise call.ended
        told = "\n".join(call.told)
        if call.folder is None or not any(lines_kept(call.folder / JOURNAL).values()):
            raise UserError(told)
        raise UnfinishedError(told, call.folder, kept_lines(call.folder, mend=True))
    assert call.folder is not None  # a call that is refused says so
    return call.folder


class _Call(Command):
    """A call of the command that keeps what it would print about mistakes."""

    own_process = False

    def __init__(self, arguments: list[str], quiet: bool):
        super().__init__(arguments, full_error=False, quiet=quiet)
        self.told: list[str] = []

    def _job(self, cfg: DictConfig) -> None:
        if self.folder is None:
            raise UserError("run: does one run; a sweep is for the command, sldvexp -m ...")
        super()._job(cfg)

    def _say(self, told: str) -> None:
        self.told.append(shown(told))


@contextmanager
def _as_a_command(arguments: Sequence[str]) -> Iterator[None]:
    """Let Hydra read these arguments; loggers are given back as they were."""
    argv, root = sys.argv, logging.getLogger()
    handlers, level = list(root.handlers), root.level
    sys.argv = ["sldvexp", *arguments]
    try:
        yield
    finally:
        sys.argv = argv
        for handler in list(root.handlers):
            if handler not in handlers:
                root.removeHandler(handler)
                handler.close()
        root.handlers[:] = handlers
        root.setLevel(level)
