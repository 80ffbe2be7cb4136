"""Composes configurations as Hydra does, but only once what they have in common.

Hydra composes every job of a sweep from all files, twice, and a single run twice as well. Which
files are composed depends only on what is chosen from groups; values that are set come on top. What
was composed is kept in the user's cache, too, by the content of all that decides it.
"""

from __future__ import annotations

import hashlib
import os
import pickle
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import islice
from pathlib import Path
from typing import Any

import hydra
import omegaconf
from hydra._internal import hydra as program
from hydra._internal.config_loader_impl import get_overrides_dirname
from hydra.core.config_search_path import ConfigSearchPath
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override
from hydra.core.utils import JobReturn
from hydra.plugins.config_source import ConfigSource
from hydra.types import RunMode
from omegaconf import DictConfig

from sldvexp.config.kept import KeptFiles, name_of
from sldvexp.config.naming_loader import NamingLoader
from sldvexp.config.paths import conf_dir
from sldvexp.config.quick_copies import quick_copies
from sldvexp.config.registry import looked_for_packages
from sldvexp.config.repository import Memory, copies_of
from sldvexp.config.schema_table import SchemaTable
from sldvexp.limits import YAML_BYTES

#: Entries of a folder of configurations that are looked at: of one with more nothing is kept.
MOST_ENTRIES = 2000
#: What is looked up when a file is read, and not by the content of files.
LOOKED_UP = re.compile(rb"\$\{\s*(?!now:|hydra:)[\w.]+\s*:")


class LastingMemory(KeptFiles):
    """Compositions in the user's cache: a pickle is trusted as a program is."""

    def recall(self, name: str) -> Callable[[], Any] | None:
        """Read what was kept under a name, as `copies_of` gives it; None if nothing whole was."""
        content = self.read(name)
        if content is not None:
            with suppress(Exception):  # of classes that are there no more
                first = [pickle.loads(content)]
                return lambda: first.pop() if first else pickle.loads(content)
        return None

    def keep(self, name: str, composed: DictConfig) -> None:
        """Keep a composition, if it can be kept."""
        with suppress(Exception):  # of a class that Hydra's search for plugins has made anew
            self.write(name, pickle.dumps(composed))


def name_of_composition(
    key: tuple[str | None, tuple[str, ...]], sources: Sequence[ConfigSource]
) -> str:
    """Name a composition by the content of all that decides it; empty if more than files do.

    That are the choices, all files in the folders of configurations, the program's code and that
    of what composes. Plugins of other packages decide too, and what they do is not kept.
    """
    if any("${" in choice for choice in key[1]):
        return ""
    told = hashlib.sha256(name_of(key, hydra.__version__, omegaconf.__version__).encode())
    for source in sources:
        told.update(f"{source.provider} {source.full_path()}\n".encode())
        if source.scheme() != "file" or Path(source.path) == conf_dir():
            continue
        entries = [*islice(Path(source.path).rglob("*"), MOST_ENTRIES + 1)]
        if len(entries) > MOST_ENTRIES:
            return ""
        for file in sorted(f for f in entries if f.suffix in (".yaml", ".yml") and f.is_file()):
            with file.open("rb") as opened:
                content = opened.read(YAML_BYTES + 1)
            if len(content) > YAML_BYTES or LOOKED_UP.search(content):
                return ""
            told.update(f"{file} {len(content)}\n".encode() + content)
    return told.hexdigest()


class WrongSettingError(Exception):
    """A value that cannot be set, with what Hydra says of it."""

    def __init__(self, error: Exception) -> None:
        super().__init__(error)
        self.error = error


