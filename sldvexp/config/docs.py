"""Words about choices from where they are made: a file's comment, a plugin's docstring.

The fields of a plugin as its configuration has them: value, type with unit, meaning.
"""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from enum import Enum
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeGuard, get_args, get_origin, get_type_hints

import yaml
from omegaconf import MISSING, OmegaConf

from sldvexp.config import registry

#: Bytes in which the comment at the beginning of a file must end.
MOST_OF_COMMENT = 2**14
#: Writer of values, in C where PyYAML has it, and characters of a line that never ends.
DUMPER: Any = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
WIDE = 2**31 - 1


def of_file(file: Path) -> str:
    """Take the first sentence of a configuration file's first comment."""
    return sentence(" ".join(comment(file)))


def of_plugin(plugin: type) -> str:
    """Take the first sentence of a plugin's docstring."""
    return sentence(next(iter(description(plugin)), ""))


def of_choice(group: str, name: str) -> str:
    """Read the first sentence of a plugin's docstring.

    That of a built-in plugin comes from its file, which is read a hundred times faster than it is
    imported with all that it needs.
    """
    module = registry.BUILT_IN[group].get(name, "").partition(".")[2]
    file = Path(__file__).parents[1].joinpath(*module.split(".")).with_suffix(".py")
    start = rf'^@register\("{group}", "{name}"\)\n@dataclass\nclass [^:]*:\n +"""'
    text = file.read_text(encoding="utf-8") if file.is_file() else ""
    if found := re.search(rf"{start}(.*?)(\n\n|\"\"\")", text, re.MULTILINE | re.DOTALL):
        return sentence(_plain(found[1]))
    return of_plugin(registry.get(group, name))


def description(plugin: type) -> list[str]:
    """Take the paragraphs of a plugin's docstring, up to its sections."""
    told = inspect.cleandoc(plugin.__dict__.get("__doc__") or "")
    if told.startswith(f"{plugin.__name__}("):
        return []  # a dataclass without a docstring gets its signature
    told = re.split(r"^\w.*\n-+$", told, maxsplit=1, flags=re.MULTILINE)[0]
    return [_plain(part) for part in told.split("\n\n") if part.strip()]


def _plain(paragraph: str) -> str:
    """Write a paragraph of a docstring on one line, without marks."""
    return " ".join(paragraph.split()).replace("`", "")


def comment(file: Path) -> list[str]:
    """Take the lines of the comment that a configuration file begins with, but for Hydra's."""
    lines = []
    with file.open("rb") as opened:
        text = opened.read(MOST_OF_COMMENT).decode("utf-8", "replace")
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        if "@package" not in line:
            lines.append(line.lstrip("# ").rstrip())
    return lines


def sentence(words: str) -> str:
    """Take the text up to the first full stop that ends a sentence."""
    end = words.find(". ")
    return (words if end < 0 else words[:end]).rstrip(".")


#: Headings of numpydoc under which a class describes its fields.
HEADINGS = ("Parameters", "Attributes")


@dataclass(frozen=True)
class Parameter:
    """One field, or one of a table that is the value of a field.

    Parameters
    ----------
    key : str
        Dotted, below the plugin; what a user names is in angle brackets, ``views.<name>.euler``.
    value : str
        As a configuration file would have it; empty if the fields below say it.
    kind : str
        Type and unit.
    meaning : str
    """

    key: str
    value: str
    kind: str
    meaning: str


