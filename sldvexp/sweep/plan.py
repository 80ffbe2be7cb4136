"""The runs of a sweep: which keys take which values, and in which folder each run belongs."""

from __future__ import annotations

import hashlib
import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.core.override_parser.types import Override

#: Longest name of a run's folder that is made of its settings alone.
MOST_LETTERS = 80
DIGEST = 8


@dataclass(frozen=True)
class Plan:
    """What a sweep consists of.

    Attributes
    ----------
    values : dict of str to tuple of str
        Swept keys, in the order of the command line, and their values as they were written.
    fixed : tuple of str
        All other overrides, in the order of the command line.
    """

    values: dict[str, tuple[str, ...]]
    fixed: tuple[str, ...]

    @classmethod
    def of(cls, overrides: Sequence[str]) -> Plan:
        """The plan of a command line's overrides."""
        values: dict[str, tuple[str, ...]] = {}
        fixed: list[str] = []
        for override in OverridesParser.create().parse_overrides(list(overrides)):
            key = override.get_key_element()
            if override.is_sweep_override():
                values[key] = tuple(override.sweep_string_iterator())
            elif not key.startswith(("hydra", "sweep")):
                fixed.append(_written(override))
        return cls(values, tuple(fixed))

    @property
    def keys(self) -> list[str]:
        """The swept keys as they are named in the dataset, without a leading + or /."""
        return [key.lstrip("+/") for key in self.values]

    def cells(self) -> list[tuple[str, ...]]:
        """The values of every run, in the order of the keys."""
        return list(itertools.product(*self.values.values()))

    def folder_name(self, cell: Sequence[str]) -> str:
        """Name of a run's folder: its settings, and a digest where a name cannot carry them."""
        text = ",".join(f"{k}={v}" for k, v in zip(self.values, cell, strict=True))
        name = re.sub(r"[^\w.,=+-]", "_", text)
        if name == text and len(name) <= MOST_LETTERS:
            return name
        return f"{name[:MOST_LETTERS]}-{_digest(text)}"

    def sweep_name(self, *others: str) -> str:
        """Name of the sweep's folder: the same for the same keys, whatever their values.

        Parameters
        ----------
        *others : str
            What else sets this sweep apart, such as a folder of the user's configuration.
        """
        first = next((f for f in self.fixed if f.startswith("experiment=")), "experiment=default")
        about = [first.partition("=")[2], *(k.rpartition(".")[2] for k in self.keys)]
        name = re.sub(r"[^\w.-]", "_", "_".join(about))[:MOST_LETTERS]
        return f"{name}-{_digest(repr((sorted(self.values), self.fixed, others)))}"


def _written(override: Override) -> str:
    return str(override.input_line or "")


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:DIGEST]


def label(value: str) -> Any:
    """A swept value as a coordinate: a number if it is one, else the text without quotes."""
    try:
        return float(value) if not value.strip().lstrip("+-").isdigit() else int(value)
    except ValueError:
        return value.strip("'\"")


def labels(values: Sequence[str]) -> list[Any]:
    """Coordinates of one key: numbers only if all of them are."""
    found = [label(v) for v in values]
    if all(isinstance(v, int | float) for v in found):
        return found
    return [str(v) for v in found]


def folder_of(sweep: Path, plan: Plan, cell: Sequence[str]) -> Path:
    """Where one run of a sweep lies."""
    return sweep / plan.folder_name(cell)
