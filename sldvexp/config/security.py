"""Guard: a configuration file that is not the program's must not make Hydra run code.

Hydra calls what its own settings name (callbacks, launchers, loggers), before a job begins.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from itertools import accumulate, islice, product
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import ChoiceSweep, Override, RangeSweep
from hydra.errors import HydraException
from omegaconf.errors import OmegaConfBaseException
from omegaconf.grammar_parser import OmegaConfGrammarParser, parse

from sldvexp.config.refusals import NO_CODE, names_code
from sldvexp.config.sources import COMMAND_LINE, ConfigLayer, Origins, parts_of
from sldvexp.errors import UserError
from sldvexp.limits import SHOWN, YAML_DEPTH, YAML_REFERENCES, shown

#: Hydra's settings that hold no code.
HARMLESS = ("run", "sweep", "mode", "verbose", "job.name")
#: Settings that say where a run writes, and the references that they may have.
PLACES = ("hydra.run.dir", "hydra.sweep.dir", "hydra.sweep.subdir", "hydra.job.name")
REFERENCE = re.compile(r"\$\{(?:now:%(?:[%\w/: -]|\.(?!\.))*|hydra[.:][\w.]+)\}")
#: Resolvers that look at nothing but the clock and the configuration.
RESOLVERS = ("now", "hydra")
#: Characters of an argument, jobs of a sweep, and how the values of one look.
LONGEST_ARGUMENT, LONGEST_KEY, MOST_JOBS = 50_000, 1000, 20_000
SWEPT = re.compile(r"=.*,|=\s*(choice|range|interval|shuffle|sort|tag|glob)")
#: Characters of a text with references.
LONGEST_REFERENCE = 2000


def require_bounded_line(source: str, arguments: Iterable[str]) -> None:
    """Refuse arguments that are too long, too deep, or that make too many jobs.

    Parameters
    ----------
    source : str
        Where they stand, for messages.

    Raises
    ------
    UserError
    """
    jobs = 1
    for text in arguments:
        told = f"{source}: {shown(repr(text), SHOWN)}"
        if len(text) > LONGEST_ARGUMENT:
            raise UserError(f"{told} has {len(text)} characters, more than {LONGEST_ARGUMENT}")
        key = text.partition("=")[0]
        if len(key) > LONGEST_KEY or key.count(".") > YAML_DEPTH:
            raise UserError(f"{told} has a key of {len(key)} characters, and none is so long")
        depth = max(accumulate((c in "([{") - (c in ")]}") for c in text), default=0)
        if depth > YAML_DEPTH or text.count("${") > YAML_REFERENCES:
            raise UserError(f"{told} has more than {YAML_DEPTH} brackets in each other")
        swept = SWEPT.search(text) and OverridesParser.create()
        try:
            jobs *= max(1, _count(swept.parse_override(text))) if swept else 1
        except (HydraException, ValueError, RecursionError, AssertionError):
            continue  # which is told in other words
    if jobs > MOST_JOBS:
        raise UserError(f"{source}: makes {jobs:.3g} jobs or more; a sweep has at most {MOST_JOBS}")


def _count(setting: Override) -> int:
    """Count the values of a sweep, up to one more than a sweep has."""
    value: Any = setting._value
    if isinstance(value, RangeSweep):
        return sum(1 for _ in islice(value.range(), MOST_JOBS + 1))
    return len(value.list) if isinstance(value, ChoiceSweep) else 1


def check(origins: Origins) -> None:
    """Refuse files from outside that name code, in any job of a sweep.

    Raises
    ------
    UserError
        At the first such file, or folder that is not there.
    """
    for folder in origins.folders_added:
        if not Path(folder).is_dir():
            raise UserError(f"{COMMAND_LINE}: there is no folder {folder}")
    for job in _jobs(origins):
        for layer in job.layers_of_files():
            if layer.outside:
                check_layer(layer)


def _jobs(origins: Origins) -> Iterator[Origins]:
    """Yield one configuration for every combination of choices that a sweep makes."""
    swept = [o for o in origins.choices if o.is_sweep_override()]
    lines = [line for line in origins.settings if line not in [s.input_line for s in swept]]
    values = [[f"{s.get_key_element()}={v}" for v in s.sweep_string_iterator()] for s in swept]
    for combination in product(*values):
        yield Origins(origins.arguments, [*lines, *combination])


def check_layer(layer: ConfigLayer) -> None:
    """Refuse a file that names code, or that sets more of Hydra than is harmless."""
    content = _whole(layer.package, layer.values)
    if not isinstance(content, dict):
        return
    for full, key, value in _settings(content):
        if names_code(key):
            raise UserError(f"{layer.source}: {full} {NO_CODE}")
        for text in (key, value):
            if isinstance(text, str) and (told := looks_up(text)):
                raise UserError(f"{layer.source}: {full} {told}")
    _check_places(layer.source, content)
    of_hydra = content.get("hydra", {})
    for key in _keys(of_hydra) if isinstance(of_hydra, dict) else [""]:
        below = any(key == h or key.startswith(f"{h}.") for h in HARMLESS)
        above = any(h.startswith(f"{key}.") for h in HARMLESS)
        if not (below or above):
            raise UserError(
                f"{layer.source}: {f'hydra.{key}'.rstrip('.')} is refused: a file that does not "
                f"belong to the program may set only these of hydra: {', '.join(HARMLESS)}"
            )


def _check_places(source: str, content: dict[str, Any]) -> None:
    """Refuse a file that sends what a run writes out of the folder where it is started."""
    found = {full: value for full, _, value in _settings(content)}
    for key in PLACES:
        place = found.get(key)
        if not isinstance(place, str):
            continue
        plain = REFERENCE.sub("x", place)
        outside = plain.startswith(("/", "~", "\\")) or ".." in Path(plain).parts or "${" in plain
        if outside or (key == "hydra.job.name" and plain != Path(plain).name):
            raise UserError(
                f"{source}: {key} is refused: a file that does not belong to the program may send "
                "runs only to folders below the one where they are started; the command line may "
                "name any"
            )


def looks_up(text: str) -> str:
    """Say that a text has a resolver that looks beyond the configuration; empty if it has none.

    Examples
    --------
    >>> looks_up("${pose.path}"), looks_up("outputs/${now:%Y}")
    ('', '')
    >>> looks_up("${oc.env:HOME}")
    'is refused: a file refers to settings, as in ${seed}, and cannot look up ${oc.env:...}'
    """
    if "${" not in text:
        return ""
    told = "is refused: a file refers to settings, as in ${seed}, and cannot look up"
    if len(text) > LONGEST_REFERENCE:
        return f"{told} a text of {len(text)} characters"
    try:
        nodes = [parse(text)]
    except (OmegaConfBaseException, RecursionError):
        nodes = []  # which is no reference, as OmegaConf will say
    while nodes:
        node = nodes.pop()
        if isinstance(node, OmegaConfGrammarParser.InterpolationResolverContext):
            name = node.resolverName().getText()
            if name not in RESOLVERS:
                return f"{told} ${{{name}:...}}"
        nodes += getattr(node, "children", None) or []
    return ""


def check_recorded(source: str, lines: Iterable[Any]) -> None:
    """Refuse recorded arguments of a command line that are more than settings of a run.

    Parameters
    ----------
    source : str
        The file that has them, for messages.
    lines : iterable
        Anyone may have written them. Hydra records only settings of the run here, never options
        and none of its own settings.

    Raises
    ------
    UserError
        At the first that is an option, no setting, a setting of Hydra's, names code, or has a
        value that is yet to be looked up.
    """
    for line in lines:
        told = f"{source}: {shown(repr(line), SHOWN)}"
        if not isinstance(line, str) or line.startswith("-"):
            raise UserError(f"{told} is no setting of a run, as key=value is")
        require_bounded_line(source, [line])
        try:
            setting = OverridesParser.create().parse_override(line)
        except (HydraException, ValueError, RecursionError):
            raise UserError(f"{told} is no setting of a run, as key=value is") from None
        if "${" in line:
            raise UserError(
                f"{told} refers to something that is looked up when the run begins; leave it out "
                "there and give it behind resume="
            )
        if setting.is_sweep_override():
            raise UserError(f"{told} is for a sweep, and a run has one value of each setting")
        content = _whole(setting.key_or_group, None if setting.is_delete() else setting.value())
        package = parts_of(setting.package or "")
        if "hydra" in (next(iter(content)).split("/")[0], *package[:1]):
            raise UserError(f"{told} is refused: a run's folder cannot set anything of Hydra's")
        for key in (*package, *_keys(content)):
            if names_code(key.rsplit(".", 1)[-1]):
                raise UserError(f"{told} {NO_CODE}")


def _whole(package: str, values: Any) -> Any:
    """Make the configuration in which nothing but `values` stand at a dotted place."""
    for part in reversed(parts_of(package)):
        values = {part: values}
    return values


def _keys(node: Any, path: str = "") -> Iterator[str]:
    """Yield dotted keys of all settings, those of tables before what is in them."""
    return (full for full, _, _ in _settings(node, path))


def _settings(node: Any, path: str = "") -> Iterator[tuple[str, str, Any]]:
    """Yield dotted keys of all settings, their own keys, and their values."""
    for key, value in node.items() if isinstance(node, dict) else enumerate(node):
        full = f"{path}.{key}" if path else str(key)
        yield full, str(key), value
        if isinstance(value, dict | list):
            yield from _settings(value, full)
