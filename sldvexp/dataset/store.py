"""How a run is made of groups, written and opened again.

A run is one netCDF-4 file, a group a stage. It is written beside its final name and renamed: a file
of that name is always whole. HDF5 is not crash-safe, and netCDF4 needs ``auto_complex`` for complex
numbers; whoever reads or writes a run's file does it through here.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.config.paths import RUN_FILE
from sldvexp.dataset.variable import FREQUENCY, Variable
from sldvexp.dataset.variables import AXES, CONVENTIONS, VARIABLES
from sldvexp.errors import UserError
from sldvexp.files import require_file
from sldvexp.lazy import netCDF4
from sldvexp.lazy import xarray as xr
from sldvexp.limits import SHOWN, shown, too_many_groups, too_much_claimed, tried_apart
from sldvexp.writing import whole_or_nothing

UNREADABLE = "is not a readable netCDF-4 file"


def group(name: str, coords: Mapping[str, ArrayLike], **arrays: ArrayLike | None) -> xr.Dataset:
    """Make one stage's group: arrays get their dimensions, units and meaning from `VARIABLES`.

    Parameters
    ----------
    name : str
        A key of `VARIABLES`.
    coords : mapping of str to array_like
        Coordinates besides `AXES`. An optional dimension is present if it has a coordinate here.
    **arrays : array_like or None
        The variables; None is left out.

    Examples
    --------
    >>> point = group("point", {"frequency": [200.0]}, velocity=[[0.01], [0.0], [0.02j]])
    >>> dict(point.sizes), point["velocity"].attrs["units"]
    ({'component': 3, 'frequency': 1}, 'm/s')
    """
    known = VARIABLES[name]
    data: dict[str, Any] = {}
    for variable, values in arrays.items():
        if values is None:
            continue
        spec = known[variable]
        dims = _dims(spec, coords)
        attributes = {"units": spec.units, "long_name": spec.long_name}
        array = np.asarray(values, order="C")  # as it comes back from a file, to the last bit
        data[variable] = (dims, array.astype(np.int8) if array.dtype == bool else array, attributes)
    used = {d for dims, _, _ in data.values() for d in dims}
    axes = {d: list(AXES[d]) for d in AXES if d in used}
    given = {d: np.asarray(v) for d, v in coords.items() if d in used}
    dataset = xr.Dataset(data, coords={**axes, **given})
    if "frequency" in dataset.coords:
        dataset["frequency"].attrs["units"] = FREQUENCY.units
    return dataset


def _dims(spec: Variable, coords: Mapping[str, ArrayLike]) -> tuple[str, ...]:
    """Return all required dimensions of a variable, and the optional ones with a coordinate."""
    parts = [(d.strip("[]"), d.startswith("[")) for d in spec.dims.split()]
    return tuple(d for d, optional in parts if not optional or d in coords)


def whole_tree(tree: Mapping[str, xr.Dataset], attributes: Mapping[str, Any]) -> xr.DataTree:
    """Make the tree that a run's file holds, see `save`.

    Examples
    --------
    >>> whole_tree({"pose": group("pose", {"view": ["front"]}, s=[0.2])}, {})["pose/s"].item()
    0.2
    """
    root = xr.Dataset(attrs={**CONVENTIONS, **attributes})
    groups = {f"/{k}": _double(v) for k, v in tree.items()}
    return xr.DataTree.from_dict({"/": root, **groups})


def in_memory(tree: xr.DataTree) -> bool:
    """Tell whether no values are still to be computed, as those of a stream are.

    Examples
    --------
    >>> in_memory(whole_tree({"pose": group("pose", {"view": ["front"]}, s=[0.2])}, {}))
    True
    """
    return not any(v.chunks for node in tree.subtree for v in node.variables.values())


def save(tree: Mapping[str, xr.Dataset], attributes: Mapping[str, Any], path: Path) -> None:
    """Write the run beside its final name and rename it: a file of that name is always whole.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        Group path (``pose``, ``compare/method_1``) to its dataset.
    attributes : mapping
        Of the root.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     save({"pose": group("pose", {"view": ["front"]}, s=[0.2])}, {}, Path(folder, "run.nc"))
    ...     load_some(Path(folder, "run.nc"), ["pose"])["pose/s"].item()
    0.2
    """
    whole = whole_tree(tree, attributes)
    with whole_or_nothing(path) as beside:
        if in_memory(whole):
            _write(whole, beside)
        else:
            whole.to_netcdf(beside, engine="netcdf4", auto_complex=True)
    _bounded.add(_state(path))


#: So many bytes wait until what they are of is declared.
WAITING_BYTES = 2**26


def _write(tree: xr.DataTree, path: Path) -> None:
    """Write groups as `xarray.DataTree.to_netcdf` does, but declare variables before values come.

    Where something was declared since the last value, netCDF goes through the whole file before it
    writes the next: with hundreds of variables this takes most of the time.
    """
    writer = _Waiting()
    with netCDF4.Dataset(path, "w", auto_complex=True) as file:
        for node in tree.subtree:
            group = file if node is tree else file.createGroup(node.path)
            store = xr.backends.NetCDF4DataStore(group, mode="a")
            node.to_dataset(inherit=False).dump_to_store(store, writer=writer)
        writer.write()


class _Waiting:
    """Values on their way into a file, in the place of xarray's writer, which lets none wait."""

    def __init__(self) -> None:
        self._waiting: list[tuple[Any, Any]] = []
        self._bytes = 0

    def add(self, source: Any, target: Any, region: None = None) -> None:
        """Take the values of a variable."""
        self._waiting.append((source, target))
        self._bytes += source.nbytes
        if self._bytes > WAITING_BYTES:  # which may have been read for this alone
            self.write()

    def write(self) -> None:
        """Write all that wait."""
        for source, target in self._waiting:
            target[...] = source
        self._waiting, self._bytes = [], 0


