"""`instrument=images`: velocity images that were made before, read at once or in chunks."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePath

import numpy as np
from omegaconf import MISSING

from sldvexp import dataset
from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.dataset.references import FURTHER
from sldvexp.errors import Checks, UserError
from sldvexp.files import require_file, unusable
from sldvexp.importers.base import ImageImporter
from sldvexp.lazy import xarray as xr

NEEDED = ("velocity", "velocity_std", "dac", "flags")


@register("instrument", "images")
@dataclass
class Images(ImageImporter):
    """Velocity images of all views from one file, which `stream=dask` need not fit into memory.

    Parameters
    ----------
    path : str
        A run's folder or ``run.nc``, or a netCDF-4 file with the same groups ``image/<view>``:
        ``velocity`` (pixel, frequency) in m/s, ``velocity_std``, ``dac`` and ``flags``.
    further : dict of str to str
        Other such files, of the same pixels while the exciter was elsewhere, by a name of that
        place; modes are found in all of them together.
    """

    path: str = MISSING
    further: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        checks = Checks()
        for name in self.further:
            wrong = unusable(name)
            checks.require(not wrong, "further", f"the name of the place {name!r} {wrong}")
        checks.done()

    def inputs(self) -> list[str]:
        """Name the files."""
        return [
            str(PurePath(path, "run.nc")) if locate(path).is_dir() else path
            for path in (self.path, *self.further.values())
        ]

    def images(self, chunks: Mapping[str, int] | None = None) -> dict[str, xr.Dataset]:
        """Read the groups ``image/<view>``; with `chunks`, variables are Dask's, of the file.

        Images of further places of excitation are the groups ``reference/<name>/<view>``.
        """
        found = _read(locate(self.inputs()[0]), chunks)
        for name, path in zip(self.further, self.inputs()[1:], strict=True):
            for group, image in _read(locate(path), None).items():
                if group.startswith("image/"):
                    found[f"{FURTHER}{name}/{group.removeprefix('image/')}"] = image
        return found


def _read(path: Path, chunks: Mapping[str, int] | None) -> dict[str, xr.Dataset]:
    """Read the groups of one file."""
    require_file(path)
    tree = dataset.load(path)
    if "image" not in tree.children:
        raise UserError(f"{path}: has no velocity images; it needs a group image/<view> for each")
    found = {}
    for view, node in tree["image"].children.items():
        group = _checked(node.to_dataset(inherit=False), f"{path}: the group image/{view}")
        found[f"image/{view}"] = group.load() if chunks is None else in_chunks(group, chunks)
    for node in tree.leaves:
        name = node.path.removeprefix("/")
        if name.startswith(FURTHER):
            group = node.to_dataset(inherit=False)
            found[name] = _checked(group, f"{path}: the group {name}").load()
    if chunks is None:
        tree.close()
    return found


def _checked(image: xr.Dataset, where: str) -> xr.Dataset:
    """Complain unless an image has all variables; put its pixels first."""
    if missing := [name for name in NEEDED if name not in image]:
        raise UserError(f"{where} lacks {', '.join(missing)}")
    if not set(image["velocity"].dims) <= {"pixel", "frequency"} or "pixel" not in image.dims:
        dims = ", ".join(map(str, image["velocity"].dims))
        raise UserError(f"{where} has velocities over {dims}; they must be over pixel, frequency")
    image = image.transpose("pixel", "frequency", ..., missing_dims="ignore")
    flagged = np.count_nonzero(image["flags"].values)
    image.attrs.setdefault("summary", f"{flagged} of {image.sizes['pixel']} pixels are flagged")
    return image


def in_chunks(image: xr.Dataset, chunks: Mapping[str, int]) -> xr.Dataset:
    """Make velocities and their errors Dask arrays, all else being in memory.

    Parameters
    ----------
    image : xarray.Dataset
        A group ``image/<view>``, in memory or in a file.
    chunks : mapping of str to int
        Along pixel and frequency.
    """
    large = [n for n, v in image.data_vars.items() if "frequency" in v.dims and v.ndim > 1]
    small = image.drop_vars(large).load()
    return small.assign(
        {n: image[n].chunk({d: chunks[str(d)] for d in image[n].dims}) for n in large}
    )


def spilled(image: xr.Dataset, path: Path, chunks: Mapping[str, int]) -> xr.Dataset:
    """Write an image to a file and read it from there, see `in_chunks`."""
    dataset.save_table(image, path)
    return in_chunks(xr.open_dataset(path, engine="netcdf4", auto_complex=True), chunks)
