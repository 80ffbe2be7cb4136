"""Command profiles from YAML files, with complaints that name the file and the key."""

from __future__ import annotations

from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

import yaml

from sldvexp.config.paths import conf_dir, locate
from sldvexp.errors import Checks, ConfigError, UserError, nearest
from sldvexp.files import read_text
from sldvexp.instrument.profile import Profile
from sldvexp.instrument.profile_checks import check

SUFFIXES = (".yaml", ".yml")


class _Texts(yaml.BaseLoader):
    """YAML whose values stay the text that was written: a command ``OFF`` is not a `False`."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            name = str(key.value)
            if name in seen:
                told = f"{name} is given twice"
                raise yaml.MarkedYAMLError(problem=told, problem_mark=key.start_mark)
            seen.add(name)
        return super().construct_mapping(node, deep)


def profile_path(name: str) -> Path:
    """The file of a profile.

    Parameters
    ----------
    name : str
        Of a profile that comes with the program, or a path to a YAML file.

    Raises
    ------
    UserError
        If there is no such profile.
    """
    if name.endswith(SUFFIXES):
        path = locate(name)
        if not path.is_file():
            raise UserError(f"{path}: there is no such profile (looked from {Path.cwd()})")
        return path
    path = conf_dir() / "profile" / f"{name}.yaml"
    if not path.is_file():
        valid = nearest(name, [p.stem for p in path.parent.glob("*.yaml")])
        raise UserError(f"there is no profile {name}; {valid}, or the path of a .yaml file")
    return path


def load_profile(name: str) -> Profile:
    """The profile of that name or path.

    Raises
    ------
    UserError
        If it does not exist, or says what no profile can; names the file and every wrong key.
    """
    path = profile_path(name)
    try:
        content = yaml.load(read_text(path), _Texts)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        line = f", line {mark.line + 1}" if mark else ""
        told = getattr(error, "problem", None) or str(error).splitlines()[0]
        raise UserError(f"{path}{line}: is not a profile: {told}") from None
    if not isinstance(content, dict):
        raise UserError(f"{path}: is not a profile: it must be a table of settings")
    checks = Checks()
    try:
        profile: Profile = _made(Profile, content, "", checks)
        checks.done()
        check(profile, checks)
        checks.done()
    except ConfigError as error:
        told = "; ".join(f"{p.field} {p.message}" for p in error.problems)
        raise UserError(f"{path}: {told}") from None
    return profile


def _made(kind: Any, node: Any, key: str, checks: Checks) -> Any:
    """What a type hint says, from texts, lists and tables; what does not fit is noted."""
    if is_dataclass(kind):
        return _made_table(kind, node, key, checks)
    inner = get_args(kind)
    if get_origin(kind) is dict:
        checks.require(isinstance(node, dict), key, "must be a table, as in {name: value}")
        entries = node.items() if isinstance(node, dict) else ()
        return {name: _made(inner[1], v, f"{key}.{name}", checks) for name, v in entries}
    if get_origin(kind) is list:
        checks.require(isinstance(node, list), key, "must be a list, as in [a, b]")
        items = node if isinstance(node, list) else ()
        return [_made(inner[0], v, f"{key}[{i}]", checks) for i, v in enumerate(items)]
    if not isinstance(node, str):
        found = "a table" if isinstance(node, dict) else "a list"
        checks.require(False, key, f"must be one value, not {found}")
        return None
    names = {"true": True, "false": False} if kind is bool else getattr(kind, "__members__", None)
    if names is not None:
        checks.require(node in names, key, f"cannot be {node or 'empty'}; {nearest(node, names)}")
        return names.get(node)
    if kind is not float:
        return node
    try:
        return float(node)
    except ValueError:
        checks.require(False, key, f"must be a number, not {node or 'empty'}")


def _made_table(kind: Any, node: Any, key: str, checks: Checks) -> Any:
    """A dataclass from a table, None if something is wrong with it."""
    if not isinstance(node, dict):
        names = ", ".join(f.name for f in fields(kind))
        checks.require(False, key, f"must be a table of the settings {names}")
        return None
    known, before = {f.name: f for f in fields(kind)}, len(checks.problems)
    hints = get_type_hints(kind)
    below = f"{key}." if key else ""
    for name in node:
        message = f"is not a known setting; {nearest(name, known)}"
        checks.require(name in known, f"{below}{name}", message)
    for name, f in known.items():
        optional = f.default is not MISSING or f.default_factory is not MISSING
        checks.require(name in node or optional, f"{below}{name}", "must be given")
    values = {n: _made(hints[n], node[n], f"{below}{n}", checks) for n in known if n in node}
    return kind(**values) if len(checks.problems) == before else None
