"""Lets names of views and the like be written with quotes or without, in files as on a line.

A recording that the command line puts in the place of a file's instrument needs none of that one's
settings, so that they are left out.

YAML reads ``1: {...}`` as a number and ``"1": {...}`` as a text. A table whose entries have texts
for names takes both alike; one of numbers, as that of fiducial marks, stays one of numbers.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from hydra._internal import defaults_list
from hydra._internal.config_loader_impl import ConfigLoaderImpl
from hydra._internal.config_repository import IConfigRepository
from hydra._internal.defaults_list import DefaultsList, Overrides
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.default_element import InputDefault, ResultDefault
from hydra.core.override_parser.types import Override
from hydra.errors import ConfigCompositionException
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf, flag_override
from omegaconf.errors import OmegaConfBaseException

from sldvexp.config.quick_copies import quick_copies
from sldvexp.config.repository import RememberingRepository

#: Choice of a recording in the place of an instrument.
REPLAYED = "instrument=replay"


class NamingLoader(ConfigLoaderImpl):
    """Hydra's loader, for which ``1`` and ``"1"`` name the same entry of a table."""

    repository: RememberingRepository
    _replays = False

    def __init__(self, config_search_path: ConfigSearchPath):
        super().__init__(config_search_path)
        self.repository = RememberingRepository(config_search_path)

    def _load_configuration_impl(
        self,
        config_name: str | None,
        overrides: list[str],
        run_mode: RunMode,
        from_shell: bool = True,
        validate_sweep_overrides: bool = True,
    ) -> DictConfig:
        """Compose as Hydra does, and note whether a recording is played."""
        self._replays = REPLAYED in overrides
        with quick_copies(), _choices_where_referred_to():
            return super()._load_configuration_impl(
                config_name, overrides, run_mode, from_shell, validate_sweep_overrides
            )

    def compute_defaults_list(
        self, config_name: str | None, overrides: list[str], run_mode: RunMode
    ) -> DefaultsList:
        """List the files of a composition as Hydra does."""
        with quick_copies(), _choices_where_referred_to():
            return super().compute_defaults_list(config_name, overrides, run_mode)

    def _compose_config_from_defaults_list(
        self, defaults: Sequence[ResultDefault], repo: IConfigRepository
    ) -> DictConfig:
        """Merge files as Hydra does, each with the names that the tables so far have."""
        config: DictConfig = OmegaConf.create()
        with flag_override(config, "no_deepcopy_set_nodes", True):
            for default in defaults:
                loaded: Any = self._load_single_config(default=default, repo=repo).config
                if self._replays:
                    _keep_own(loaded, config)
                try:
                    config.merge_with(_named_as(config, loaded))
                except OmegaConfBaseException as error:
                    raise ConfigCompositionException(
                        f"In '{default.config_path}': {type(error).__name__} raised while"
                        f" composing config:\n{error}"
                    ).with_traceback(sys.exc_info()[2]) from error
        _strip_defaults(config)
        return config

    @staticmethod
    def _apply_overrides_to_config(overrides: list[Override], cfg: DictConfig) -> None:
        """Apply settings of the command line as Hydra does, with the names that tables have."""
        for override in overrides:
            ConfigLoaderImpl._apply_overrides_to_config([_named(override, cfg)], cfg)


@contextmanager
def _choices_where_referred_to() -> Iterator[None]:
    """Let Hydra make a table of all choices only for a list of defaults that refers to them.

    It makes one for every file, which takes a third of a composition. Where a version of Hydra
    makes it by another function, it does so for every file.
    """
    usual = getattr(defaults_list, "_create_interpolation_map", None)
    if usual is None:
        yield
        return

    def made(
        overrides: Overrides, defaults_list: list[InputDefault], self_added: bool
    ) -> DictConfig:
        referred_to = any(default.is_interpolation() for default in defaults_list)
        return usual(overrides, defaults_list, self_added) if referred_to else DictConfig({})

    defaults_list._create_interpolation_map = made
    try:
        yield
    finally:
        defaults_list._create_interpolation_map = usual


def _named(override: Override, config: DictConfig) -> Override:
    """Name the entries of a table that a setting gives as those that are there."""
    value = override.value() if not override.is_sweep_override() else None
    if override.is_delete() or not isinstance(value, dict):
        return override
    table = OmegaConf.select(config, override.key_or_group, throw_on_missing=False)
    return replace(override, _value=_as_texts(table, value))


def _named_as(table: Any, added: Any) -> Any:
    """Change a loaded node so that its entries are named as those of the table it goes to."""
    if not _has_entries(table) or not _has_entries(added):
        return added
    if table._metadata.key_type is str:
        for key in [k for k in added if type(k) is int]:
            entry = added._get_node(key)
            del added[key]
            added._set_item_impl(str(key), entry)
    for key in added:
        if key in table._content:
            _named_as(table._get_node(key), added._get_node(key))
    return added


def _as_texts(table: Any, value: dict[Any, Any]) -> dict[Any, Any]:
    """Name the entries of a plain table, and of those in it, as those that are there."""
    if not _has_entries(table):
        return value
    texts = table._metadata.key_type is str
    named = {str(k) if texts and type(k) is int else k: v for k, v in value.items()}
    return {
        k: _as_texts(table._get_node(k), v) if isinstance(v, dict) and k in table._content else v
        for k, v in named.items()
    }


def _keep_own(loaded: DictConfig, config: DictConfig) -> None:
    """Leave out of a file what it sets of an instrument that is not the one composed so far."""
    given, composed = (node.get("instrument") for node in (loaded, config))
    if _has_entries(given) and _has_entries(composed):
        for key in [key for key in given if key not in composed._content]:
            del given._content[key]


def _has_entries(node: Any) -> bool:
    """Tell whether a node is a table with or without entries, and no missing or referred one."""
    return isinstance(node, DictConfig) and isinstance(node._content, dict)


def _strip_defaults(config: Any) -> None:
    """Remove what Hydra keeps of defaults lists in nodes of structured configurations."""
    if not _has_entries(config):
        return
    with flag_override(config, ["readonly", "struct"], False):
        if config._get_flag("HYDRA_REMOVE_TOP_LEVEL_DEFAULTS"):
            config._set_flag("HYDRA_REMOVE_TOP_LEVEL_DEFAULTS", None)
            config.pop("defaults", None)
    for _, value in config.items_ex(resolve=False):
        _strip_defaults(value)
