"""Fields of surfaces at more frequencies than fit into memory: made some lines at a time.

The fit itself reads the images some pixels at a time, and keeps the few combinations of lines that
carry signal. Lines are put together from these, block by block, into files.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from sldvexp.field.result import pooled
from sldvexp.field.streaming import joined_blocks
from sldvexp.lazy import xarray as xr
from sldvexp.shell.estimate import SurfaceField, with_undetermined


def stream_surface(
    found: SurfaceField, lines: Iterable[slice], folder: Path
) -> tuple[xr.Dataset, xr.Dataset]:
    """Make the groups ``field`` and ``strain`` of a run, some lines at a time.

    Parameters
    ----------
    found : SurfaceField
    lines : iterable of slice
        All of its lines, one block after the other.
    folder : Path
        Made for the blocks, which the groups are made of as long as they are used.

    Returns
    -------
    field, strain : xarray.Dataset
        Variables over the frequency are Dask arrays.
    """
    blocks = list(lines)
    folder.mkdir()
    determined, vague = [], []

    def fields() -> Iterator[xr.Dataset]:
        for some in blocks:
            one = found.of_lines(some).field()
            determined.append(one["observable"].values == 1)
            yield one

    def strains() -> Iterator[xr.Dataset]:
        for some in blocks:
            one = found.of_lines(some).strain()
            vague.append(one.attrs["notes"])
            yield one

    field = joined_blocks(fields(), folder / "field").assign_attrs(notes="\n".join(found.notes))
    field = with_undetermined(field, np.any(determined, axis=0))
    field.attrs |= pooled(field["sse"].values, field.attrs["samples"])
    strain = joined_blocks(strains(), folder / "strain")
    return field, strain.assign_attrs(notes=vague[0] if all(vague) else "")
