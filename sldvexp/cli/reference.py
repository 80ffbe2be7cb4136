"""Pages of the handbook that are made of the program itself: commands, settings and functions.

Texts are those of docstrings, dataclasses and configuration files, so that nothing stands twice.
"""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator
from typing import Any

from omegaconf import OmegaConf

import sldvexp
from sldvexp.cli import help as help_pages
from sldvexp.config import docs, registry
from sldvexp.config.experiment import Experiment
from sldvexp.config.paths import choices, conf_dir

#: Settings of no group, and the groups.
RUN = "run"
GROUPS = (RUN, *(group for group in registry.GROUPS if registry.BUILT_IN[group]))

#: Heading of a section of a numpydoc docstring.
SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}\n", re.MULTILINE)


def commands() -> str:
    """Write the page of all commands."""
    parts = ["# Commands", "Calls of the program with what each takes and does."]
    for name, one in help_pages.COMMAND_HELP.items():
        parts += [f"## `sldvexp {name}`", f"`sldvexp {name} {one.takes}`"]
        parts += [_prose(paragraph) for paragraph in one.told]
        if one.options:
            parts.append("\n".join(f"- `--{o}`: {_prose(t)}" for o, t in one.options.items()))
        parts.append(
            "\n".join(f"- `sldvexp {call}`: {_prose(does)}" for call, does in one.examples)
        )
    return "\n\n".join(parts) + "\n"


def settings(groups: tuple[str, ...] = ()) -> str:
    """Write the page of all settings, or of those of some groups.

    Parameters
    ----------
    groups : tuple of str
        Of `GROUPS`; all if it is empty.
    """
    parts = ["# Settings", "Every setting with its value, type, unit and meaning, group by group."]
    for group in groups or GROUPS:
        parts.append(f"## {group}")
        if group == RUN:
            node = OmegaConf.to_container(OmegaConf.structured(Experiment), enum_to_str=True)
            parts.append(_parameters(Experiment, dict(node)))  # type: ignore[arg-type]
        for name in registry.BUILT_IN.get(group, ()):
            plugin = registry.get(group, name)
            parts.append(f"### `{group}={name}`")
            parts += [_prose(paragraph) for paragraph in docs.description(plugin)]
            files = [f for f in _files(group, name) if f != name]
            if files:
                parts.append("Set up as " + ", ".join(f"`{group}={file}`" for file in files) + ".")
            node = OmegaConf.to_container(
                registry.schema_of(plugin), resolve=False, enum_to_str=True
            )
            parts.append(_parameters(plugin, dict(node)))  # type: ignore[arg-type]
    return "\n\n".join(part for part in parts if part) + "\n"


def _files(group: str, plugin: str) -> list[str]:
    """List the program's files that begin with a plugin's settings."""
    found = sorted((conf_dir() / group).rglob("*.yaml"))
    return [f.stem for f in found if f"schema/{plugin}" in choices(f).get(group, [])]


def _parameters(plugin: type, values: dict[str, Any]) -> str:
    """Write a list of settings."""
    lines = []
    for one in docs.parameters_of(plugin, values):
        value = f" `{one.value}`" if one.value else ""
        told = ". ".join(filter(None, [_prose(one.kind), _prose(one.meaning)]))
        lines.append(f"- `{one.key}`:{value} {told}".rstrip())
    return "\n".join(lines)


def rooms() -> list[str]:
    """List the modules whose faces name public functions and classes."""
    found = [m.name for m in pkgutil.iter_modules(sldvexp.__path__) if m.ispkg]
    named = [room for name in found if _named(room := f"sldvexp.{name}")]
    return ["sldvexp", *named]


def public(room: str) -> dict[str, Any]:
    """Find what a room's face names and the program has made."""
    return {
        name: thing
        for name, thing in _named(room).items()
        if getattr(thing, "__module__", "").startswith("sldvexp.")
    }


