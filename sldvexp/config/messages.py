"""Hydra's and OmegaConf's complaints as one sentence: what is wrong, where, what would be right."""

from __future__ import annotations

import re
from dataclasses import is_dataclass
from pathlib import Path

from hydra.errors import HydraException, MissingConfigException
from omegaconf.errors import (
    ConfigAttributeError,
    ConfigKeyError,
    KeyValidationError,
    OmegaConfBaseException,
    ValidationError,
)
from yaml import MarkedYAMLError

from sldvexp.config import registry
from sldvexp.config.experiment import NAMED_GROUPS, SINGLE_GROUPS
from sldvexp.config.paths import OTHER_ENDING, displayed
from sldvexp.config.refusals import refusal
from sldvexp.config.sources import COMMAND_LINE, Origins
from sldvexp.errors import ConfigError, UserError, nearest, words_of
from sldvexp.writing import FULL

#: What Hydra says about an argument, and what a user is told; the pattern's groups fill it.
ARGUMENTS = (
    (r"Could not delete (?:from config\. )?'(.*?)'(?: does not exist)?\. ?(?:No match|$)",
     "~{0} deletes what is not there"),
    (r"Could not delete from config\. The value of '(.*)' is (.*) and not (.*)\.",
     "~{0}={2} deletes another value than the one that is there, {1}"),
    (r"Could not append to config\. An item is already at '(.*)'\.",
     "+{0} adds what is there already; leave out the +"),
    (r"Could not override '(.*)'\.",
     "{0} is not chosen in this configuration, so that it cannot be changed; +{0}=... adds it"),
    (r"Ambiguous value for argument '(.*)'",
     "{0} has several values; -m runs each of them, [a, b] is a list, and quotes make a text"),
    (r"Sweep parameters '(.*)' requires --multirun", "{0} is for a sweep, which needs -m"),
    (r"force-add of config groups is not supported: '(.*)'",
     "{0} chooses from a group, which takes no ++"),
    (r"Override (.*) looks like a config group override, but config group '(.*)' does not exist",
     "{0} names no group of the configuration; {groups}"),
    (r"You must specify '(.*)', e\.g", "{0} must be chosen, as in {0}=name"),
    (r"Multiple values for (.*?)\. To override", "two files choose {0}; in the defaults of the "
     "second the item must be 'override /{0}: name'"),
    (r"No completion plugin for '(.*)' found",
     "-sc does not know the shell {0}; Valid: bash, fish, zsh"),
    (r"hydra\.searchpath must be a list of strings", "hydra.searchpath must be a list of folders"),
    (r"Additional config directory '(.*)' not found", "--config-dir: there is no folder {0}"),
    (r"Could not detect \"srun\"", "hydra/launcher=submitit_slurm submits to SLURM, which is not "
     "here; submitit_local does the same on this machine"),
)  # fmt: skip

#: What Hydra says about a file's defaults list, and what a user is told.
IN_FILES = (
    (r"Could not override '.*@experiment\..*'",
     "must begin with the line '# @package _global_', as experiments do"),
    (r"Could not override '(.*)'\. No match in the defaults list",
     "its defaults override {0}, which the configuration does not have; {groups}"),
    (r"Multiple values for (.*)\. To override", "its defaults choose {0} a second time; the item "
     "must be 'override /{0}: name'"),
    (r"Override '.*' is defined before '(.*): .*'",
     "its defaults have {0} after an override, but overrides must come last"),
)  # fmt: skip

#: The extra of this package that brings each of Hydra's launchers.
LAUNCHERS = {
    "joblib": "parallel",
    "submitit_local": "slurm",
    "submitit_slurm": "slurm",
    "ray": "ray",
}

#: Packages that raise errors of their own when a process that did runs for them is lost.
OF_LAUNCHERS = ("joblib", "submitit", "ray")


