"""Check of a composed configuration as a whole, and its plugins made.

What a run must reproduce: an entry of a configuration's `expect`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

from omegaconf import MISSING, DictConfig, ListConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from sldvexp.config import registry
from sldvexp.config.experiment import ENTRIES_OF, NAMED_GROUPS, SINGLE_GROUPS, Experiment
from sldvexp.config.quick_copies import quick_copies
from sldvexp.config.refusals import NO_CODE, names_code, refusal
from sldvexp.errors import Checks, ConfigError, Problem, UserError, nearest
from sldvexp.files import unusable


def build(config: DictConfig) -> Experiment:
    """Check a composed configuration as a whole and make its plugins.

    Parameters
    ----------
    config : DictConfig
        As Hydra composed it, with the root schema `Experiment`.

    Returns
    -------
    Experiment
        With ready plugins instead of configuration nodes.

    Raises
    ------
    ConfigError
        Every unknown key, missing value and refused value, each with its full key.
    """
    if OmegaConf.get_type(config) is not Experiment:
        raise UserError("a configuration's defaults must begin with experiment_schema")
    lost = {f.name for f in fields(Experiment)} - {
        str(k) for k, _ in config.items_ex(resolve=False)
    }
    if lost:
        raise ConfigError(Problem(key, "cannot be deleted") for key in sorted(lost))
    with quick_copies():
        config = _with_schemas(config)
    problems = [*_refused_keys(config, ""), *_refused_names(config)]
    if problems:
        raise ConfigError(problems)
    values: dict[str, Any] = {}
    for group in SINGLE_GROUPS:
        values[group] = _plugin(config[group], group, group, problems)
    for key, group in NAMED_GROUPS.items():
        values[key] = {
            str(name): _plugin(node, group, f"{key}.{name}", problems)
            for name, node in config[key].items()
        }
    expect = {
        str(name): _object(node, f"expect.{name}", problems) for name, node in config.expect.items()
    }
    problems += _expected_of_nothing(expect, values)
    problems += _checks_of_nothing(values["check"], values["compare"])
    if config.seed < 0:
        problems.append(Problem("seed", f"must be zero or a positive integer, not {config.seed}"))
    if problems:
        raise ConfigError(problems)
    others = {key: _object(config[key], key, problems) for key in ("sweep", "plan")}
    if problems:
        raise ConfigError(problems)
    made = {*values, "expect", *others}
    with quick_copies():
        plain = OmegaConf.masked_copy(
            config, [f.name for f in fields(Experiment) if f.name not in made]
        )
    settings: Any = OmegaConf.to_container(plain, resolve=True)
    return Experiment(**settings, expect=expect, **others, **values)


def _expected_of_nothing(
    expect: dict[str, Expectation | None], values: dict[str, Any]
) -> Iterator[Problem]:
    """Find expectations of what no entry makes, told before the work begins."""
    for name, expectation in expect.items():
        for of in expectation.compared if expectation else ():
            parent, _, rest = of.strip(" |").partition("/")
            key, entry = ENTRIES_OF.get(parent, ""), re.split(r"[/@]", rest)[0]
            if key and entry not in values[key]:
                message = (
                    f"names {of}, but {key} has no entry {entry}; {nearest(entry, values[key])}; "
                    f"~expect.{name} leaves it out"
                )
                yield Problem(f"expect.{name}", message)


def _checks_of_nothing(checks: dict[str, Any], compare: dict[str, Any]) -> Iterator[Problem]:
    """Find checks of a field that no entry of `compare` makes."""
    for name, check in checks.items():
        of = getattr(check, "of", "field")  # not all are of one field
        if of != "field" and of not in compare:
            message = (
                f"is {of}, but compare has no entry {of}; {nearest(of, ['field', *compare])}; "
                f"~check.{name} leaves it out"
            )
            yield Problem(f"check.{name}.of", message)


def plugin_names(config: DictConfig) -> dict[str, str]:
    """Name the plugin of each group, ``{"pose": "registration"}``; a file alone may not say it."""
    kinds = {g: OmegaConf.get_type(config[g]) for g in SINGLE_GROUPS if config[g] is not None}
    names = {g: registry.name_of(kind) for g, kind in kinds.items()}
    return {g: name.partition("/")[2] for g, name in names.items() if name}


def _with_schemas(config: DictConfig) -> DictConfig:
    """Merge named plugins and expectations onto their schemas."""
    typed = config.copy()
    problems: list[Problem] = []
    for key in (*NAMED_GROUPS, "expect"):
        for name, node in config[key].items_ex(resolve=False):
            full = f"{key}.{name}"
            try:
                typed[key][name] = _onto_schema(node, NAMED_GROUPS.get(key))
            except ConfigError as error:
                problems += [
                    Problem(f"{full}.{p.field}".rstrip("."), p.message) for p in error.problems
                ]
            except OmegaConfBaseException as error:
                problems.append(_from_omegaconf(error, full))
    if problems:
        raise ConfigError(problems)
    return typed


def _onto_schema(node: Any, group: str | None) -> Any:
    """Type one entry of `compare` or `check` as its `plugin` says, or one of `expect`."""
    if group is None:
        if not isinstance(node, DictConfig):
            raise ConfigError([Problem("", "must be a table, as in {at_most: {group/name: 1.0}}")])
        return registry.onto_schema(Expectation, node)
    settings = dict(node.items_ex(resolve=False)) if isinstance(node, DictConfig) else {}
    if not isinstance(name := settings.pop("plugin", None), str):
        message = f"must say which plugin it is, as in {{plugin: {registry.names(group)[0]}}}"
        raise ConfigError([Problem("", f"{message}; {nearest('', registry.names(group))}")])
    try:
        plugin = registry.get(group, name)
    except UserError as error:
        raise ConfigError([Problem("plugin", str(error))]) from None
    own = OmegaConf.masked_copy(node, [str(key) for key in settings])
    return registry.onto_schema(plugin, own)


def _from_omegaconf(error: OmegaConfBaseException, key: str) -> Problem:
    """Turn OmegaConf's complaint into a problem of a key at or below `key`."""
    found = error.full_key or key
    return Problem(found if found.startswith(key) else f"{key}.{found}", refusal(error))


