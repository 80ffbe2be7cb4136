"""Combinations of settings in one file, each with what is expected of it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import yaml
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from sldvexp.config.paths import displayed
from sldvexp.config.refusals import refusal
from sldvexp.config.security import looks_up
from sldvexp.errors import UserError, nearest
from sldvexp.files import read_text
from sldvexp.limits import YAML_BYTES, load_yaml, slow_pattern

#: What a setting may be called; Hydra's own decide nothing of a run, but could name code.
SETTING = r"(?!hydra\b)[\w./]+"
#: Combinations of a matrix at most.
MOST = 10_000
#: Texts that need no quotes on a command line.
PLAIN = r"[\w./:-]+"


@dataclass
class Rule:
    """Rule that holds for some of the combinations.

    Parameters
    ----------
    when : dict of str to value or list of values
        Of axes; it holds for combinations that have one of them on each. Empty for all.
    settings : dict of str to value
        Further settings, by their dotted names; those of a later rule win.
    run_of : dict of str to dict
        Settings that get the folder of another combination's run, ``{instrument.path: {instrument:
        simulated}}``: the one that differs on these axes.
    lab : str
        A setting that gets the address of a virtual lab, which is served meanwhile, with the
        combination's scene, laser and target.
    refused : str
        Pattern in the sentence with which the combination must be refused. Empty if it must work.
    run : bool
        False looks at the configuration and the files that it names, and runs nothing.
    expect : dict of str to Expectation
        As in an experiment.
    """

    when: dict[str, Any] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    run_of: dict[str, Any] = field(default_factory=dict)
    lab: str = ""
    refused: str = ""
    run: bool = True
    expect: dict[str, Any] = field(default_factory=dict)


@dataclass
class Matrix:
    """All combinations of the values of some settings.

    Parameters
    ----------
    axes : dict of str to list
        Settings with their values.
    settings : dict of str to value
        What all combinations have in common.
    expect : dict of str to Expectation
        Of all combinations that must work.
    rules : list of Rule
    """

    axes: dict[str, Any] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    expect: dict[str, Any] = field(default_factory=dict)
    rules: list[Rule] = field(default_factory=list)


@dataclass(frozen=True)
class Cell:
    """One combination.

    Attributes
    ----------
    name : str
        Its values on the axes, ``instrument=visa,pose=edge``.
    settings : tuple of str
        As on the command line.
    expect : dict of str to dict
        As in an experiment; an experiment's own come besides.
    refused : str
        Pattern of the sentence with which it must be refused; empty if it must work.
    run : bool
        False looks at the configuration and the files that it names, and runs nothing.
    lab : str
        Setting that gets the address of a virtual lab.
    run_of : dict of str to str
        Settings that get the folder of another cell's run, by the cell's name.
    """

    name: str
    settings: tuple[str, ...]
    expect: Mapping[str, Any] = field(default_factory=dict)
    refused: str = ""
    run: bool = True
    lab: str = ""
    run_of: Mapping[str, str] = field(default_factory=dict)


def read_matrix(path: Path) -> list[Cell]:
    """Read the combinations of a file, each once.

    Raises
    ------
    UserError
        If it is no such file, or a rule holds for nothing.
    """
    matrix, where = _read(path), displayed(path)
    for key in (*matrix.axes, *matrix.settings, *(k for r in matrix.rules for k in _set_by(r))):
        if not re.fullmatch(SETTING, key):
            raise UserError(f"{where}: {key} cannot be set here; write pose.path and the like")
    if not matrix.axes or not all(isinstance(v, list) and v for v in matrix.axes.values()):
        raise UserError(f"{where}: axes must name settings, each with a list of its values")
    count = math.prod(map(len, matrix.axes.values()))
    if count > MOST:
        raise UserError(f"{where}: has {count:.3g} combinations; a matrix has at most {MOST}")
    for number, rule in enumerate(matrix.rules):
        _require_known(rule, matrix.axes, f"{where}: rules[{number}]")
    combinations = [dict(zip(matrix.axes, v, strict=True)) for v in product(*matrix.axes.values())]
    return [_cell(matrix, combination) for combination in combinations]


def _read(path: Path) -> Matrix:
    try:
        text = read_text(path, YAML_BYTES)
        content = load_yaml(text)
        if "${" in text and (told := next(filter(None, map(looks_up, _texts(content))), "")):
            raise UserError(f"{displayed(path)}: {told}")
        matrix = OmegaConf.merge(OmegaConf.structured(Matrix), content or {})
        found: Matrix = OmegaConf.to_object(matrix)  # type: ignore[assignment]
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = f", line {mark.line + 1}" if mark else ""
        raise UserError(f"{displayed(path)}{line}: is not YAML: {error.problem}") from None
    except OmegaConfBaseException as error:
        told = f"{error.full_key or error.key or 'it'} {refusal(error)}"
        raise UserError(f"{displayed(path)}: {told}") from None
    except (ValueError, yaml.YAMLError):
        raise UserError(f"{displayed(path)}: must be a table with axes and rules") from None
    return found


def _texts(node: Any) -> Iterator[str]:
    """Yield every text, keys among them."""
    if isinstance(node, str):
        yield node
    elif isinstance(node, dict):
        yield from (text for pair in node.items() for part in pair for text in _texts(part))
    elif isinstance(node, list):
        yield from (text for part in node for text in _texts(part))


def _set_by(rule: Rule) -> Iterator[str]:
    yield from rule.settings
    yield from rule.run_of
    if rule.lab:
        yield rule.lab


def _require_known(rule: Rule, axes: Mapping[str, list[Any]], where: str) -> None:
    """Complain about values that are on no axis: the rule would hold for nothing."""
    pairs = [("when", rule.when), *((f"run_of.{k}", of) for k, of in rule.run_of.items())]
    for name, wanted in pairs:
        for axis, values in wanted.items() if isinstance(wanted, dict) else [(wanted, None)]:
            if axis not in axes:
                raise UserError(f"{where}.{name}: there is no axis {axis}; {nearest(axis, axes)}")
            for value in _listed(values):
                if value not in axes[axis]:
                    valid = nearest(str(value), map(str, axes[axis]))
                    raise UserError(f"{where}.{name}: {axis} has no value {value}; {valid}")
    try:
        re.compile(rule.refused)
    except re.error as error:
        raise UserError(f"{where}.refused: is no regular expression: {error}") from None
    if told := slow_pattern(rule.refused):
        raise UserError(f"{where}.refused: {told}")


def _cell(matrix: Matrix, values: Mapping[str, Any]) -> Cell:
    """Make one combination with all rules that hold for it."""
    rules = [
        r for r in matrix.rules if all(values[k] in _listed(wanted) for k, wanted in r.when.items())
    ]
    settings, expect = {**matrix.settings, **values}, dict(matrix.expect)
    run_of: dict[str, str] = {}
    for rule in rules:
        settings |= rule.settings
        expect |= rule.expect
        run_of |= {key: name_of({**values, **other}) for key, other in rule.run_of.items()}
    return Cell(
        name_of(values),
        tuple(map(_override, settings, settings.values())),
        expect,
        next((r.refused for r in reversed(rules) if r.refused), ""),
        all(r.run for r in rules),
        next((r.lab for r in reversed(rules) if r.lab), ""),
        run_of,
    )


def _override(key: str, value: Any) -> str:
    """Write a setting as on the command line; a group that is left out is written otherwise."""
    if value is None and "." not in key:
        return f"~{key}"
    return f"{key}={as_setting(value)}"


def name_of(values: Mapping[str, Any]) -> str:
    """Name of a combination."""
    return ",".join(f"{key}={as_setting(value)}" for key, value in values.items())


def as_setting(value: Any) -> str:
    """Write a value as on the command line.

    Examples
    --------
    >>> as_setting({"front": {"dac": [[1, 2]], "name": "two words"}})
    "{front:{dac:[[1,2]],name:'two words'}}"
    """
    if isinstance(value, Mapping):
        return f"{{{','.join(f'{key}:{as_setting(v)}' for key, v in value.items())}}}"
    if isinstance(value, list):
        return f"[{','.join(map(as_setting, value))}]"
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    text = str(value)
    if isinstance(value, int | float) or re.fullmatch(PLAIN, text):
        return text
    return "'" + text.replace("'", r"\'") + "'"


def _listed(values: Any) -> list[Any]:
    return values if isinstance(values, list) else [values]