def sentence(error: BaseException, origins: Origins) -> str | None:
    """Say an error in a sentence for the user; None for a defect of the program itself.

    Parameters
    ----------
    origins : Origins
        Tells where settings come from.
    """
    if isinstance(error, ConfigError):
        return "\n".join(_joined(origins.where(p.field), p.message) for p in error.problems)
    if isinstance(error, UserError):
        return str(error)
    if isinstance(error, OmegaConfBaseException) and error.full_key:
        return f"{origins.where(error.full_key)} {refusal(error)}"
    if package := registry.package_at_fault(error):
        return (
            f"a plugin of the package {package.name} {package.version} failed, or gave what does "
            f"not fit: {words_of(error)}; with HYDRA_FULL_ERROR=1 in the environment it shows where"
        )
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: cannot be read or written: {error.strerror or error}"
    if isinstance(error, MemoryError):
        told = " ".join(str(error).split())
        return f"there is not enough memory{f': {told}' if told else ''}"
    return None


def of_composition(error: Exception, origins: Origins) -> str:
    """Say in a sentence whatever keeps a configuration from being composed."""
    if told := sentence(error, origins):
        return told
    if type(error).__module__.partition(".")[0] in OF_LAUNCHERS:
        return (
            "a process that did a run was lost, as when memory runs out; the same command does "
            f"what is missing: {(str(error) or type(error).__name__).splitlines()[0]}"
        )
    if unreadable := origins.unreadable:
        return (
            f"{COMMAND_LINE}: {unreadable[0]!r} cannot be read; write key=value, and put a value "
            "with special characters into quotes of its own"
        )
    if told := _bad_choice(origins):
        return told
    if isinstance(error, MissingConfigException) and error.missing_cfg_file:
        return _missing_choice(error.missing_cfg_file, origins)
    cause = error.__cause__ or error.__context__
    if isinstance(error, HydraException) and isinstance(cause, OmegaConfBaseException):
        return _refused(str(error), cause, origins)
    if isinstance(error, MarkedYAMLError) and (mark := error.problem_mark or error.context_mark):
        said = error.problem or error.context
        return f"{displayed(Path(mark.name))}, line {mark.line + 1}: is not YAML: {said}"
    for reason in (error, cause):
        if isinstance(reason, OSError) and reason.filename is not None:
            return f"{reason.filename}: cannot be made or written: {reason.strerror or reason}"
        if isinstance(reason, OSError) and reason.errno in FULL:
            return (
                f"results cannot be written: {reason.strerror}; hydra.run.dir=... chooses another "
                "folder for them, with -m hydra.sweep.dir=..."
            )
    if isinstance(error, RecursionError):
        return "a configuration file includes itself in its defaults, perhaps by way of others"
    return _bad_argument(error, origins)


def _joined(where: str, message: str) -> str:
    """Join a setting's name and a message that goes on from it, or that stands by itself."""
    goes_on = re.match(r"(must|is|are|has|cannot|needs|refers|says)\b", message)
    return f"{where} {message}" if goes_on else f"{where}: {message}"


def _misfit(told: str, key: str, origins: Origins) -> str | None:
    """Say where a file's setting is for its own choice and the command line chose another."""
    where = told.partition(f": {key} is not a known setting")[0]
    if where in (told, COMMAND_LINE):
        return None
    for choice in origins.choices:
        chosen = f"{choice.key_or_group}={choice.value()}"
        own = where.endswith(f"{chosen.replace('=', '/')}.yaml")
        if key.startswith(f"{choice.package or choice.key_or_group}.") and not own:
            return (
                f"{COMMAND_LINE}: {chosen} does not go with {where}, which sets {key} for a choice "
                f"of its own; begin with '~experiment' {chosen} instead and add what else is "
                "needed, or choose it in a copy of that file"
            )
    return None


def _missing_choice(path: str, origins: Origins) -> str:
    """Say that a plugin, experiment or other choice of a group is unknown."""
    path = path.removesuffix(OTHER_ENDING)
    if ended := origins.shown(path, OTHER_ENDING):
        return f"{ended}: has the ending {OTHER_ENDING}, and configurations end with .yaml"
    group, _, name = path.partition("/")
    below, slash, chosen = name.partition("/")
    if slash and below in registry.GROUPS and (file := origins.file_with(below)):
        return (
            f"{file}: its defaults choose {below}: {chosen} below {group}; the item must be "
            f"'override /{below}: {chosen}'"
        )
    where = origins.where_chosen(group, name)
    if not name:
        return f"{COMMAND_LINE}: there is no configuration {path}; is --config-name right?"
    if extra := path.startswith("hydra/launcher/") and LAUNCHERS.get(path.rpartition("/")[2]):
        name = path.rpartition("/")[2]
        return (
            f"{COMMAND_LINE}: hydra/launcher={name} needs a package that is not installed: "
            f"pip install 'sldvexp[{extra}]'"
        )
    if path.startswith("hydra/") or name.startswith("schema/"):
        group, _, name = path.rpartition("/")
        where = where or origins.where_chosen(group, name)
    options = origins.options_of(group) or registry.names(group.removesuffix("/schema"))
    told = f"there is no {group}={name}; {nearest(name, options)}"
    return f"{where}: {told}" if where else told


