"""`sldvexp list [group]`: plugins by group and the experiments, with one line each."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from sldvexp.config import docs, paths, registry
from sldvexp.config.paths import conf_dir
from sldvexp.errors import UserError, nearest

#: Characters of a line, its name left out.
WIDTH = 90

EXPERIMENT = "experiment"


def run(words: list[str], config_dir: str | None) -> int:
    """Print the list, of all groups or of one.

    Raises
    ------
    UserError
        If the words are not the name of one group.
    """
    groups = (*registry.GROUPS, EXPERIMENT)
    if len(words) > 1:
        raise UserError(f"command line: list takes one group or none, not {' '.join(words)}")
    if words and words[0] not in groups:
        raise UserError(f"command line: there is no group {words[0]}; {nearest(words[0], groups)}")
    for group in words or groups:
        print("\n".join([group, *_lines(group, folders(config_dir)), ""]))
    print("sldvexp show group=name explains one of them.")
    return 0


def folders(config_dir: str | None) -> list[Path]:
    """List where configuration files are looked for: the user's folder wins over the program's."""
    registry.load_installed()
    others = [package.conf for package in registry.packages() if package.conf]
    return [*([Path(config_dir)] if config_dir else []), conf_dir(), *others]


def files(group: str, folders: list[Path]) -> dict[str, Path]:
    """Find the configuration files of a group by what chooses them."""
    found: dict[str, Path] = {}
    for folder in folders:
        for path in sorted((folder / group).rglob("*.yaml")):
            found.setdefault(str(path.relative_to(folder / group).with_suffix("")), path)
    return found


def _lines(group: str, folders: list[Path]) -> Iterator[str]:
    """Yield the lines of a group, names in a column of their own."""
    entries = list(_entries(group, folders))
    width = max((len(name) for name, _, _ in entries), default=0)
    for name, told, origin in entries:
        words = docs.shortened(told, WIDTH - len(origin))
        yield f"  {name:{width}}  {words}{f'  [{origin}]' if origin else ''}".rstrip()


def _entries(group: str, folders: list[Path]) -> Iterator[tuple[str, str, str]]:
    """Name, what it is, and the package it comes from."""
    found = files(group, folders)
    if group == EXPERIMENT:
        yield from ((name, docs.of_file(file), "") for name, file in found.items())
        return
    bases = {name: paths.choices(f).get(f.parent.name, []) for name, f in found.items()}
    for name in registry.names(group):
        own = name in registry.BUILT_IN[group]
        yield name, docs.of_choice(group, name), "" if own else origin(registry.get(group, name))
        choices = _choices_of(name, bases)
        if choices not in ([], [name]):
            yield "", ", ".join(f"{group}={choice}" for choice in choices), ""


def origin(plugin: type) -> str:
    """Name the package of a plugin that is not built in, with its version."""
    if registry.is_built_in(plugin):
        return ""
    package = registry.package_of(plugin)
    return f"{package.name} {package.version}".strip() if package else plugin.__module__


def _choices_of(plugin: str, bases: dict[str, list[str]]) -> list[str]:
    """List the files that set up a plugin, also by way of others.

    `bases` is what each begins with.
    """
    found = {f"schema/{plugin}"}
    while more := {name for name, base in bases.items() if found & set(base)} - found:
        found |= more
    return sorted(found - {f"schema/{plugin}"})