def _double(group: xr.Dataset) -> xr.Dataset:
    """Make complex numbers double precision.

    Beside one of double precision netCDF4 1.7.5 writes a complex variable of single precision wrong
    (its type is taken for the other), mostly without an error.
    """
    single = [name for name, v in group.data_vars.items() if v.dtype == np.complex64]
    if not single:
        return group
    return group.assign({n: group[n].astype(np.complex128).drop_encoding() for n in single})


def open_run(path: str | Path, lazy: bool = False) -> xr.DataTree:
    """Open a run that was made earlier.

    Parameters
    ----------
    path : str or Path
        Its ``run.nc``, or the folder that has one.
    lazy : bool
        Whether values are read when they are needed. The file is then open until the tree is
        closed, as by ``with``; otherwise all is in memory and the file is closed.

    Raises
    ------
    UserError
        If it is missing or is not a run's netCDF-4 file.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     point = group("point", {}, velocity=[0.01, 0.0, 0.02j])
    ...     save({"point": point}, {"seed": 1}, Path(folder, "run.nc"))
    ...     tree = open_run(folder)
    >>> tree["point/velocity"].values
    array([0.01+0.j  , 0.  +0.j  , 0.  +0.02j])
    """
    path = Path(path)
    tree = load(path / RUN_FILE if path.is_dir() else path)
    if lazy:
        return tree
    with tree:
        return tree.load()