def _plugin(node: Any, group: str, key: str, problems: list[Problem]) -> Any:
    """Make the plugin object of one node, or None with its problems noted."""
    if node is None:
        return None
    name = registry.name_of(OmegaConf.get_type(node)) if isinstance(node, DictConfig) else None
    if name is None or not name.startswith(f"{group}/"):
        valid = nearest("", registry.names(group))
        message = (
            f"has settings but no plugin; choose one with {group}=name, with 'override /{group}: "
            f"name' in an experiment's defaults, or with schema/name@_here_ in those of a file of "
            f"{group}/; {valid}"
        )
        problems.append(Problem(key, message))
        return None
    return _object(node, key, problems)


def _object(node: Any, key: str, problems: list[Problem]) -> Any:
    """Make the object that a typed node stands for, or None with its problems noted."""
    try:
        return OmegaConf.to_object(node)
    except ConfigError as error:
        known = len(problems)
        for name, child in node.items_ex(resolve=False):
            if isinstance(child, DictConfig) and registry.name_of(OmegaConf.get_type(child)):
                _object(child, f"{key}.{name}", problems)
        if len(problems) == known:
            problems += [Problem(f"{key}.{p.field}".rstrip("."), p.message) for p in error.problems]
    except OmegaConfBaseException as error:
        problems.append(_from_omegaconf(error, key))
    return None


def _refused_keys(node: Any, path: str) -> Iterator[Problem]:
    """Find keys that no schema knows, also those that a `+` forced in, and values still `???`."""
    if isinstance(node, ListConfig):
        for i, item in enumerate(node._iter_ex(resolve=False)):
            yield from _refused_keys(item, f"{path}[{i}]")
    if not isinstance(node, DictConfig) or node._is_none() or node._is_missing():
        return
    schema = OmegaConf.get_type(node)
    valid = {f.name for f in fields(schema)} if is_dataclass(schema) else None
    for key, value in node.items_ex(resolve=False):
        name = str(key)
        full = f"{path}.{name}" if path else name
        if names_code(name):
            yield Problem(full, NO_CODE)
        elif valid is not None and name not in valid:
            yield Problem(full, f"is not a known setting; {nearest(name, valid)}")
        elif isinstance(value, str) and value == MISSING:
            yield Problem(full, "must be given")
        else:
            yield from _refused_keys(value, full)


def _refused_names(config: DictConfig) -> Iterator[Problem]:
    """Find entries whose names are of groups of the dataset, and that no group can have."""
    for key in NAMED_GROUPS:
        for name in config[key] if key != "export" else ():  # whose names are of files
            if wrong := unusable(str(name)):
                yield Problem(f"{key}.{name}", f"its name {wrong}")


@dataclass
class Expectation:
    """Numbers that a run must reproduce, or bounds that it must keep, from one source.

    Every mapping goes from what is compared, ``group/variable``, ``group/variable[dim=label, ...]``
    or ``group@attribute`` of the run's dataset, to the value.

    Parameters
    ----------
    source : str
        Table, figure or section.
    tolerance : float
        Largest accepted absolute difference, of real and imaginary part each.
    published : dict of str to number, text of a complex number, or nested lists of them
        Compared element by element.
    at_most, at_least : dict of str to float
        Bounds.
    correct : dict of str to str
        Where the dataset has the same quantity by the correct formula, when what is compared
        follows the convention of the print.
    verdict : str
        ``trusted``, ``doubtful`` or ``void``.
    finds : list of str
        Findings that the verdict must have, by kind and subject: ``sign of view 4``.
    unrepaired : bool
        Of a mistake in the data: not compared where ``use_repair`` repairs one.
    """

    source: str = ""
    tolerance: float = 0.0
    published: dict[str, Any] = field(default_factory=dict)
    at_most: dict[str, float] = field(default_factory=dict)
    at_least: dict[str, float] = field(default_factory=dict)
    correct: dict[str, str] = field(default_factory=dict)
    verdict: str = ""
    finds: list[str] = field(default_factory=list)
    unrepaired: bool = False

    def __post_init__(self) -> None:
        checks = Checks()
        checks.non_negative("tolerance", self.tolerance)
        compared = self.compared
        says = bool(compared or self.verdict or self.finds)
        message = "says nothing: give published, at_most, at_least, verdict or finds"
        checks.require(says, "", message)
        message = f"must be trusted, doubtful or void, not {self.verdict}"
        known = ("", "trusted", "doubtful", "void")
        checks.require(self.verdict in known, "verdict", message)
        for i, text in enumerate(self.finds):
            message = f"must be a kind and a subject as in 'sign of view 4', not {text!r}"
            checks.require(" of " in text, f"finds[{i}]", message)
        for name in ("at_most", "at_least"):
            for of, bound in getattr(self, name).items():
                number = isinstance(bound, int | float) and bound == bound
                checks.require(number, f"{name}.{of}", f"must be a number, not {bound}")
        for of in self.correct:
            message = f"is compared with nothing; {nearest(of, compared)}"
            checks.require(of in compared, f"correct.{of}", message)
        checks.done()

    @property
    def compared(self) -> list[str]:
        """Groups and variables that it says something of."""
        return [*self.published, *self.at_most, *self.at_least]
