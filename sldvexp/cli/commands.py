"""Commands: a word in the place of the first setting, as in ``sldvexp list pose``.

``sldvexp resume=<run folder>``: go on with a run that was cut off.
"""

from __future__ import annotations

import os
import re
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from hydra.core.override_parser.types import Quote, QuotedString

from sldvexp import cli, config, sweep
from sldvexp.config.paths import RUN_FILE, displayed
from sldvexp.errors import UserError, nearest
from sldvexp.files import read_text
from sldvexp.limits import YAML_BYTES, load_yaml
from sldvexp.writing import NEW, READY

#: Each is a module of this room; its `run` gets the words after it and the user's folder.
COMMANDS = (
    "aim",
    "check",
    "compare",
    "console",
    "export",
    "handbook",
    "list",
    "plan",
    "plot",
    "report",
    "rerun",
    "show",
    "truth",
)

#: Those that read what runs have left.
OF_RUNS = ("compare", "export", "plot", "report", "rerun", "truth")

#: Options that say which configuration is meant; a command takes no others.
TAKEN = ("overrides", "config_dir")


def begins(arguments: Sequence[str]) -> bool:
    """Tell whether a command is the first of all arguments."""
    return next(iter(arguments), None) in COMMANDS


def add_options(parser: ArgumentParser, arguments: Sequence[str]) -> None:
    """Let a parser take the options of the command that a line names, if it has some of its own."""
    name = next((a for a in arguments if a in COMMANDS), None)
    for option, told in getattr(getattr(cli, name), "OPTIONS", {}).items() if name else ():
        parser.add_argument(f"--{option}", help=told)


def in_order(arguments: Sequence[str], parser: ArgumentParser) -> list[str]:
    """Put settings first and options behind them, wherever they stand on the line.

    Hydra takes ``-m seed=1`` and ``seed=1 -m``, but not ``seed=1 -m laser=x``.

    Examples
    --------
    >>> from hydra._internal.utils import get_args_parser
    >>> in_order(["seed=1", "-m", "laser=x", "--config-dir", "my", "~pose"], get_args_parser())
    ['seed=1', 'laser=x', '~pose', '-m', '--config-dir', 'my']
    """
    settings, options, left = [], [], list(arguments)
    known = parser._option_string_actions
    while left:
        word = left.pop(0)
        if not word.startswith("-"):
            settings.append(word)
            continue
        options.append(word)
        name, equals, _ = word.partition("=")
        alike = [known[o] for o in known if o == name]
        alike = alike or [known[o] for o in known if o.startswith(name)]
        takes = alike[0].nargs if alike and not equals else 0
        if left and (takes is None or (takes == "?" and "=" not in left[0])):
            options.append(left.pop(0))
    return [*settings, *options]


#: A name in quotes, as JSON and Python have it, behind which a value comes.
QUOTED_NAME = re.compile(r"""(['"])([\w .+-]+)\1\s*:""")


def with_bare_names(setting: str) -> str:
    """Take the quotes from names in tables, which Hydra has only for values.

    Examples
    --------
    >>> with_bare_names('pose.views={"front": {origin: [0, 0, 1]}}')
    'pose.views={front: {origin: [0, 0, 1]}}'
    """
    made, before, quote, at = [], "", "", 0
    while at < len(setting):
        char = setting[at]
        name = None if quote or before not in ("{", ",") else QUOTED_NAME.match(setting, at)
        if name:
            made.append(f"{name[2]}:")
            at, before = name.end(), ":"
            continue
        if char in "'\"" and quote in ("", char) and setting[at - 1 : at] != "\\":
            quote = "" if quote else char
        before = before if char.isspace() else char
        made.append(char)
        at += 1
    return "".join(made)


def named(options: Namespace) -> bool:
    """Tell whether the command line is a command and no list of settings.

    Raises
    ------
    UserError
        If it begins with another word alone.
    """
    first = next(iter(options.overrides), "")
    if re.fullmatch("[a-z]+", first) and first not in COMMANDS:
        raise UserError(
            f"command line: there is no command {first}; {nearest(first, COMMANDS)}; "
            "a setting is key=value"
        )
    return first in COMMANDS


