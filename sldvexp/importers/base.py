"""Contract of the importers: plugins of the group `instrument` that read files of other programs.

A new importer is a file here and its line in `sldvexp.config.experiment`: a dataclass that is one
of the two below, with its settings as fields. A run asks it for nothing but these methods.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr


class Importer(ABC):
    """Base of both: files that are measured already.

    Everything is converted on the way in: SI units, peak amplitudes, exp(+i omega t), velocities
    positive towards the instrument. Where neither the file nor a setting says enough for that, an
    importer does not guess; it raises a `UserError` that names the file, what it does not state,
    and the setting that would.
    """

    @abstractmethod
    def inputs(self) -> list[str]:
        """Name the files that are read, as the configuration does; their sha256 is recorded."""


class PointImporter(Importer):
    """Base of importers of velocities at points, each seen along known directions.

    One whose points may become pixels has a method ``images_of_points(tree, laser)`` besides,
    which returns the groups ``image/<view>`` for a field over a volume.
    """

    @abstractmethod
    def read(
        self, tree: Mapping[str, xr.Dataset] | None = None, laser: TwoMirror | None = None
    ) -> xr.Dataset:
        """Read the group ``line_of_sight``.

        Parameters
        ----------
        tree : mapping of str to Dataset, optional
            Groups that the run has so far, for directions from its ``pose``.
        laser : TwoMirror, optional
            Likewise.

        Returns
        -------
        xarray.Dataset
            ``direction_cosines (view[, point], axis)``, unit vectors from the surface to the
            instrument, ``velocity (view[, point][, frequency])`` in m/s, and where the file tells
            them ``velocity_std`` and ``position (point, axis)``; see `sldvexp.dataset.group`. What
            is odd but no reason to refuse is left with it by `sldvexp.dataset.with_findings`.

        Raises
        ------
        UserError
            If a file is missing or broken, or says too little or contradicts itself.
        """


class ImageImporter(Importer):
    """Base of importers of velocity images, whose pixels know their mirror angles."""

    @abstractmethod
    def images(self, chunks: Mapping[str, int] | None = None) -> dict[str, xr.Dataset]:
        """Read the groups ``image/<view>``.

        Parameters
        ----------
        chunks : mapping of str to int, optional
            Size of Dask's chunks along pixel and frequency; without it images are read at once.

        Returns
        -------
        dict of str to Dataset
            ``velocity (pixel, frequency)`` in m/s, ``velocity_std``, ``dac`` and ``flags``.

        Raises
        ------
        UserError
            If a file is missing or is not what it should be.
        """
