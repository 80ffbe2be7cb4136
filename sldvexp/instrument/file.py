"""`instrument=file`: line-of-sight velocities from a file."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from omegaconf import MISSING

from sldvexp.paths import locate
from sldvexp.registry import register
from sldvexp.units import VelocityUnit

if TYPE_CHECKING:
    import xarray as xr


@register("instrument", "file")
@dataclass
class File:
    """Velocities that were measured before, as CSV, netCDF or MATLAB arrays.

    Parameters
    ----------
    path : str
        A ``.csv`` (``view,dx,dy,dz,frequency,real,imag`` and optionally ``point`` and ``std``), or
        ``.nc`` or ``.mat`` with arrays ``direction_cosines``, ``velocity``, ``frequency``, ``std``.
    unit : VelocityUnit
        Of the file's velocities.
    """

    path: str = MISSING
    unit: VelocityUnit = VelocityUnit.m_per_s

    def inputs(self) -> list[str]:
        """The file."""
        return [self.path]

    def read(self) -> xr.Dataset:
        """The group ``line_of_sight``.

        Raises
        ------
        UserError
            If the file is missing or is not what it should be.
        """
        from sldvexp.line_of_sight.read import read

        return read(locate(self.path), self.unit).group()