def _refused(text: str, cause: OmegaConfBaseException, origins: Origins) -> str:
    """Say that a key or value does not fit where a file or an argument puts it."""
    key = str(cause.full_key)
    if file := re.match(r"In '([^']+)'", text):
        shown = origins.shown(file[1])
        if key == "experiment":
            return f"{shown}: must begin with the line '# @package _global_', as experiments do"
        chosen = any(choice.package == key for choice in origins.choices)
        source = COMMAND_LINE if chosen else shown
        told = " ".join(filter(None, [source and f"{source}:", key, refusal(cause)]))
        return _misfit(told, key, origins) or told
    argument = re.match(r"Error merging override [+~]*([^=]*)=?(.*)", text)
    name, value = argument.groups() if argument else (key, "")
    entry = key.split(".")[-1]
    # Entries with numbers for names, and new ones whose settings have types, have no dotted paths.
    new = isinstance(cause, ValidationError) and cause.parent_node is None
    if (new or isinstance(cause, KeyValidationError)) and f".{entry}" in name:
        table, _, leaf = name.partition(f".{entry}")
        inner = value
        for part in reversed(leaf[1:].split(".") if leaf else []):
            inner = f"{{{part}: {inner}}}"
        return (
            f"{COMMAND_LINE}: {name} cannot be reached by dots; "
            f"write '{table}={{{entry}: {inner}}}'"
        )
    if not (key.startswith(name) or name.startswith(key)):
        key = name  # below what a + adds, OmegaConf forgets where it is
    group, *below = key.split(".")
    unknown = isinstance(cause, ConfigKeyError | ConfigAttributeError)
    if group in SINGLE_GROUPS and len(below) == 1 and unknown and cause.object_type is dict:
        return (
            f"{COMMAND_LINE}: {key} belongs to no plugin; choose one with {group}=...; "
            f"{nearest('', origins.options_of(group))}"
        )
    told = f"{COMMAND_LINE}: {key} {refusal(cause)}"
    added = re.search(r"To append to your config use (.*)", text)
    return f"{told}; {added[1]} adds it" if added and not is_dataclass(cause.object_type) else told


def _bad_choice(origins: Origins) -> str | None:
    """Say that an argument chooses from a group what cannot be a name."""
    for choice in origins.choices:
        value, group = choice.value(), choice.key_or_group
        if choice.is_delete() or choice.is_sweep_override():
            continue
        if group in NAMED_GROUPS:
            return (
                f"{COMMAND_LINE}: {choice.input_line} must be a table; a plugin is added to it by "
                f"a name of yours, as in {group}.mine.plugin=name; "
                f"{nearest('', registry.names(NAMED_GROUPS[group]))}"
            )
        names = value if isinstance(value, list) else [value]
        if not all(isinstance(n, str) for n in names):
            return (
                f"{COMMAND_LINE}: {choice.input_line} must name a choice, and ~{group} leaves the "
                f"group out; {nearest('', origins.options_of(group))}"
            )
    return None


def _bad_argument(error: Exception, origins: Origins) -> str:
    """Say what Hydra says about an argument or a defaults list, or at least its first line."""
    text = str(error).strip() or type(error).__name__
    file, text = re.match(r"(?:In '?([^']*?)'?: )?(.*)", text, re.DOTALL).groups()  # type: ignore[union-attr]
    where = origins.shown(file) if file else COMMAND_LINE
    for pattern, words in IN_FILES if file else ARGUMENTS:
        if match := re.match(pattern, text):
            found = match.groups() or ("",)
            if not file and "override" in words:
                where = origins.file_with(found[0], f"/{found[0]}") or where
            groups = nearest(found[-1], [*registry.GROUPS, "experiment"])
            return f"{where}: {words.format(*found, groups=groups)}"
    return f"{where or 'the configuration'}: {text.splitlines()[0]}"
