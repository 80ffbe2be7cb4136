"""Command profiles from YAML files, with complaints that name the file and the key.

What makes a command profile useless, found before anything is sent.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from string import Formatter
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

import yaml

from sldvexp.config.paths import conf_dir, locate
from sldvexp.errors import Checks, ConfigError, UserError, nearest
from sldvexp.files import read_text
from sldvexp.instrument.profile import CHANNELS, BenchQuestions, Commands, Profile
from sldvexp.limits import YAML_BYTES, load_yaml, slow_pattern
from sldvexp.signal import ExcitationKind

SUFFIXES = (".yaml", ".yml")

#: Rows or columns of a camera's picture at most.
LARGEST_PICTURE = 2000


class _Texts(yaml.constructor.BaseConstructor):
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


class _WordedTexts(_Texts, yaml.BaseLoader):
    """The usual parser, which has the better words."""


class _CompiledTexts(_Texts, getattr(yaml, "CBaseLoader", yaml.BaseLoader)):  # type: ignore[misc]
    """The parser that is compiled, where there is one."""


def _texts_of(text: str) -> Any:
    """Read the tables, lists and texts of a profile."""
    try:
        return load_yaml(text, _CompiledTexts)
    except yaml.YAMLError:
        return load_yaml(text, _WordedTexts)


def profile_path(name: str) -> Path:
    """Find the file of a profile.

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
    """Load the profile of that name or path.

    Raises
    ------
    UserError
        If it does not exist, or says what no profile can; names the file and every wrong key.
    """
    path = profile_path(name)
    try:
        content = _texts_of(read_text(path, YAML_BYTES))
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
    """Make what a type hint says from texts, lists and tables; note what does not fit."""
    if is_dataclass(kind):
        return _made_table(kind, node, key, checks)
    inner = get_args(kind)
    if get_origin(kind) is UnionType:  # a table that may be left out
        return _made(inner[0], node, key, checks)
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
    if kind not in (int, float):
        return node
    try:
        return kind(node)
    except ValueError:
        number = "a whole number" if kind is int else "a number"
        checks.require(False, key, f"must be {number}, not {node or 'empty'}")


def _made_table(kind: Any, node: Any, key: str, checks: Checks) -> Any:
    """Make a dataclass from a table, None if something is wrong with it."""
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


SAMPLING = ("rate", "interval", "interval_us", "samples")
GENERATOR = ("frequencies", "amplitude")
PLAY = ("function", "waveform", "low", "high", "lines", "seed", "burst", "samples", "amplitude")

#: What the commands of each group may be filled with.
PLACEHOLDERS: dict[str, tuple[str, ...]] = {
    "setup": (),
    "view": ("view",),
    "configure": (*SAMPLING, *GENERATOR),
    "generator_on": GENERATOR,
    "generator_off": (),
    "play": PLAY,
    "records": ("records", "lead", "trigger", "samples"),
    "move": ("up_down", "left_right"),
    "home": (),
    "acquire": ("samples",),
    "stream": ("stream",),
    "scan": ("positions", "pixels", "samples"),
}

#: Groups without which nothing can be measured, and what they are for.
NEEDED = {
    "configure": "sets the sampling",
    "move": "points the beam",
    "home": "sends the mirrors home",
    "acquire": "samples one pixel",
}

#: Of which placeholders a group must have one each.
TELLS = {
    "configure": (("rate", "interval", "interval_us"), ("samples",)),
    "play": (("function", "waveform"),),
    "records": (("records",),),
    "move": (("up_down",), ("left_right",)),
    "scan": (("positions",),),
}

#: A format that makes a value long.
WIDE = re.compile(r"\{[^{}]*:[^{}]*\d{4}")

#: A value of each placeholder, to try a command with.
EXAMPLES = {name: 1 for names in PLACEHOLDERS.values() for name in names} | {
    "rate": 1.0,
    "interval": 1.0,
    "amplitude": 1.0,
    "frequencies": "1.0",
    "function": "1",
    "waveform": "1.0",
    "lines": "1",
    "trigger": "1",
    "low": 1.0,
    "high": 1.0,
    "burst": 1.0,
    "positions": "1,1",
    "view": "1",
}


