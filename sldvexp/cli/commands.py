"""Commands: a word in the place of the first setting, as in ``sldvexp list pose``."""

from __future__ import annotations

import importlib
import re
import sys
from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path

from sldvexp.errors import UserError, nearest

#: The module of each; its `run` gets the words after the command and the user's folder.
COMMANDS = {
    "check": "sldvexp.cli.check",
    "compare": "sldvexp.cli.compare",
    "export": "sldvexp.cli.export",
    "list": "sldvexp.cli.list",
    "plot": "sldvexp.cli.plot",
    "report": "sldvexp.cli.report",
    "rerun": "sldvexp.cli.rerun",
    "show": "sldvexp.cli.show",
}

#: Options that say which configuration is meant; a command takes no others.
TAKEN = ("overrides", "config_dir")


def begins(arguments: Sequence[str]) -> bool:
    """Whether a command is the first of all arguments."""
    return next(iter(arguments), None) in COMMANDS


def named(options: Namespace) -> bool:
    """Whether the command line is a command and no list of settings.

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
    others = [o for o, given in vars(options).items() if given and o not in TAKEN]
    if others:
        option = others[0].replace("_", "-")
        raise UserError(f"command line: {name} takes no option --{option}, only --config-dir")
    if options.config_dir and not Path(options.config_dir).is_dir():
        raise UserError(f"command line: there is no folder {options.config_dir}")
    status: int = importlib.import_module(COMMANDS[name]).run(words, options.config_dir)
    sys.stdout.flush()
    return status