def parameters_of(plugin: type, values: Mapping[str, Any], above: str = "") -> Iterator[Parameter]:
    """Yield all fields of a plugin, those of tables below them.

    Parameters
    ----------
    plugin : type
        A dataclass.
    values : dict
        What its fields are set to, as a container of plain values.
    above : str
        The dotted key of the table, with a dot at its end.
    """
    described = documented(plugin)
    hints = get_type_hints(plugin)
    for field in fields(plugin):
        key, hint = f"{above}{field.name}", hints[field.name]
        kind, meaning = described.get(field.name, ("", ""))
        value = values.get(field.name)
        if _is_table(hint):
            yield Parameter(key, "", "", _told(meaning, hint))
            yield from parameters_of(hint, value if isinstance(value, dict) else {}, f"{key}.")
            continue
        entries = list(_entries(hint))
        told = _told(meaning, *(entry for entry, _ in entries))
        yield Parameter(key, as_yaml(value), _kind(hint, kind), told)
        for entry, label in entries:
            # What an entry of the user's has where it says nothing.
            yield from parameters_of(entry, _defaults(entry), f"{key}{label}.")


def documented(plugin: type) -> dict[str, tuple[str, str]]:
    """Read type and meaning of each field from the docstrings of a class and its bases."""
    found: dict[str, tuple[str, str]] = {}
    for cls in reversed(plugin.__mro__):
        found |= _described(inspect.cleandoc(cls.__dict__.get("__doc__") or ""))
    return found


def as_yaml(value: Any) -> str:
    """Write a plain value on one line."""
    if value == MISSING:
        return "(must be given)"
    plain = value is None or isinstance(value, bool | int | str)
    return _plain_as_yaml(value) if plain else _dumped(value)


@lru_cache(maxsize=1024, typed=True)
def _plain_as_yaml(value: bool | int | str | None) -> str:
    return _dumped(value)


def _dumped(value: Any) -> str:
    look: Any = {"default_flow_style": True, "width": WIDE, "sort_keys": False}
    text: str = yaml.dump(value, Dumper=DUMPER, **look)
    return text.removesuffix("\n").removesuffix("\n...")


def _described(docstring: str) -> dict[str, tuple[str, str]]:
    """Read the entries of the sections that describe fields."""
    found: dict[str, tuple[str, str]] = {}
    for heading in HEADINGS:
        section = re.search(rf"^{heading}\n-+\n(.*?)(?=^\w[^\n]*\n-+$|\Z)", docstring, re.M | re.S)
        entries = re.split(r"^(?=\S)", section[1], flags=re.M) if section else []
        for entry in filter(str.strip, entries):
            head, _, body = entry.partition("\n")
            names, _, kind = head.partition(" : ")
            meaning = " ".join(body.split()).replace("`", "")
            found |= {name.strip(): (kind.strip(), meaning) for name in names.split(",")}
    return found


def _told(meaning: str, *tables: type) -> str:
    """Say what a field means, and what the tables in it are."""
    return " ".join(filter(None, [meaning, *("".join(description(t)[:1]) for t in tables)]))


def _kind(hint: Any, kind: str) -> str:
    """Say type and unit: of an enumeration its members, else as documented."""
    for part in (hint, *get_args(hint)):
        if inspect.isclass(part) and issubclass(part, Enum):
            _, comma, unit = kind.partition(", ")
            many = "any of" if get_origin(hint) in (dict, list) else "one of"
            return f"{many} {', '.join(part.__members__)}{comma}{unit}"
    return kind or getattr(hint, "__name__", str(hint))


def _entries(hint: Any) -> Iterator[tuple[type, str]]:
    """Yield the dataclasses in a table or list of them, with what stands for their place in it."""
    arguments = get_args(hint)
    for argument in filter(_is_table, arguments):
        if get_origin(hint) is dict:
            label = ".<number>" if arguments[0] is int else ".<name>"
        else:
            label = "[i]" if get_origin(hint) is list else ""
        yield argument, label


def _is_table(hint: Any) -> TypeGuard[type]:
    return inspect.isclass(hint) and is_dataclass(hint)


@lru_cache(maxsize=256)
def _defaults(entry: type) -> Mapping[str, Any]:
    """Find what an entry's fields are if nothing is said."""
    values: Any = OmegaConf.to_container(OmegaConf.structured(entry), enum_to_str=True)
    return MappingProxyType(values)
