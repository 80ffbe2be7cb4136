"""Command profiles from YAML files, with complaints that name the file and the key."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from sldvexp.errors import ConfigError, UserError, nearest
from sldvexp.files import read_text
from sldvexp.instrument.profile import Profile
from sldvexp.paths import conf_dir, locate
from sldvexp.wording import refusal

SUFFIXES = (".yaml", ".yml")


class _Texts(yaml.BaseLoader):
    """YAML whose values stay the text that was written: a command ``OFF`` is not a `False`."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key, _ in node.value:
            if key.value in seen:
                raise yaml.MarkedYAMLError(
                    problem=f"{key.value} is given twice", problem_mark=key.start_mark
                )
            seen.add(key.value)
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
        content = yaml.load(read_text(path), _Texts)  # noqa: S506 (it makes texts only)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = f", line {mark.line + 1}" if mark else ""
        raise UserError(f"{path}{line}: is not a profile: {error.problem}") from None
    if not isinstance(content, dict):
        raise UserError(f"{path}: is not a profile: it must be a table of settings")
    try:
        merged = OmegaConf.merge(OmegaConf.structured(Profile), content)
        missing = sorted(OmegaConf.missing_keys(merged))
        if missing:
            raise UserError(f"{path}: {missing[0]} must be given")
        profile: Any = OmegaConf.to_object(merged)
    except OmegaConfBaseException as error:
        raise UserError(f"{path}: {error.full_key} {refusal(error)}") from None
    except ConfigError as error:
        told = "; ".join(f"{p.field} {p.message}" for p in error.problems)
        raise UserError(f"{path}: {told}") from None
    return profile
