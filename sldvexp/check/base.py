"""What every check has in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr


class Check(ABC):
    """Examines a run's dataset and adds what it found as a group ``examined/<name>``."""

    @abstractmethod
    def examine(self, tree: Mapping[str, xr.Dataset], rng: np.random.Generator) -> xr.Dataset:
        """Numbers found, with units and meaning as attributes.

        Parameters
        ----------
        tree : mapping of str to xarray.Dataset
            Group path to dataset, for example ``pose`` or ``compare/method_1``.
        rng : numpy.random.Generator
            The run's generator.

        Raises
        ------
        UserError
            If the run lacks what the check examines.
        """

    def inputs(self) -> list[str]:
        """Files that the check reads, as the configuration names them."""
        return []
