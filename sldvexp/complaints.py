"""Hydra's and OmegaConf's complaints as one sentence: what is wrong, where, what would be right."""

from __future__ import annotations

import re
from pathlib import Path

from hydra.errors import HydraException, MissingConfigException
from omegaconf.errors import OmegaConfBaseException

from sldvexp import config, registry
from sldvexp.errors import ConfigError, UserError, nearest
from sldvexp.paths import conf_dir


def sentence(error: BaseException, arguments: list[str]) -> str | None:
    """The user's sentence for an error, or None for a defect of the program itself.

    Parameters
    ----------
    error : BaseException
    arguments : list of str
        The command line, to tell whether a value came from there or from a file.
    """
    if isinstance(error, ConfigError):
        told = [f"{_where(p.field, arguments)} {p.message}" for p in error.problems]
        return "\n".join(told)
    if isinstance(error, UserError):
        return str(error)
    if isinstance(error, MissingConfigException) and error.missing_cfg_file:
        return _missing_choice(error)
    if isinstance(error, HydraException | OmegaConfBaseException):
        return _composition(error, arguments)
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {error.strerror or error}"
    return None


def _missing_choice(error: MissingConfigException) -> str:
    """An unknown plugin, experiment or other choice of a group."""
    group, _, name = str(error.missing_cfg_file).rpartition("/")
    options = [o for o in error.options or [] if o != "schema"]
    if not group:
        return f"there is no configuration {name}; is --config-dir right?"
    if not options and group not in registry.GROUPS:
        return f"{group} is not a configuration group; {nearest(group, registry.GROUPS)}"
    return f"there is no {group}={name}; {nearest(name, options)}"


def _composition(error: Exception, arguments: list[str]) -> str:
    """A key or value that the composition refused."""
    text = str(error)
    cause = error if isinstance(error, OmegaConfBaseException) else error.__cause__
    in_file = re.match(r"In '([^']+)'", text)
    if isinstance(cause, OmegaConfBaseException) and cause.full_key:
        where = f"conf/{in_file[1]}.yaml: {cause.full_key}" if in_file else None
        where = where or _where(cause.full_key, arguments)
        return f"{where} {_reason(cause)}"
    if match := re.search(r"Could not override '([^']+)'", text):
        key = match[1].split("@")[0]
        known = [*registry.GROUPS, *config.Experiment.__dataclass_fields__]
        return f"{_where(key, arguments)} is not a known setting; {nearest(key, set(known))}"
    return " ".join(line.strip() for line in text.splitlines() if line.strip())


def _reason(cause: OmegaConfBaseException) -> str:
    """What is wrong with a value or key, from OmegaConf's own words."""
    text = str(cause.msg).splitlines()[0]
    if re.search(r"not in '|not in struct", text):
        schema = cause.object_type
        valid = getattr(schema, "__dataclass_fields__", {})
        return f"is not a known setting; {nearest(str(cause.key), valid)}"
    return f"is refused: {text}"


def _where(key: str, arguments: list[str]) -> str:
    """The command line's argument or the file of `conf/` that sets a key, before the key itself."""
    for argument in arguments:
        name = argument.lstrip("+~").partition("=")[0]
        if name == key or key.startswith(f"{name}."):
            return f"command line: {key}"
    file = _file_that_sets(key, arguments)
    return f"{file}: {key}" if file else key


def _file_that_sets(key: str, arguments: list[str]) -> str | None:
    """The experiment's or the group's file in `conf/` that mentions the key's last part."""
    group, leaf = key.split(".")[0], re.split(r"[.\[]", key)[-1]
    chosen = dict(a.lstrip("+").partition("=")[::2] for a in arguments if "=" in a)
    names = [("experiment", chosen.get("experiment")), (group, chosen.get(group))]
    for folder, name in names:
        path = Path(folder) / f"{name}.yaml"
        full = conf_dir() / path
        if name and full.is_file() and re.search(rf"\b{re.escape(leaf)}\s*:", full.read_text()):
            return f"conf/{path}"
    return None
