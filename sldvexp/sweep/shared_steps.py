"""Results of steps that runs of a sweep have in common: each is computed once and then read.

An entry is a netCDF file of the groups that a step added, and beside it a small file that tells its
digest and what netCDF does not keep. Its name is a digest of all that decides its content.
"""

from __future__ import annotations

import hashlib
import json
import logging
from collections.abc import Iterable
from contextlib import closing
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import DictConfig, OmegaConf

from sldvexp import dataset
from sldvexp.config import schema
from sldvexp.config.paths import locate
from sldvexp.errors import UserError
from sldvexp.files import read_json
from sldvexp.lazy import xarray as xr
from sldvexp.pipeline import provenance
from sldvexp.pipeline.step import Run, Step, setting
from sldvexp.sweep.lock import locked
from sldvexp.sweep.record import Stopwatch
from sldvexp.writing import whole_or_nothing

log = logging.getLogger(__name__)

#: Folder of the entries, in that of the sweep.
SHARED = ".shared"
DIGITS = 24

#: Entries of more bytes are read again by every run.
CACHE_BYTES = 2**25

#: Types of attributes that JSON keeps.
PLAIN = (str, bool, int, float)


class Store:
    """Does the steps of one run, or takes over what another run of the sweep did.

    Parameters
    ----------
    cfg : DictConfig
        The run's configuration.
    folder : Path
        Of the entries.

    Attributes
    ----------
    seconds : dict of str to float, s
        How long each step took that is done.
    reused : list of str
        Those that were taken over.
    """

    def __init__(self, cfg: DictConfig, folder: Path):
        self.cfg, self.folder = cfg, folder
        self.seconds: dict[str, float] = {}
        self.reused: list[str] = []
        self._states: dict[str, str] = {}
        self._done: list[Step] = []

    def __call__(self, step: Step, run: Run) -> None:
        """Do a step, or what is the same; two processes never do the same one at once."""
        watch, key, known = Stopwatch(), self._key(step), len(run.inputs)
        if step.shared:
            path = self.folder / f"{step.name.replace(' ', '_')}-{key[:DIGITS]}.nc"
            with locked(path.with_suffix(".lock")):
                if not _take(path, step, run):
                    _work(path, step, run)
        else:
            step.perform(run)
        self.seconds[step.name], self.reused = watch.seconds(), run.reused
        self._done.append(step)
        self._states[step.name] = _digest([key, _digests(run.inputs[known:])])

    @cached_property
    def _plugins(self) -> dict[str, str]:
        return schema.plugin_names(self.cfg)

    @cached_property
    def _settings(self) -> Any:
        return OmegaConf.to_container(self.cfg, resolve=True, enum_to_str=True)

    def _key(self, step: Step) -> str:
        """Compute a digest of all that decides what a step adds.

        But for the content of files it reads.
        """
        return _digest(
            [
                step.name,
                {key: repr(setting(self._settings, key)) for key in step.reads},
                {key: self._plugins.get(key) for key in step.reads},
                {name: self._states.get(name) for name in step.after(self._done)},
                provenance.versions(),
            ]
        )


def _work(path: Path, step: Step, run: Run) -> None:
    """Do the step and keep what it added."""
    before, known = dict(run.tree), len(run.inputs)
    step.perform(run)
    added = {name: g for name, g in run.tree.items() if before.get(name) is not g}
    inputs = sorted(set(run.inputs[known:]))
    dataset.save(added, {"title": f"shared step of sldvexp: {step.name}"}, path)
    about = {
        "sha256": provenance.sha256(path),
        "inputs": _digests(inputs),
        "groups": {name: _about(group) for name, group in added.items()},
    }
    with whole_or_nothing(path.with_suffix(".json")) as beside:
        beside.write_text(json.dumps(about))


def _take(path: Path, step: Step, run: Run) -> bool:
    """Add what another run kept of the step; False if there is nothing, or nothing sound."""
    if not path.with_suffix(".json").exists():
        return False
    try:
        about = read_json(path.with_suffix(".json"))
        if about["sha256"] != provenance.sha256(path):
            raise ValueError("its content is not what was written")
        if about["inputs"] != _digests(about["inputs"]):
            return False  # a file that the step reads has changed, or is gone
        groups = _read(path, about["sha256"], json.dumps(about["groups"]))
    except (OSError, ValueError, KeyError, TypeError, AttributeError, UserError) as error:
        log.warning("%s: is damaged and is computed again: %s", path, error)
        return False
    run.tree |= {name: group.copy() for name, group in groups.items()}
    run.inputs += about["inputs"]
    run.reused.append(step.name)
    log.info("%s: taken from %s", step.name, path)
    return True


def _read(path: Path, digest: str, about: str) -> dict[str, xr.Dataset]:
    """Read the groups of an entry; those that this process read last are still there."""
    small = path.stat().st_size <= CACHE_BYTES
    return (_groups if small else _groups.__wrapped__)(path, digest, about)


@lru_cache(maxsize=6)
def _groups(path: Path, digest: str, described: str) -> dict[str, xr.Dataset]:
    """Read the groups of an entry of this digest, as they were when they were kept."""
    groups, about = {}, json.loads(described)
    with closing(dataset.load(path)) as tree:
        for name, kept in about.items():
            node: Any = tree[name]
            group = node.to_dataset(inherit=False).load().drop_encoding()
            for variable, kind in kept["text"].items():
                attributes = group[variable].attrs
                group[variable] = group[variable].astype(kind)
                group[variable].attrs = attributes
            group.attrs = {key: _decoded(*value) for key, value in kept["attrs"].items()}
            for variable in group.variables.values():
                variable.values.setflags(write=False)  # several runs may have it
            groups[name] = group
    return groups


def _about(group: xr.Dataset) -> dict[str, Any]:
    """Describe what netCDF does not keep of a group: kinds of text, and of attributes."""
    text = {str(n): v.dtype.str for n, v in group.variables.items() if v.dtype.kind == "U"}
    return {"text": text, "attrs": {str(k): _encoded(v) for k, v in group.attrs.items()}}


def _encoded(value: Any) -> tuple[str, Any]:
    if isinstance(value, np.ndarray | np.generic):
        kind = "array" if isinstance(value, np.ndarray) else "scalar"
        return f"{kind} {value.dtype.str}", value.tolist()
    entries = value if isinstance(value, list | tuple) else [value]
    if not all(type(entry) in PLAIN for entry in entries):
        raise TypeError(f"an attribute of a shared step cannot be kept: {value!r}")
    return "plain", value


def _decoded(kind: str, value: Any) -> Any:
    if kind == "plain":
        return value
    of, _, dtype = kind.partition(" ")
    array = np.asarray(value, np.dtype(dtype))
    return array if of == "array" else array[()]


def _digests(paths: Iterable[str]) -> dict[str, str]:
    """Compute digests of files by the names that the configuration has for them.

    Empty of missing ones.
    """
    found = {}
    for path in sorted(set(paths)):
        file = locate(path)
        found[path] = provenance.sha256(file) if file.is_file() else ""
    return found


def _digest(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
