"""``sldvexp resume=<run folder>``: go on with a run that was cut off."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from hydra.core.override_parser.types import Quote, QuotedString
from omegaconf import OmegaConf

from sldvexp.errors import UserError

KEY = "resume="


def arguments_of(arguments: Sequence[str]) -> list[str]:
    """The command line that goes on with a run: what it was started with, into the same folder.

    Paths of a configuration are relative to where its run was started, so this changes to that
    folder.

    Parameters
    ----------
    arguments : sequence of str
        One of them is ``resume=<folder>``; others are added to the run's own.

    Raises
    ------
    UserError
        If the folder is no run's folder.
    """
    folder = Path(next(a for a in arguments if a.startswith(KEY)).removeprefix(KEY)).resolve()
    kept, hydra = (folder / ".hydra" / name for name in ("overrides.yaml", "hydra.yaml"))
    if not kept.is_file() or not hydra.is_file():
        raise UserError(
            f"command line: resume={folder} is not the folder of a run; it would have a folder "
            ".hydra with the configuration, and the scan lines in journal"
        )
    overrides = [str(o) for o in OmegaConf.load(kept)]
    settings = OmegaConf.load(hydra).hydra
    runtime, name = settings.runtime, settings.job.config_name
    os.chdir(runtime.cwd)
    user = [s.path for s in runtime.config_sources if s.provider == "command-line"]
    others = [a for a in arguments if not a.startswith(KEY)]
    added = [part for path in user for part in ("--config-dir", path)]
    if name != "config":
        added += ["--config-name", name]
    where = QuotedString(str(folder), Quote.single).with_quotes()
    return [*overrides, *others, f"hydra.run.dir={where}", *added]
