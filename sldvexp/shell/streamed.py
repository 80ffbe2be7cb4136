"""Fields of surfaces at more frequencies than fit into memory: made some lines at a time.

The fit itself reads the images some pixels at a time, and keeps the few combinations of lines that
carry signal. Lines are put together from these, block by block, into files.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from sldvexp.field.result import pooled
from sldvexp.field.streaming import joined_blocks
from sldvexp.lazy import xarray as xr
from sldvexp.shell.estimate import SurfaceField


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
    field = joined_blocks((found.of_lines(some).field() for some in blocks), folder / "field")
    field.attrs |= pooled(field["sse"].values, field.attrs["samples"])
    strain = joined_blocks((found.of_lines(some).strain() for some in blocks), folder / "strain")
    return field, strain
