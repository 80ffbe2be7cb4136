"""`sldvexp show`: the page of an experiment or of a plugin, with every setting and its meaning.

Of a run, all that it found; of a sweep, the table of its runs.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from sldvexp import cli
from sldvexp.cli.layout import columns, wrapped
from sldvexp.cli.list import EXPERIMENT, files, folders, origin
from sldvexp.config import Origins, docs, messages, registry
from sldvexp.config.docs import as_yaml
from sldvexp.config.experiment import SINGLE_GROUPS
from sldvexp.config.paths import RUN_FILE, conf_dir, displayed
from sldvexp.config.sources import ConfigLayer
from sldvexp.errors import UserError, nearest

#: By which a folder is told to be a sweep's, or that of a run that may not be done.
SWEEP_FILE, HYDRA_FOLDER = "sweep.nc", ".hydra"


def run(words: list[str], config_dir: str | None) -> int:
    """Print the page about one choice, or the list of those that part of a name fits, or a run.

    Raises
    ------
    UserError
        If the words are not one choice or part of its name, or its files cannot be composed.
    """
    if len(words) != 1:
        told = f", not {' '.join(words)}" if words else ""
        raise UserError(
            f"command line: show takes one group=name, as in reconstruction=absolute{told}; "
            "sldvexp list lists them; or the folder of a run or a sweep"
        )
    if is_run(words[0]):
        cli.details.print_details(Path(words[0]))
        return 0
    found = choices_of(words[0], folders(config_dir))
    if len(found) > 1:
        print("\n".join([f"Several have {words[0]}:", *columns(_told_of(found, config_dir))]))
        return 0
    group, _, name = found[0].partition("=")
    options = ["--config-dir", config_dir] if config_dir else []
    file = files(group, folders(config_dir)).get(name)
    if group == EXPERIMENT:
        assert file
        origins = Origins([found[0], *options])
        lines = experiment_lines(found[0], file, origins, _composed(origins))
    elif group in SINGLE_GROUPS:
        config = _composed(Origins(["~experiment", found[0], *options]))
        lines = plugin_lines(group, config[group], file)
    else:
        node = registry.schema_of(registry.get(group, name))
        lines = plugin_lines(group, node, None)
    print("\n".join([found[0], "", *lines]))
    return 0


def is_run(word: str) -> bool:
    """Tell whether a word is a file, or a folder that no choice could be meant by."""
    path = Path(word)
    files = (RUN_FILE, SWEEP_FILE, HYDRA_FOLDER)
    return path.suffix == ".nc" or (
        path.is_dir() and (os.sep in word or any((path / name).exists() for name in files))
    )


def choices_of(word: str, folders: list[Path]) -> list[str]:
    """Find what a word means: ``group=name``, ``group=part of a name``, a group, or such a part.

    Raises
    ------
    UserError
        If it means nothing.
    """
    groups = (*registry.GROUPS, EXPERIMENT)
    names = {g: sorted({*files(g, folders), *registry.names(g)}) for g in groups}
    group, equals, name = word.partition("=")
    if equals and group not in groups:
        raise UserError(f"command line: there is no group {group}; {nearest(group, groups)}")
    if equals and name in names[group]:
        return [word]
    if not equals and word in groups:
        return [f"{word}={each}" for each in names[word]]
    part, among = (name, (group,)) if equals else (word, groups)
    every = [f"{g}={each}" for g in among for each in names[g]]
    exact = [choice for choice in every if choice.partition("=")[2] == part]
    close = [choice for choice in every if len(part) > 1 and part in choice.partition("=")[2]]
    if exact or close:
        return exact or close
    valid = names[group] if equals else [n for each in names.values() for n in each]
    if equals:
        raise UserError(f"command line: there is no {word}; {nearest(part, valid)}")
    guess = nearest(part, valid).partition("Valid: ")[0] or "sldvexp list lists all"
    raise UserError(f"command line: no name has {word} in it; {guess}".rstrip())


def _told_of(choices: list[str], config_dir: str | None) -> list[tuple[str, str]]:
    """Pair choices with what each is."""
    told = []
    for choice in choices:
        group, _, name = choice.partition("=")
        file = files(group, folders(config_dir)).get(name)
        told.append((choice, docs.of_file(file) if file else docs.of_choice(group, name)))
    return told


def _composed(origins: Origins) -> DictConfig:
    try:
        return origins.compose()
    except Exception as error:  # Hydra's and OmegaConf's have no common base
        raise UserError(messages.of_composition(error, origins)) from error


def experiment_lines(
    choice: str, file: Path, origins: Origins, config: DictConfig
) -> Iterator[str]:
    """Yield the page, line by line.

    Parameters
    ----------
    choice : str
        ``experiment=name``.
    origins : Origins
        Of the configuration that chooses it.
    config : DictConfig
        That configuration, composed.
    """
    for paragraph in "\n".join(docs.comment(file)).split("\n\n"):
        yield from [*wrapped(" ".join(paragraph.split())), ""]
    yield f"file  {displayed(file.resolve())}"
    yield from ["", "It chooses"]
    chosen = config.hydra.runtime.choices
    yield from (f"  {g}={chosen[g]}" for g in SINGLE_GROUPS if config[g] is not None)
    root = displayed(conf_dir() / "config.yaml")
    for layer in origins.layers_of_files():
        if layer.values and not layer.package and layer.source != root:
            yield from ["", f"{layer.source} sets", *_settings_of_file(layer)]
    yield from ["", f"sldvexp {choice} --cfg job shows all of what would run."]


def _settings_of_file(layer: ConfigLayer) -> Iterator[str]:
    """Yield what a file sets, a line for each setting of a plugin and each named table."""
    for key, value in layer.values.items():
        table = value.items() if isinstance(value, dict) else [("", value)]
        for name, inner in table:
            full = f"{key}.{name}".rstrip(".")
            told = _expected(inner) if key == "expect" else as_yaml(inner)
            yield from wrapped(f"{full}: {told}", 2, 6)


def _expected(table: dict[str, Any]) -> str:
    """Say how much an expectation compares, and with what."""
    compared = (len(table.get(kind, {})) for kind in ("published", "at_most", "at_least"))
    source = table.get("source")
    return f"{sum(compared)} compared{f' with {source}' if source else ''}"


def plugin_lines(group: str, node: DictConfig, file: Path | None) -> Iterator[str]:
    """Yield the page, line by line.

    Parameters
    ----------
    node : DictConfig
        What choosing it makes of the group.
    file : Path or None
        Its configuration file.
    """
    plugin: Any = OmegaConf.get_type(node)
    registered = registry.name_of(plugin)
    if registered is None:
        raise UserError(
            f"{displayed(file) if file else group}: has settings but no plugin; its defaults must "
            f"begin with schema/<plugin>@_here_; {nearest('', registry.names(group))}"
        )
    for paragraph in docs.description(plugin):
        yield from [*wrapped(paragraph), ""]
    package = origin(plugin) or f"sldvexp {version('sldvexp')}"
    yield f"plugin  {registered.partition('/')[2]}, {plugin.__module__} ({package})"
    if file:
        yield from wrapped(f"file    {displayed(file.resolve())}: {docs.of_file(file)}", 0, 8)
    yield from ["", "Settings:"]
    values: Any = OmegaConf.to_container(node, resolve=False, enum_to_str=True)
    for parameter in docs.parameters_of(plugin, values):
        yield from _setting(parameter)


def _setting(parameter: docs.Parameter) -> Iterator[str]:
    """Yield a setting as in a file, and below it what it means."""
    yield from wrapped(f"{parameter.key}: {parameter.value}", 2, 8)
    yield from wrapped(". ".join(filter(None, [parameter.kind, parameter.meaning])), 6)
