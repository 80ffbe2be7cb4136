"""Provenance: what a run's file carries so that it can be explained and repeated."""

from __future__ import annotations

import functools
import hashlib
import json
import platform
import subprocess
from collections.abc import Iterable
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, OmegaConf

from sldvexp.config import registry
from sldvexp.config.paths import locate
from sldvexp.config.schema import plugin_names
from sldvexp.errors import UserError
from sldvexp.files import require_file

#: Settings that change no number.
NO_NUMBERS = ("report", "sweep", "overwrite", "plan")
PACKAGES = ("sldvexp", "numpy", "scipy", "numba", "xarray", "netCDF4", "hydra-core", "omegaconf")


def attributes(config: DictConfig, inputs: Iterable[str], start: datetime) -> dict[str, Any]:
    """Gather the attributes of the dataset's root.

    Parameters
    ----------
    config : DictConfig
        The composed configuration.
    inputs : iterable of str
        Files read, as the configuration names them.
    start : datetime
        When the run began; the end is now.
    """
    resolved = OmegaConf.to_yaml(config, resolve=True)
    return {
        "title": "run of sldvexp",
        "config": resolved,
        "config_sha256": hashlib.sha256(resolved.encode()).hexdigest(),
        "plugins": json.dumps(plugin_names(config)),
        "inputs_sha256": json.dumps({path: sha256(locate(path)) for path in sorted(set(inputs))}),
        **about_program(),
        "seed": config.seed,
        "start_time": start.isoformat(),
        "end_time": datetime.now(UTC).isoformat(),
    }


def about_program() -> dict[str, str]:
    """Tell which program it was, as attributes."""
    return {"packages": json.dumps(versions()), "git_commit": git_commit()}


def identity(config: DictConfig) -> str:
    """Compute a digest of all that decides a run's numbers.

    But for the content of files it reads.
    """
    settings: Any = OmegaConf.to_container(config, resolve=True, enum_to_str=True)
    wanted = {key: value for key, value in settings.items() if key not in NO_NUMBERS}
    text = repr(wanted) + json.dumps(versions(), sort_keys=True)  # ten times as fast as YAML
    return hashlib.sha256(text.encode()).hexdigest()


@functools.cache
def versions() -> dict[str, str]:
    """List versions of Python and of the packages that decide the numbers, plugins' among them."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found | {package.name: package.version for package in registry.packages()}


def sha256(path: Path) -> str:
    """Compute the digest of an input file."""
    require_file(path)
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror})") from None


@functools.cache
def git_commit() -> str:
    """Name the commit of the checkout, marked if changed; empty if the program is installed."""
    here = Path(__file__).resolve().parents[1]
    if not (here.parent / ".git").exists():
        return ""
    describe = ["git", "-C", str(here), "describe", "--always", "--dirty", "--abbrev=40"]
    try:
        return subprocess.run(describe, capture_output=True, text=True, timeout=10).stdout.strip()
    except (OSError, subprocess.TimeoutExpired):
        return ""