def _require(path: Path) -> None:
    if not path.exists():
        raise UserError(f"{path}: there is no such file; a run's dataset is called {RUN_FILE}")
    require_file(path)


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Say in a sentence what the netCDF library cannot read, in whatever way it says so.

    Raises
    ------
    UserError

    Examples
    --------
    >>> with readable(Path("mine.nc")):
    ...     raise RuntimeError("NetCDF: HDF error")
    Traceback (most recent call last):
    sldvexp.errors.UserError: mine.nc: is not a readable netCDF-4 file (NetCDF: HDF error)
    """
    try:
        yield
    except UserError:
        raise
    except MemoryError:
        raise UserError(f"{path}: {UNREADABLE} (its arrays need more than all memory)") from None
    except Exception as error:  # damaged files end it in all kinds of ways
        told = shown(" ".join(str(error).split()) or type(error).__name__, SHOWN)
        raise UserError(f"{path}: {UNREADABLE} ({told})") from None


def require_bounded(path: Path) -> None:
    """Complain about a netCDF file with groups or arrays that no such file can hold.

    Examples
    --------
    >>> require_bounded(Path("none.nc"))
    Traceback (most recent call last):
    sldvexp.errors.UserError: none.nc: there is no such file; a run's dataset is called run.nc
    """
    _require(path)
    if _state(path) in _bounded:
        return
    opened = netCDF4.Dataset  # loaded here, before there is another process

    def look() -> str:
        with opened(path) as file:
            if told := too_many_groups(lambda group: iter(group.groups.values()), file):
                return told
            claimed = sum(
                math.prod(variable.shape) * getattr(variable.dtype, "itemsize", 1)
                for group in _with_those_below(file)
                for variable in group.variables.values()
            )
        return too_much_claimed(claimed, path.stat().st_size)

    with readable(path):
        told = tried_apart(look)
    if told:
        raise UserError(f"{path}: {told}; it is damaged, or no measurement")
    _bounded.add(_state(path))


def require_declared(path: Path, name: str, data: xr.Dataset) -> None:
    """Complain about a group whose variables have other dimensions than `VARIABLES` declares.

    Examples
    --------
    >>> require_declared(Path("mine.nc"), "pose", xr.Dataset({"origin": ("odd", [1.0])}))
    Traceback (most recent call last):
    sldvexp.errors.UserError: mine.nc: pose/origin has the dimensions odd; they must be view axis
    """
    for variable, spec in VARIABLES[name].items():
        if variable not in data:
            continue
        dims = [str(d) for d in data[variable].dims]
        needed = [d for d in spec.dims.split() if not d.startswith("[")]
        if not {*needed} <= {*dims} <= {d.strip("[]") for d in spec.dims.split()}:
            raise UserError(
                f"{path}: {name}/{variable} has the dimensions {', '.join(dims) or 'of a number'}; "
                f"they must be {spec.dims}"
            )


#: Files that this process has written, or has looked at.
_bounded: set[tuple[int, ...]] = set()


def _state(path: Path) -> tuple[int, ...]:
    """Tell a file from others, and from what it was."""
    found = path.stat()
    return found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns


def load(path: Path) -> xr.DataTree:
    """Open a netCDF-4 file with groups lazily, see `open_run`.

    Examples
    --------
    >>> load(Path("none.nc"))
    Traceback (most recent call last):
    sldvexp.errors.UserError: none.nc: there is no such file; a run's dataset is called run.nc
    """
    require_bounded(path)
    with readable(path):
        return xr.open_datatree(path, engine="netcdf4", auto_complex=True)


def load_table(path: Path) -> xr.Dataset:
    """Read a dataset without groups, such as a sweep's; UserError if it is not readable.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     save_table(xr.Dataset({"seconds": 2.5}), Path(folder, "sweep.nc"))
    ...     float(load_table(Path(folder, "sweep.nc"))["seconds"])
    2.5
    """
    require_bounded(path)
    with readable(path), xr.open_dataset(path, engine="netcdf4", auto_complex=True) as opened:
        return opened.load()


def load_some(path: Path, names: Collection[str]) -> xr.DataTree:
    """Read some groups of a run's file and those below them; the others cost nothing.

    Raises
    ------
    UserError
        See `load`.

    Examples
    --------
    >>> load_some(Path("none.nc"), ["pose"])
    Traceback (most recent call last):
    sldvexp.errors.UserError: none.nc: there is no such file; a run's dataset is called run.nc
    """
    require_bounded(path)
    with readable(path), netCDF4.Dataset(path, auto_complex=True) as file:
        found = [file[name] for name in names if name in file.groups]
        groups = {g.path: _in_memory(g) for top in found for g in _with_those_below(top)}
    return xr.DataTree.from_dict(groups)


def _with_those_below(group: Any) -> Iterator[Any]:
    yield group
    for below in group.groups.values():
        yield from _with_those_below(below)


def _in_memory(group: Any) -> xr.Dataset:
    return xr.open_dataset(xr.backends.NetCDF4DataStore(group)).load()


def save_table(table: xr.Dataset, path: Path) -> None:
    """Write a dataset without groups, such as a sweep's, whole or not at all.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     save_table(xr.Dataset({"seconds": 2.5}), Path(folder, "sweep.nc"))
    ...     float(load_table(Path(folder, "sweep.nc"))["seconds"])
    2.5
    """
    with whole_or_nothing(path) as beside:
        table.to_netcdf(beside, engine="netcdf4", auto_complex=True)