def check(profile: Profile, checks: Checks) -> None:
    """Note everything that keeps a profile from working."""
    checks.non_negative("settle", profile.settle)
    checks.require(bool(profile.devices), "devices", "must be given, as in {name: {...}}")
    for name, device in profile.devices.items():
        _expression(checks, f"devices.{name}.identity", device.identity)
        _expression(checks, f"devices.{name}.errors.answer", device.errors.answer, groups=1)
        for end in ("sent_end", "answer_end"):
            text = getattr(device, end)
            checks.require(bool(text), f"devices.{name}.{end}", 'must be given, as in "\\n"')
        checks.non_negative(f"devices.{name}.banner", device.banner)
    for group, allowed in PLACEHOLDERS.items():
        _check_group(profile, checks, group, allowed)
    for group, purpose in NEEDED.items():
        given = any(getattr(profile.commands, group).values())
        message = f"is missing: give the command that {purpose}, as in {{device: [command]}}"
        checks.require(given, f"commands.{group}", message)
    off = bool(profile.commands.generator_off) or not profile.commands.generator_on
    message = "is missing: what turns the generator on must be able to turn it off"
    checks.require(off, "commands.generator_off", message)
    kinds = [kind.name for kind in ExcitationKind]
    for kind in profile.functions:
        checks.require(kind in kinds, f"functions.{kind}", f"is no kind; {nearest(kind, kinds)}")
    for i, question in enumerate(profile.verify):
        _check_device(profile, checks, f"verify[{i}].device", question.device)
    _check_data(profile, checks)
    if profile.bench is not None:
        _check_bench(profile, profile.bench, checks)


def _check_group(profile: Profile, checks: Checks, group: str, allowed: tuple[str, ...]) -> None:
    """Check that commands address known devices, and say what they must and no more."""
    commands: Commands = getattr(profile.commands, group)
    for device, texts in commands.items():
        _check_device(profile, checks, f"commands.{group}.{device}", device)
        for i, text in enumerate(texts):
            _check_placeholders(checks, f"commands.{group}.{device}[{i}]", text, allowed)
    said = {p for texts in commands.values() for text in texts for p in _named(text)}
    for among in TELLS.get(group, ()) if commands else ():
        message = f"must have a command with {' or '.join(f'{{{p}}}' for p in among)}"
        checks.require(not said.isdisjoint(among), f"commands.{group}", message)


def _check_data(profile: Profile, checks: Checks) -> None:
    """Check that blocks come from a known device, hold both channels, and have a scale."""
    data = profile.data
    _check_device(profile, checks, "data.device", data.device)
    message = f"must be {' and '.join(CHANNELS)} in the block's order, not {data.channels}"
    checks.require(sorted(data.channels) == sorted(CHANNELS), "data.channels", message)
    one = bool(data.scale) != bool(data.volts_per_count)
    message = "is missing: give either scale, a question, or volts_per_count, its numbers"
    checks.require(one, "data.scale", message)
    for channel, volts in data.volts_per_count.items():
        key = f"data.volts_per_count.{channel}"
        checks.require(channel in CHANNELS, key, f"is not a channel; {nearest(channel, CHANNELS)}")
        checks.positive(key, volts)
    for channel in CHANNELS if data.volts_per_count else ():
        key = f"data.volts_per_count.{channel}"
        checks.require(channel in data.volts_per_count, key, "is missing")


def _check_bench(profile: Profile, bench: BenchQuestions, checks: Checks) -> None:
    """Check that the questions go to a known device, and a picture, like samples, has a size."""
    _check_device(profile, checks, "bench.device", bench.device)
    if not bench.picture:
        return
    same = bench.device == profile.data.device
    message = f"comes as a block as those of data.device, {profile.data.device}, do"
    checks.require(same, "bench.picture", message)
    size = bench.picture_size
    good = len(size) == 2 and all(0 < n <= LARGEST_PICTURE for n in size)
    message = f"must be rows and columns, up to {LARGEST_PICTURE} each, not {size}"
    checks.require(good, "bench.picture_size", message)


def _check_device(profile: Profile, checks: Checks, key: str, device: str) -> None:
    """Check that a device that is named is one of the profile's."""
    message = f"addresses the unknown device {device}; {nearest(device, profile.devices)}"
    checks.require(device in profile.devices or not profile.devices, key, message)


def _expression(checks: Checks, key: str, text: str, groups: int = 0) -> None:
    """Note what is no regular expression or has too few groups."""
    try:
        found = re.compile(text).groups
    except (re.error, OverflowError, RecursionError) as error:
        checks.require(False, key, f"is not a regular expression: {error}")
        return
    told = slow_pattern(text)
    checks.require(not told, key, told)
    checks.require(found >= groups, key, r"must have the code in parentheses, as in (-?\d+),.*")


def _named(text: str) -> Iterator[str]:
    """Yield the placeholders of a command; none of one that cannot be read."""
    try:
        parsed = list(Formatter().parse(text))
    except ValueError:
        return
    yield from (name for _, name, _, _ in parsed if name is not None)


def _check_placeholders(checks: Checks, key: str, text: str, allowed: tuple[str, ...]) -> None:
    """Note the first thing that keeps a command from being filled."""
    for name in _named(text):
        if name not in allowed:
            valid = nearest(name, allowed).replace("there are none", "none is allowed here")
            checks.require(False, key, f"has the unknown placeholder {{{name}}}; {valid}")
            return
    if WIDE.search(text):
        checks.require(False, key, "pads a value to a thousand characters or more")
        return
    try:
        text.format(**{name: EXAMPLES[name] for name in allowed})
    except (ValueError, IndexError, KeyError) as error:
        checks.require(False, key, f"is no command that can be filled: {error}")
