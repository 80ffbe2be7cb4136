"""Completion by the shell when TAB is pressed: choices, settings, commands and options."""

from __future__ import annotations

import inspect
import re
import warnings
from collections.abc import Iterable
from contextlib import redirect_stderr, suppress
from dataclasses import fields
from enum import Enum
from io import StringIO

from hydra._internal.utils import get_args_parser
from hydra.plugins.completion_plugin import DefaultCompletionPlugin
from omegaconf import OmegaConf

from sldvexp.cli import handbook
from sldvexp.cli.commands import COMMANDS, add_options
from sldvexp.cli.list import EXPERIMENT
from sldvexp.config import Origins, registry
from sldvexp.config.experiment import NAMED_GROUPS, SINGLE_GROUPS, Experiment

GROUPS = (*registry.GROUPS, EXPERIMENT)


def suggestions(line: str) -> list[str]:
    """Suggest how the last word of a command line may go on.

    Parameters
    ----------
    line : str
        As typed so far, with the program's name.

    Returns
    -------
    list of str
        Whole words; none where the line is wrong, since a message would garble what is typed.
    """
    words = line.split()[1:]
    word = "" if line.endswith(" ") or not words else words.pop()
    silence = redirect_stderr(StringIO())
    with silence, warnings.catch_warnings(), suppress(Exception, SystemExit):
        warnings.simplefilter("ignore")
        return sorted({s for s in _all(words, word) if s.startswith(word)})
    return []


def _all(words: list[str], word: str) -> Iterable[str]:
    """List what may stand in the place of a word, whether it begins so or not."""
    if word.startswith("-"):
        parser = get_args_parser()
        add_options(parser, words)
        return [o for action in parser._actions for o in action.option_strings]
    registry.load_installed()
    origins = Origins(words)
    command = next(iter(origins.options.overrides), None)
    if command == "list":
        return GROUPS
    if command == "handbook":
        return [*handbook.pages(), *handbook.MADE]
    if command == "show":
        return _choices(word, GROUPS, origins) or [f"{group}=" for group in GROUPS]
    if command == "check":
        return origins.options_of(EXPERIMENT)
    if command in COMMANDS:
        return []  # the shell offers files
    return (
        _choices(word, (*SINGLE_GROUPS, EXPERIMENT), origins)
        or _values(word, origins)
        or [*_settings(word, origins), *([] if words else COMMANDS)]
    )


def _choices(word: str, groups: Iterable[str], origins: Origins) -> list[str]:
    """List all choices of a group, also after those of a sweep, ``pose=bitangent,edge``."""
    group, chosen, value = word.partition("=")
    others, comma, _ = value.rpartition(",")
    names = origins.options_of(group) if chosen and group in groups else ()
    return [f"{group}={others}{comma}{name}" for name in names]


def _values(word: str, origins: Origins) -> list[str]:
    """List the values of a setting that has only a few.

    And the plugins of an entry that names one.
    """
    key, given, _ = word.partition("=")
    above, _, last = key.lstrip("+").rpartition(".")
    if not (given and above):
        return []
    if last == "plugin" and (group := NAMED_GROUPS.get(above.partition(".")[0])):
        return [f"{key}={name}" for name in registry.names(group)]
    table = OmegaConf.select(origins.compose(), above)
    kind = table._get_node(last)._metadata.ref_type if last in table else None
    if kind is bool:
        return [f"{key}=true", f"{key}=false"]
    members = kind.__members__ if inspect.isclass(kind) and issubclass(kind, Enum) else ()
    return [f"{key}={member}" for member in members]


def _settings(word: str, origins: Origins) -> list[str]:
    """List groups and settings of the configuration so far, as Hydra finds them."""
    line = " ".join([*origins.arguments, word])
    valid = {*GROUPS, *(f.name for f in fields(Experiment)), "hydra"}  # no other folder of files
    found = DefaultCompletionPlugin(origins.loader)._query("config", line)
    return [s for s in found if re.split(r"[=.]|(?<=hydra)/", s.lstrip("+~"))[0] in valid]
