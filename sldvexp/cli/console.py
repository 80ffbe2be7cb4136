"""`sldvexp console [experiment ...]`: a page in the browser to aim, scan and watch a session.

The configuration is that of `sldvexp` with the same settings; what is aimed becomes an experiment
of the user's folder, and the scan is a run of it as any other.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from omegaconf import open_dict

from sldvexp import config, console
from sldvexp.cli.help import COMMAND_HELP
from sldvexp.cli.in_process import watched_run
from sldvexp.config import registry
from sldvexp.config.experiment import Experiment
from sldvexp.errors import UserError
from sldvexp.instrument import ScanningPlugin
from sldvexp.session import Operator, Watcher

#: Options of this command with what they take.
OPTIONS = COMMAND_HELP["console"].options

#: Packages of the extra `console`.
NEEDED = ("starlette", "uvicorn", "websockets")
#: Folder for what is aimed, without ``--config-dir``.
OWN_FOLDER = "conf"


def run(words: list[str], config_dir: str | None, port: str | None = None) -> int:
    """Serve the page until Ctrl-C.

    Raises
    ------
    UserError
        If the packages are missing, the configuration is wrong, or nothing in it scans.
    """
    if missing := [name for name in NEEDED if importlib.util.find_spec(name) is None]:
        raise UserError(
            f"console needs {' and '.join(missing)}: pip install 'sldvexp[console]' installs them"
        )
    experiment = composed(words, config_dir)
    if experiment.scan is None or not isinstance(experiment.instrument, ScanningPlugin):
        raise UserError(
            "console: needs a scan and an instrument that scans, as experiment=plate or "
            "instrument=visa have them"
        )
    folder = Path(config_dir or OWN_FOLDER)

    def aimed(settings: Sequence[str]) -> Experiment:
        return composed(settings, str(folder))

    def scanned(settings: Sequence[str], watcher: Watcher, operator: Operator) -> Path:
        return watched_run(settings, str(folder), watcher, operator)

    with console.Console(experiment, words, folder, aimed, scanned, _number(port)) as made:
        print(f"{made.address}\nopen it in a browser on this machine; Ctrl-C ends it", flush=True)
        with suppress(KeyboardInterrupt):
            made.serve()
    return 0


def composed(words: Sequence[str], config_dir: str | None) -> Experiment:
    """Compose a configuration from the words of a command, and make its plugins."""
    options = ["--config-dir", config_dir] if config_dir else []
    registry.load_installed()
    origins = config.Origins([*words, *options])
    config.security.check(origins)
    try:
        cfg = origins.compose()
    except Exception as error:  # Hydra's and OmegaConf's have no common base
        raise UserError(config.messages.of_composition(error, origins)) from error
    with open_dict(cfg):
        cfg.pop("hydra", None)
    return config.schema.build(cfg)


def _number(port: str | None) -> int:
    if port is None:
        return 0
    if not port.isdigit() or not 0 <= int(port) < 2**16:
        raise UserError(f"command line: --port must be a number up to 65535, not {port}")
    return int(port)
