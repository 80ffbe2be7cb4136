"""The configuration: what its root looks like, and what is wrong with it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any

from hydra.core.config_store import ConfigStore
from omegaconf import MISSING, DictConfig, ListConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from sldvexp import registry
from sldvexp.errors import ConfigError, Problem, nearest

#: Groups whose value in the root is one plugin; `compare` and `check` hold named plugins.
SINGLE_GROUPS = ("target", "laser", "instrument", "pose", "reconstruction")


@dataclass
class Expectation:
    """One number that a run must reproduce, or a bound that it must keep.

    Parameters
    ----------
    of : str
        What is compared: ``group/variable``, ``group/variable[dim=label, ...]`` or
        ``group@attribute`` of the run's dataset.
    published : number, string of a complex number, or nested list of them, optional
        The printed value; compared element by element within `tolerance`.
    tolerance : float
        Largest accepted absolute difference.
    at_most, at_least : float, optional
        Bounds, instead of or besides a published value.
    correct : str, optional
        Where the dataset has the same quantity by the correct formula, when `of` follows the
        convention of the print.
    source : str
        Table, figure or section.
    """

    of: str = MISSING
    published: Any = None
    tolerance: float = 0.0
    at_most: float | None = None
    at_least: float | None = None
    correct: str | None = None
    source: str = ""


@dataclass
class Experiment:
    """Root of the configuration: the plugins of one run, in the order in which data flows.

    Parameters
    ----------
    seed : int
        Seed of the run's one random generator.
    target, laser, instrument, pose, reconstruction : plugin or None
        A stage without a plugin is left out.
    compare : dict of str to reconstruction plugin
        Further reconstructions of the same measurements, each in a group of its own.
    check : dict of str to check plugin
        What is examined after the estimates.
    expect : dict of str to Expectation
        What the run must reproduce.
    """

    seed: int = 0
    target: Any = None
    laser: Any = None
    instrument: Any = None
    pose: Any = None
    reconstruction: Any = None
    compare: dict[str, Any] = field(default_factory=dict)
    check: dict[str, Any] = field(default_factory=dict)
    expect: dict[str, Expectation] = field(default_factory=dict)


ConfigStore.instance().store(name="experiment_schema", node=Experiment, provider="sldvexp")


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
    problems = [*_unknown_keys(config, ""), *_missing(config)]
    if problems:
        raise ConfigError(problems)
    values: dict[str, Any] = {}
    for group in SINGLE_GROUPS:
        values[group] = _plugin(config[group], group, group, problems)
    for key, group in (("compare", "reconstruction"), ("check", "check")):
        values[key] = {
            str(name): _plugin(node, group, f"{key}.{name}", problems)
            for name, node in config[key].items()
        }
    expect: dict[str, Any] = OmegaConf.to_object(config.expect)  # type: ignore[assignment]
    for name, expectation in expect.items():
        bounds = (expectation.published, expectation.at_most, expectation.at_least)
        if all(b is None for b in bounds):
            message = "says nothing: give published, at_most or at_least"
            problems.append(Problem(f"expect.{name}", message))
    if config.seed < 0:
        problems.append(Problem("seed", f"must be zero or a positive integer, not {config.seed}"))
    if problems:
        raise ConfigError(problems)
    return Experiment(seed=config.seed, expect=expect, **values)


def plugin_names(config: DictConfig) -> dict[str, str]:
    """Which plugin stands at which key, ``{"pose": "pose/registration", ...}``."""
    nodes = [(group, config[group]) for group in SINGLE_GROUPS]
    nodes += [
        (f"{key}.{name}", n) for key in ("compare", "check") for name, n in config[key].items()
    ]
    found = {
        key: registry.name_of(OmegaConf.get_type(node)) for key, node in nodes if node is not None
    }
    return {key: name for key, name in found.items() if name}


def _plugin(node: Any, group: str, key: str, problems: list[Problem]) -> Any:
    """The plugin object of one node, or None with its problems noted."""
    if node is None:
        return None
    name = registry.name_of(OmegaConf.get_type(node)) if isinstance(node, DictConfig) else None
    if name is None or not name.startswith(f"{group}/"):
        valid = nearest("", registry.names(group))
        problems.append(Problem(key, f"is not a plugin of the group {group}. {valid}"))
        return None
    try:
        return OmegaConf.to_object(node)
    except ConfigError as error:
        problems += [Problem(f"{key}.{p.field}", p.message) for p in error.problems]
    except OmegaConfBaseException as error:
        problems.append(Problem(error.full_key or key, str(error.msg).splitlines()[0]))
    return None


def _unknown_keys(node: Any, path: str) -> Iterator[Problem]:
    """Keys that no schema knows, also those that a `+` on the command line forced in."""
    if isinstance(node, ListConfig):
        for i, item in enumerate(node._iter_ex(resolve=False)):
            yield from _unknown_keys(item, f"{path}[{i}]")
    if not isinstance(node, DictConfig) or node._is_none() or node._is_missing():
        return
    schema = OmegaConf.get_type(node)
    valid = {f.name for f in fields(schema)} if is_dataclass(schema) else None
    for key, value in node.items_ex(resolve=False):
        full = f"{path}.{key}" if path else str(key)
        if valid is not None and key not in valid:
            yield Problem(full, f"is not a known setting; {nearest(str(key), valid)}")
        elif str(key).startswith("_") and str(key).endswith("_"):
            message = "is refused: a configuration names plugins and cannot name code"
            yield Problem(full, message)
        else:
            yield from _unknown_keys(value, full)


def _missing(config: DictConfig) -> Iterator[Problem]:
    """Values still `???`."""
    for key in sorted(OmegaConf.missing_keys(config)):
        yield Problem(key, f"must be given, for example {key}=...")
