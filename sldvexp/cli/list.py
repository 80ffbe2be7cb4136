"""`sldvexp list [group or word]`: plugins by group and the experiments, each in a sentence."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from sldvexp.cli.layout import columns
from sldvexp.config import docs, paths, registry
from sldvexp.config.paths import conf_dir
from sldvexp.errors import UserError, nearest

EXPERIMENT = "experiment"


def run(words: list[str], config_dir: str | None) -> int:
    """Print the list: of all groups, of one, or of what has a word in its name or description.

    Raises
    ------
    UserError
        If there is more than one word, or it is found nowhere.
    """
    groups = (*registry.GROUPS, EXPERIMENT)
    if len(words) > 1:
        raise UserError(
            f"command line: list takes one group or part of a name, not {' '.join(words)}"
        )
    where = folders(config_dir)
    if words and words[0] not in groups:
        found = {group: _with(words[0], group, where) for group in groups}
        if not any(found.values()):
            told = nearest(words[0], groups)
            raise UserError(
                f"command line: there is no group {words[0]}, and nothing has it in its name or "
                f"description; {told}"
            )
    else:
        found = {group: list(_entries(group, where)) for group in words or groups}
    for group, entries in found.items():
        if entries or words == [group]:
            print("\n".join([group, *columns(entries), ""]))
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


def _with(word: str, group: str, folders: list[Path]) -> list[tuple[str, str]]:
    """List the entries of a group that have a word in name or description."""
    entries = _entries(group, folders)
    return [
        (name, told) for name, told in entries if word.casefold() in f"{name} {told}".casefold()
    ]


def _entries(group: str, folders: list[Path]) -> Iterator[tuple[str, str]]:
    """Yield name and description: what it is, who brings it, which files set it up."""
    found = files(group, folders)
    if group == EXPERIMENT:
        yield from ((name, docs.of_file(file)) for name, file in found.items())
        return
    bases = {name: paths.choices(f).get(f.parent.name, []) for name, f in found.items()}
    for name in registry.names(group):
        told = docs.of_choice(group, name)
        choices = _choices_of(name, bases)
        if choices not in ([], [name]):
            told += f"; {', '.join(f'{group}={choice}' for choice in choices)}"
        if name not in registry.BUILT_IN[group] and (by := origin(registry.get(group, name))):
            told += f"  [{by}]"
        yield name, told


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
