"""Composes configurations as Hydra does, but only once what they have in common.

Hydra composes every job of a sweep from all files, twice, and a single run twice as well. Which
files are composed depends only on what is chosen from groups; values that are set come on top.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from hydra._internal import hydra as program
from hydra._internal.config_loader_impl import ConfigLoaderImpl, get_overrides_dirname
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.types import RunMode
from omegaconf import DictConfig


class RememberingLoader(ConfigLoaderImpl):
    """Hydra's loader, which remembers what it composed for each set of choices."""

    def _load_configuration_impl(
        self,
        config_name: str | None,
        overrides: list[str],
        run_mode: RunMode,
        from_shell: bool = True,
        validate_sweep_overrides: bool = True,
    ) -> DictConfig:
        try:
            parsed = OverridesParser.create().parse_overrides(overrides)
            if validate_sweep_overrides:
                self.validate_sweep_overrides_legal(parsed, run_mode, from_shell)
            return self._on_top(parsed, config_name)
        except Exception:  # Hydra has the words for what is wrong, if anything is
            return super()._load_configuration_impl(
                config_name, overrides, run_mode, from_shell, validate_sweep_overrides
            )

    def _on_top(self, overrides: list[Override], config_name: str | None) -> DictConfig:
        """The values that are set, put onto what is composed of the choices."""
        setting = [o for o in overrides if self._sets(o)]
        choosing = [str(o.input_line) for o in overrides if o not in setting]
        config = self._composed(config_name, tuple(choosing))
        self._apply_overrides_to_config([o for o in setting if not o.is_sweep_override()], config)
        task = [o for o in overrides if not o.is_hydra_override()]
        config.hydra.overrides.task = [o.input_line for o in task]
        config.hydra.overrides.hydra = [o.input_line for o in overrides if o.is_hydra_override()]
        shown = config.hydra.job.config.override_dirname
        config.hydra.job.override_dirname = get_overrides_dirname(
            task, shown.exclude_keys, shown.item_sep, shown.kv_sep
        )
        return config

    def _sets(self, override: Override) -> bool:
        """Whether an override sets a value, and has no say in which files are composed."""
        if override.is_sweep_override() or override.get_key_element() == "hydra.mode":
            return True
        if override.is_hydra_override():
            return False
        is_group = self.repository.group_exists(override.key_or_group)
        return not is_group or isinstance(override.value(), dict)

    def _composed(self, config_name: str | None, choosing: tuple[str, ...]) -> DictConfig:
        """What Hydra composes of choices, to be changed at will."""
        known = self.__dict__.setdefault("_known", {})
        key = config_name, choosing
        if key not in known:
            composed = super()._load_configuration_impl(config_name, [*choosing], RunMode.RUN)
            known[key] = pickle.dumps(composed)
        config: DictConfig = pickle.loads(known[key])  # three times as fast as a deep copy
        return config

    def __getstate__(self) -> dict[str, Any]:
        """What goes to other processes with every job: nothing that is remembered."""
        return {name: value for name, value in vars(self).items() if name != "_known"}


@contextmanager
def remembering() -> Iterator[None]:
    """While in it, Hydra uses `RememberingLoader`; it has no setting for its loader."""
    usual = program.ConfigLoaderImpl
    program.ConfigLoaderImpl = RememberingLoader  # type: ignore[misc]
    try:
        yield
    finally:
        program.ConfigLoaderImpl = usual  # type: ignore[misc]
