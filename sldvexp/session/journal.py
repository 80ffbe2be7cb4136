"""What was measured, kept line by line, so that a session that was cut off goes on where it was."""

from __future__ import annotations

import zipfile
from collections.abc import Callable
from dataclasses import astuple
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.files import whole_or_nothing
from sldvexp.instrument.protocol import Acquisition, Samples


class Journal:
    """Finished scan lines of one view, one small file each, written whole or not at all.

    Parameters
    ----------
    folder : Path
        Made when the first line is kept.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def line(
        self,
        name: str,
        dac: NDArray[np.int64],
        acquisition: Acquisition,
        measure: Callable[[], Samples],
    ) -> Samples:
        """The samples of a line: those kept earlier, or measured now and kept.

        Parameters
        ----------
        name : str
            Of the line, unique in the view.
        dac : ndarray of int, shape (pixel, 2)
        acquisition : Acquisition
        measure : callable
            Called only if the line is not in the journal, or its file is not whole.

        Raises
        ------
        UserError
            If the journal has this line with other pixels or another sampling: it belongs to
            another configuration.
        """
        path = self.folder / f"{name}.npz"
        asked = np.array(
            [*astuple(acquisition)[:2], *acquisition.excitation, acquisition.amplitude]
        )
        if path.exists():
            kept = self._read(path, dac, asked)
            if kept is not None:
                return kept
        samples = measure()
        self.folder.mkdir(parents=True, exist_ok=True)
        with whole_or_nothing(path) as beside, beside.open("wb") as file:
            np.savez(
                file,
                dac=dac,
                asked=asked,
                counts=samples.counts,
                volts_per_count=samples.volts_per_count,
                rate=samples.rate,
                status=samples.status,
            )
        return samples

    def _read(
        self, path: Path, dac: NDArray[np.int64], asked: NDArray[np.float64]
    ) -> Samples | None:
        """A kept line, or None if its file is damaged."""
        try:
            with np.load(path) as kept:
                found = {key: kept[key] for key in kept.files}
        except (zipfile.BadZipFile, ValueError, EOFError, KeyError):
            return None
        if not np.array_equal(found["dac"], dac) or not np.array_equal(found["asked"], asked):
            raise UserError(
                f"{path}: was measured with other pixels or another sampling; this folder belongs "
                "to another configuration, start the run in a new one"
            )
        return Samples(
            found["counts"], found["volts_per_count"], float(found["rate"]), found["status"]
        )