def run(options: Namespace) -> int:
    """Do what the command line names; its exit status.

    Raises
    ------
    UserError
        If the command does not take these options or words.
    """
    name, *words = options.overrides
    command = getattr(cli, name)
    own = {option: getattr(options, option) for option in getattr(command, "OPTIONS", {})}
    others = [o for o, given in vars(options).items() if given and o not in (*TAKEN, *own)]
    if others:
        option = others[0].replace("_", "-")
        only = ", ".join(f"--{o.replace('_', '-')}" for o in ("config_dir", *own))
        raise UserError(f"command line: {name} takes no option --{option}, only {only}")
    if options.config_dir and not Path(options.config_dir).is_dir():
        raise UserError(f"command line: there is no folder {options.config_dir}")
    status: int = command.run(words, options.config_dir, **own)
    sys.stdout.flush()
    return status


KEY = "resume="


def arguments_of(arguments: Sequence[str]) -> list[str]:
    """Write the command line that goes on with a run: what it was started with, into its folder.

    Paths of a configuration are relative to where its run was started, so this changes to that
    folder.

    Parameters
    ----------
    arguments : sequence of str
        One of them is ``resume=<folder>``; others are added to the run's own.

    Raises
    ------
    UserError
        If the folder is no run's folder, its run is finished, or what is recorded there is more
        than settings of a run.
    """
    folder = Path(next(a for a in arguments if a.startswith(KEY)).removeprefix(KEY)).resolve()
    begun = begun_with(folder)
    others = [a for a in arguments if not a.startswith(KEY)]
    added = [part for path in begun.config_dirs for part in ("--config-dir", path)]
    if begun.config_name != "config":
        added += ["--config-name", begun.config_name]
    where = QuotedString(str(folder), Quote.single).with_quotes()
    return [*begun.settings, *others, f"hydra.run.dir={where}", *added]


@dataclass(frozen=True)
class CommandLine:
    """Command line of which a run was begun: settings, and where files of the user's own are."""

    settings: list[str]
    config_dirs: list[str]
    config_name: str


def begun_with(folder: Path) -> CommandLine:
    """Read with what an unfinished run was begun, and change to where that was.

    Raises
    ------
    UserError
        See `arguments_of`.
    """
    if (folder / READY).is_dir():  # a run that was killed when it was done
        with sweep.lock.alone(folder):
            pass
    finished = (folder / RUN_FILE).is_file()
    replacing = finished and (folder / NEW / ".hydra").is_dir()
    recorded = (folder / NEW if replacing else folder) / ".hydra"
    kept, hydra = (recorded / name for name in ("overrides.yaml", "hydra.yaml"))
    if not kept.is_file() or not hydra.is_file():
        raise UserError(
            f"command line: resume={folder} is not the folder of a run; it would have a folder "
            ".hydra with the configuration, and the scan lines in journal"
        )
    if finished and not replacing:
        raise UserError(
            f"command line: resume={folder}: this run is finished; sldvexp rerun {folder} repeats "
            "it into a new folder"
        )
    overrides, settings = _read(kept), _read(hydra)
    if not isinstance(overrides, list):
        raise UserError(f"{displayed(kept)}: must be a list of settings")
    config.security.check_recorded(displayed(kept), overrides)
    cwd = _recorded(settings, "hydra.runtime.cwd", str, hydra)
    name = _recorded(settings, "hydra.job.config_name", str, hydra)
    sources = _recorded(settings, "hydra.runtime.config_sources", list, hydra)
    try:
        os.chdir(cwd)
    except (OSError, ValueError):
        raise UserError(
            f"{displayed(hydra)}: the run was started in {cwd}, which is gone"
        ) from None
    user = [s["path"] for s in sources if s.get("provider") == "command-line"]
    return CommandLine(overrides, user, name)


def _read(path: Path) -> Any:
    """Read a file that Hydra left, as data."""
    try:
        return load_yaml(read_text(path, YAML_BYTES))
    except (yaml.YAMLError, RecursionError):
        raise UserError(f"{displayed(path)}: is not YAML, as Hydra left it") from None


def _recorded(settings: Any, key: str, kind: type, path: Path) -> Any:
    """Find what Hydra recorded under a dotted key."""
    found = settings
    for part in key.split("."):
        found = found.get(part) if isinstance(found, dict) else None
    if isinstance(found, list):
        found = [s for s in found if isinstance(s, dict) and isinstance(s.get("path"), str)]
    if not isinstance(found, kind) or (isinstance(found, str) and found.startswith("-")):
        raise UserError(f"{displayed(path)}: {key} must be there as Hydra left it")
    return found
