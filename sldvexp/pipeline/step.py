"""Contract of a run's steps, and the common ground that they work on."""

from __future__ import annotations

import shutil
import weakref
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from sldvexp import importers
from sldvexp.config.experiment import Experiment
from sldvexp.dataset import VERDICT, findings_of, findings_to_dataset, verdict_of
from sldvexp.lazy import xarray as xr
from sldvexp.session import Operator, Watcher
from sldvexp.writing import own_folder


@dataclass
class Run:
    """Common ground of the steps of one run: plugins, generator, and the groups made so far.

    Parameters
    ----------
    experiment : Experiment
    rng : Generator
    folder : Path
    operator : Operator
    watcher : Watcher
    tree : dict of str to Dataset
        Groups by their path.
    inputs : list of str
        Files read so far, as the configuration names them.
    reused : list of str
        Steps that were done by another run of the same sweep.
    elsewhere : set of str
        Groups that stay in the file they are streamed from, one of `inputs`.
    """

    experiment: Experiment
    rng: np.random.Generator
    folder: Path
    operator: Operator = field(default_factory=Operator)
    watcher: Watcher = field(default_factory=Watcher)
    tree: dict[str, xr.Dataset] = field(default_factory=dict)
    inputs: list[str] = field(default_factory=list)
    reused: list[str] = field(default_factory=list)
    elsewhere: set[str] = field(default_factory=set)

    @property
    def kept(self) -> dict[str, xr.Dataset]:
        """Groups that the run's file gets."""
        return {name: group for name, group in self.tree.items() if name not in self.elsewhere}

    @property
    def verdict(self) -> str:
        """Trusted, doubtful or void, by what has been found so far."""
        return verdict_of(findings_of(self.tree))

    def conclude(self) -> None:
        """Make one group of what all stages found."""
        whole = findings_to_dataset(findings_of(self.tree))
        for name in [n for n in self.tree if n.startswith(f"{VERDICT}/")]:
            del self.tree[name]
        self.tree[VERDICT] = whole

    def keep(self, name: str, group: xr.Dataset) -> xr.Dataset:
        """Keep a scanned group.

        With a stream an image goes to a file, before the next view comes.
        """
        if self.experiment.stream is None or not name.startswith("image/"):
            return group
        path = self.blocks / f"{name.replace('/', '_')}.nc"
        return importers.image_file.spilled(group, path, self.experiment.stream.chunks)

    @cached_property
    def blocks(self) -> Path:
        """Folder of what is streamed, as long as the run is used."""
        folder = own_folder(self.folder, "blocks")
        weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        return folder


@dataclass(frozen=True)
class Step:
    """One stage of a run, and its contract.

    A name of groups that ends with a slash means all below it. Runs of a sweep share the result of
    a step that `reads` keys: it must be decided by them and by the groups that it needs alone, and
    draw no random numbers. The contracts are checked when this module is imported
    (`check_contracts`) and what a step adds in every run (`Step.perform`).

    Parameters
    ----------
    name : str
    needed : callable
        Whether an experiment has it.
    work : callable
        Adds groups to the run's tree; it changes none that are there.
    makes : tuple of str
        Groups that it may add.
    needs : tuple of str
        Groups that it looks at, as far as they are there; ``/`` for all.
    reads : tuple of str
        Keys of the configuration that decide what it adds, if it is shared. Of a plugin a dotted
        key reads one setting, and ``*`` stands for the entries of a table: ``compare.*.robust``.
    """

    name: str
    needed: Callable[[Experiment], bool]
    work: Callable[[Run], None]
    makes: tuple[str, ...]
    needs: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()

    @property
    def shared(self) -> bool:
        """True if runs of a sweep share its result."""
        return bool(self.reads)

    @property
    def keys(self) -> set[str]:
        """Keys of the configuration, not dotted, of which it reads something."""
        return {key.partition(".")[0] for key in self.reads}

    def after(self, earlier: Iterable[Step]) -> tuple[str, ...]:
        """Name those of the steps before this one that make what it needs."""
        return tuple(step.name for step in earlier if _overlap(step.makes, self.needs))

    def perform(self, run: Run) -> None:
        """Do the work.

        Raises
        ------
        RuntimeError
            If it adds a group that it does not declare.
        """
        before = set(run.tree)
        self.work(run)
        for group in run.tree.keys() - before:
            if not _overlap([group], self.makes):
                raise RuntimeError(f"the step {self.name} adds {group}, which it does not declare")


def setting(settings: Any, key: str) -> Any:
    """Find what a step reads of plain settings; None where there is nothing.

    Examples
    --------
    >>> setting({"compare": {"a": {"robust": "off"}, "b": {}}}, "compare.*.robust")
    {'a': 'off', 'b': None}
    """
    first, _, rest = key.partition(".")
    if not isinstance(settings, dict):
        return None
    if first == "*":
        return {name: setting(entry, rest) for name, entry in settings.items()}
    found = settings.get(first)
    return setting(found, rest) if rest else found


def _overlap(some: Iterable[str], others: Iterable[str]) -> bool:
    """Say whether two declarations of groups have one in common."""

    def covers(a: str, b: str) -> bool:
        return a in ("/", b) or (a.endswith("/") and b.startswith(a))

    return any(covers(a, b) or covers(b, a) for a in some for b in others)


def check_contracts(steps: Sequence[Step]) -> None:
    """Check that what steps declare can be true.

    Raises
    ------
    ValueError
        If a step reads a key that the configuration does not have, or needs groups that no step
        before it makes.
    """
    keys = {f.name for f in fields(Experiment)}
    for place, step in enumerate(steps):
        if unknown := step.keys - keys:
            raise ValueError(f"the step {step.name} reads {sorted(unknown)}, which no key is")
        made = [group for earlier in steps[:place] for group in earlier.makes]
        if lost := [group for group in step.needs if not _overlap([group], made)]:
            raise ValueError(f"the step {step.name} needs {lost}, which no step before it makes")
