"""`instrument=images`: velocity images that were made before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePath

from omegaconf import MISSING

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.importers.read_images import read_images
from sldvexp.lazy import xarray as xr


@register("instrument", "images")
@dataclass
class Images:
    """Velocity images of all views from one file, which `stream=dask` need not fit into memory.

    Parameters
    ----------
    path : str
        A run's folder or ``run.nc``, or a netCDF-4 file with the same groups ``image/<view>``:
        ``velocity`` (pixel, frequency) in m/s, ``velocity_std``, ``dac`` and ``flags``.
    """

    path: str = MISSING

    def inputs(self) -> list[str]:
        """The file."""
        return [str(PurePath(self.path, "run.nc")) if locate(self.path).is_dir() else self.path]

    def images(self, chunks: Mapping[str, int] | None = None) -> dict[str, xr.Dataset]:
        """The groups ``image/<view>``.

        Parameters
        ----------
        chunks : mapping of str to int, optional
            Size of Dask's chunks along pixel and frequency; without it images are read at once.

        Raises
        ------
        UserError
            If the file is missing or is not what it should be.
        """
        return read_images(locate(*self.inputs()), chunks)
