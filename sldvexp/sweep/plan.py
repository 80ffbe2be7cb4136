"""Plan of a sweep: which keys take which values, and in which folder each run belongs."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf

from sldvexp.errors import UserError
from sldvexp.files import read_json
from sldvexp.writing import whole_or_nothing

#: In a sweep's folder: which sweep it belongs to.
OWNER = ".sweep.json"
#: Longest name of a run's folder that is made of its settings alone.
MOST_LETTERS = 100
DIGEST = 8

#: What OmegaConf calls `folder_of`, in ``hydra.sweep.subdir``.
RESOLVER = "sldvexp_run_folder"


@dataclass(frozen=True)
class Plan:
    """Runs of a sweep, by the values that their keys take.

    Attributes
    ----------
    keys : tuple of str
        Swept keys, in the order of the command line.
    jobs : tuple of tuple of str
        The overrides of every run, as Hydra's sweeper makes them.
    fixed : tuple of str
        The overrides that all runs have.
    """

    keys: tuple[str, ...]
    jobs: tuple[tuple[str, ...], ...]
    fixed: tuple[str, ...]

    @classmethod
    def from_overrides(cls, overrides: Sequence[str]) -> Plan:
        """Plan a command line's overrides; Hydra's own settings are none of it."""
        parsed = OverridesParser.create().parse_overrides(list(overrides))
        task = [o for o in parsed if not re.match(r"[+~]*hydra[./]", o.get_key_element())]
        jobs = BasicSweeper.split_arguments(task, None)[0]
        swept = [o for o in task if o.is_sweep_override()]
        fixed = [o.input_line or "" for o in task if not o.is_sweep_override()]
        return cls(
            tuple(o.get_key_element() for o in swept),
            tuple(tuple(job) for job in jobs),
            tuple(f for f in fixed if _matters(f)),
        )

    @property
    def names(self) -> list[str]:
        """Swept keys as they are named in the dataset, without a leading + or ~."""
        return [key.lstrip("+~") for key in self.keys]

    def cells(self) -> list[tuple[str, ...]]:
        """List the swept values of every run, in the order of the keys."""
        return [tuple(_value(job, key) for key in self.keys) for job in self.jobs]

    def sweep_name(self, *others: str) -> str:
        """Name of the sweep's folder: the same for the same keys, whatever their values.

        Parameters
        ----------
        *others : str
            What else sets this sweep apart, such as a folder of the user's configuration.
        """
        chosen = [
            f.partition("=") for f in self.fixed if f.startswith(("experiment=", "~experiment"))
        ]
        first = next((value if key == "experiment" else "" for key, _, value in chosen), "plate")
        about = [*filter(None, [first]), *(k.rpartition(".")[2] for k in self.names)]
        return _named("_".join(about), repr(self._apart(others)), always=True)

    def claim(self, folder: Path, *others: str) -> None:
        """Note that a folder belongs to this sweep, whose values of the keys may grow.

        Parameters
        ----------
        folder : Path
            Of the sweep; it exists.
        *others : str
            As for `sweep_name`.

        Raises
        ------
        UserError
            If it belongs to a sweep over other keys or with other settings.
        """
        path, ours = folder / OWNER, json.loads(json.dumps(self._apart(others)))
        try:
            found = read_json(path)
            keys, fixed, *_ = found
            of = ", ".join(keys) + (f" with {' '.join(fixed)}" if fixed else "")
        except (UserError, ValueError, TypeError):  # nobody's, or nobody can tell
            with whole_or_nothing(path) as beside:
                beside.write_text(json.dumps(ours))
            return
        if found != ours:
            raise UserError(
                f"{folder}: belongs to another sweep, over {of}; choose another folder with "
                "hydra.sweep.dir=..."
            )

    def _apart(self, others: Sequence[str]) -> tuple[list[str], list[str], tuple[str, ...]]:
        """Gather what sets this sweep apart from others."""
        return sorted(self.keys), sorted(self.fixed), tuple(others)


def folder_name(overrides: Sequence[str]) -> str:
    """Name of a run's folder: its overrides, and a digest where a name cannot carry them."""
    text = ",".join(o for o in overrides if _matters(o))
    return _named(text, text)


def register_resolver() -> None:
    """Let ``hydra.sweep.subdir`` name each run's folder by what sets it apart."""

    def of_run(*, _root_: Any) -> str:
        return folder_name([str(o) for o in _root_.hydra.overrides.task])

    OmegaConf.register_new_resolver(RESOLVER, of_run, replace=True)


def _value(overrides: Sequence[str], key: str) -> str:
    return next(o.partition("=")[2] for o in overrides if o.startswith(f"{key}="))


def _matters(override: str) -> bool:
    """Tell whether an override changes what a run gives; those of the sweep and its page do not."""
    return not override.lstrip("+~").startswith(("sweep.", "report.", "report="))


def _named(text: str, digested: str, always: bool = False) -> str:
    name = re.sub(r"[^\w.,=+-]", "_", text)
    if name == text and len(name) <= MOST_LETTERS and not always:
        return name
    digest = hashlib.sha256(digested.encode()).hexdigest()[:DIGEST]
    return f"{name[:MOST_LETTERS]}-{digest}"


def labels(values: Sequence[str]) -> list[Any]:
    """Make the coordinates of one key: numbers only if all of them are."""
    found = [_number(v) for v in values]
    if all(isinstance(v, int | float) for v in found):
        return found
    return [v.strip("'\"") for v in values]


def _number(value: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(value)
        except ValueError:
            continue
    return value
