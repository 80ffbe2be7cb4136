"""Common ground of all checks: a run as they see it, and the contract that each keeps.

A check examines what a run found and adds numbers of its own, as the group ``examined/<name>``.
Another one takes two edits: a module with a dataclass that `register` puts into the group
``check``, and the module's line in `sldvexp.config.experiment`. Its variables are lines in
`sldvexp.dataset.examined`, under ``examined/<plugin>``.

The contract, which one test holds every check of the registry to:

* Its fields are its configuration; ``__post_init__`` refuses impossible settings (`ConfigError`).
* It reads groups and changes none of them; chance comes from the run's generator alone.
* It returns variables that `VARIABLES` lists under its plugin's name, made by
  `sldvexp.dataset.group`, and may leave sentences to mind in the attribute ``notes``, one a line.
* If a run lacks what it examines, it says in one sentence what to choose (`UserError`).
* Files that it reads are named by `Check.inputs`, so that a run records their digests.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sldvexp.dataset import RunData
from sldvexp.errors import UserError, nearest
from sldvexp.lazy import xarray as xr


@dataclass(frozen=True, eq=False, repr=False)
class Examination(RunData):
    """A run as a check examines it.

    Attributes
    ----------
    rng : numpy.random.Generator
        The run's generator.
    experiment : Experiment
        Its plugins; None if there is only the dataset.
    kept : dict
        What one check worked out and others of the same run need too.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> dac = [[[10, 20], [30, 40]], [[12, 20], [30, 41]]]
    >>> points = group("registration", {"view": ["1", "2"], "point": [1, 2]}, dac=dac)
    >>> run = Examination({"registration": points}, rng=np.random.default_rng(0))
    >>> from sldvexp.check.repeatability import Repeatability
    >>> Repeatability().examine(run)["dac_std"].values.round(2)
    array([[1.41, 0.  ],
           [0.  , 0.71]])
    """

    rng: np.random.Generator = field(kw_only=True)
    experiment: Any = field(default=None, kw_only=True)
    kept: dict[str, Any] = field(default_factory=dict, kw_only=True)

    def field_of(self, name: str) -> xr.Dataset:
        """Take the field of the run's reconstruction, ``field``, or of one it is compared with.

        Raises
        ------
        UserError
            If the run has no volume, or no such field.
        """
        fields = {"field": self.groups["field"]} if self.has("field", "velocity") else {}
        fields |= self.below("compare", "velocity")
        if "field" not in fields or "volume" not in self.groups:
            raise UserError("there is no field: choose a volume and a reconstruction")
        if name not in fields:
            raise UserError(f"there is no field {name}; {nearest(name, fields)}")
        return fields[name]


class Check(ABC):
    """Examines a run and adds what it found as a group ``examined/<name>``.

    Examples
    --------
    >>> class Views(Check):
    ...     def examine(self, run: Examination) -> xr.Dataset:
    ...         return xr.Dataset({"views": run.groups["pose"].sizes["view"]})
    >>> pose = xr.Dataset(coords={"view": ["front", "left"]})
    >>> int(Views().examine(Examination({"pose": pose}, rng=np.random.default_rng(0)))["views"])
    2
    """

    @abstractmethod
    def examine(self, run: Examination) -> xr.Dataset:
        """Find the check's numbers, with units and meaning as attributes.

        Raises
        ------
        UserError
            If the run lacks what the check examines.
        """

    def inputs(self) -> list[str]:
        """Name the files that the check reads, as the configuration does."""
        return []