def _named(room: str) -> dict[str, Any]:
    """Find what a room's face names; a package's absence for what rests on one of an extra."""
    face = importlib.import_module(room)
    things: dict[str, Any] = {}
    for name in getattr(face, "__all__", ()):
        try:
            things[name] = getattr(face, name)
        except ModuleNotFoundError as absent:
            things[name] = absent
    return things


def functions(of: tuple[str, ...] = ()) -> str:
    """Write the page of all public functions and classes, or of those of some rooms.

    Parameters
    ----------
    of : tuple of str
        Rooms as ``sldvexp.pose``; all if it is empty.
    """
    parts = ["# Functions", "Public functions and classes of the rooms, with their examples."]
    for room in of or rooms():
        parts.append(f"## {room}")
        if room != "sldvexp":
            parts += _text(inspect.getdoc(importlib.import_module(room)) or "")
        for name, thing in public(room).items():
            parts.append(f"### `{name}`")
            parts.append(f"```python\n{_signature(name, thing)}\n```")
            parts += _text(inspect.getdoc(thing) or "")
        for name, absent in _named(room).items():
            if isinstance(absent, ModuleNotFoundError):
                parts.append(f"### `{name}`")
                parts.append(f"Needs the package {absent.name}, which is not installed.")
    return "\n\n".join(part for part in parts if part) + "\n"


def _signature(name: str, thing: Any) -> str:
    """Write how a function or class is called, a parameter a line if they are many."""
    try:
        told = f"{name}{inspect.signature(thing)}"
    except (TypeError, ValueError):
        return f"{name}(...)"
    told = re.sub(r"(: |-> )'([^']*)'", r"\1\2", told)
    told = re.sub(r"<(?:class )?'?([\w.]+)'?(?:: [^>]*)?>", r"\1", told.replace("<factory>", "..."))
    return told if len(told) < 100 else re.sub(r", (?=\w+: |\*)", ",\n    ", told)


def _text(docstring: str) -> list[str]:
    """Turn a numpydoc docstring into paragraphs of Markdown."""
    head, *sections = SECTION.split(docstring)
    parts = _paragraphs(head)
    for title, body in zip(sections[::2], sections[1::2], strict=True):
        parts.append(f"*{title}*")
        if title.startswith("Example"):
            parts.append(f"```pycon\n{body.strip()}\n```")
        else:
            parts += list(_entries(body))
    return parts


def _paragraphs(text: str) -> list[str]:
    """Keep paragraphs, with what is indented or an example set as code."""
    parts = []
    for paragraph in re.split(r"\n\s*\n", text.strip("\n")):
        if paragraph.startswith(">>>"):
            parts.append(f"```pycon\n{paragraph}\n```")
        elif paragraph.startswith("    "):
            parts.append(f"```text\n{inspect.cleandoc(paragraph)}\n```")
        else:
            items = (
                re.split(r"\n(?=\S+\n    )", paragraph) if "\n    " in paragraph else [paragraph]
            )
            parts += [_prose(" ".join(item.split())) for item in items]
    return parts


def _entries(body: str) -> Iterator[str]:
    """Yield the entries of a section, names and kinds with their meanings."""
    entries = [e for e in re.split(r"^(?=\S)", body, flags=re.MULTILINE) if e.strip()]
    lines = []
    for entry in entries:
        head, _, meaning = entry.partition("\n")
        name, colon, kind = head.partition(" : ")
        told = f" {_prose(' '.join(meaning.split()))}" if meaning.strip() else ""
        lines.append(f"- `{name}`{f': {_prose(kind)}' if colon else ''}.{told}".replace("..", "."))
    yield "\n".join(lines)


def _prose(text: str) -> str:
    """Escape what Markdown would take for marks, outside of code."""
    text = re.sub(r"``([^`]+)``", r"`\1`", text)
    parts = re.split(r"(`[^`]*`)", text)
    marks = re.compile(r"([<*]|(?<!\w)_|_(?!\w))")
    return "".join(p if p.startswith("`") else marks.sub(r"\\\1", p) for p in parts)


#: Pages that are made, by name.
PAGES = {"commands": commands, "settings": settings, "functions": functions}