class RememberingLoader(NamingLoader):
    """Hydra's loader, which remembers what it composed for each set of choices."""

    def __init__(self, config_search_path: ConfigSearchPath):
        super().__init__(config_search_path)
        self._known = Memory()
        self._lasting = LastingMemory()

    def _load_configuration_impl(
        self,
        config_name: str | None,
        overrides: list[str],
        run_mode: RunMode,
        from_shell: bool = True,
        validate_sweep_overrides: bool = True,
    ) -> DictConfig:
        refused = None
        try:
            parsed = OverridesParser.create().parse_overrides(overrides)
            if validate_sweep_overrides:
                self.validate_sweep_overrides_legal(parsed, run_mode, from_shell)
            return self._on_top(parsed, config_name)
        except WrongSettingError as told:
            refused = told.error
        except Exception:  # Hydra has the words for what else is wrong
            pass
        if refused is not None:
            raise refused
        return super()._load_configuration_impl(
            config_name, overrides, run_mode, from_shell, validate_sweep_overrides
        )

    def _on_top(self, overrides: list[Override], config_name: str | None) -> DictConfig:
        """Put the values that are set onto what is composed of the choices."""
        setting = [o for o in overrides if self._sets(o)]
        choosing = [str(o.input_line) for o in overrides if o not in setting]
        config = self._composed(config_name, tuple(choosing))
        for override in (o for o in setting if not o.is_sweep_override()):
            try:
                self._apply_overrides_to_config([override], config)
            except Exception as error:  # of Hydra's own function, in its words
                raise WrongSettingError(error) from None
        task = [o for o in overrides if not o.is_hydra_override()]
        config.hydra.overrides.task = [o.input_line for o in task]
        config.hydra.overrides.hydra = [o.input_line for o in overrides if o.is_hydra_override()]
        config.hydra.runtime.cwd = os.getcwd()
        shown = config.hydra.job.config.override_dirname
        config.hydra.job.override_dirname = get_overrides_dirname(
            task, shown.exclude_keys, shown.item_sep, shown.kv_sep
        )
        return config

    def _sets(self, override: Override) -> bool:
        """Tell whether an override sets a value, and has no say in which files are composed."""
        if override.is_sweep_override() or override.get_key_element() == "hydra.mode":
            return True
        if override.is_hydra_override():  # a folder, which is another in every run
            key = override.key_or_group
            return key.startswith("hydra.") and not key.startswith("hydra.searchpath")
        is_group = self.repository.group_exists(override.key_or_group)
        return not is_group or isinstance(override.value(), dict)

    def _composed(self, config_name: str | None, choosing: tuple[str, ...]) -> DictConfig:
        """Compose the choices as Hydra does, to be changed at will."""
        if self.repository.table is not None:
            return super()._load_configuration_impl(config_name, [*choosing], RunMode.RUN)
        key = config_name, choosing
        if key not in self._known:
            lasting, name = self._lasting, name_of_composition(key, self.repository.sources)
            kept = lasting.recall(name) if name else None
            if kept is None:
                composed = super()._load_configuration_impl(config_name, [*choosing], RunMode.RUN)
                kept = copies_of(composed)
                if name and not looked_for_packages():
                    lasting.keep(name, composed)
            self._known[key] = kept
        config: DictConfig = self._known[key]()
        return config


class ShowingLoader(RememberingLoader):
    """Loader of a configuration that is shown: it loads no plugin.

    What cannot be composed in this way is composed as for a run, of which come all sentences.
    """

    def _on_top(self, overrides: list[Override], config_name: str | None) -> DictConfig:
        with suppress(Exception):
            return self._of_table(overrides, config_name)
        return super()._on_top(overrides, config_name)

    def _of_table(self, overrides: list[Override], config_name: str | None) -> DictConfig:
        """Compose the program's own files and schemas as they were read before."""
        table = SchemaTable()
        self.repository.table = table
        try:
            with table.of_classes():
                composed = super()._on_top(overrides, config_name)
        finally:
            self.repository.table = None
        table.keep()
        return composed


@contextmanager
def remembering(before_run: Callable[[DictConfig], None], shown: bool = False) -> Iterator[None]:
    """Let Hydra use `RememberingLoader` while in it; it has no setting for its loader.

    Parameters
    ----------
    before_run : callable
        Gets the composed configuration of a single run, Hydra's own included, before Hydra makes
        or changes anything in the run's folder. What it raises ends the command.
    shown : bool
        Whether the configuration is only shown.
    """
    usual, run_job = program.ConfigLoaderImpl, program.run_job

    def checked(**arguments: Any) -> JobReturn:
        before_run(arguments["config"])
        return run_job(**arguments)

    program.ConfigLoaderImpl = ShowingLoader if shown else RememberingLoader  # type: ignore[misc]
    program.run_job = checked  # type: ignore[assignment]
    try:
        with quick_copies():
            yield
    finally:
        program.ConfigLoaderImpl = usual  # type: ignore[misc]
        program.run_job = run_job
