"""What every check has in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sldvexp.lazy import xarray as xr


@dataclass(frozen=True, eq=False)
class Examined:
    """The run that is examined.

    Attributes
    ----------
    tree : mapping of str to xarray.Dataset
        Group path to dataset, for example ``pose`` or ``compare/method_1``.
    rng : numpy.random.Generator
        The run's generator.
    experiment : Experiment
        Its plugins; None if there is only the dataset.
    """

    tree: Mapping[str, xr.Dataset]
    rng: np.random.Generator
    experiment: Any = None


class Check(ABC):
    """Examines a run and adds what it found as a group ``examined/<name>``."""

    @abstractmethod
    def examine(self, run: Examined) -> xr.Dataset:
        """Numbers found, with units and meaning as attributes.

        Raises
        ------
        UserError
            If the run lacks what the check examines.
        """

    def inputs(self) -> list[str]:
        """Files that the check reads, as the configuration names them."""
        return []
