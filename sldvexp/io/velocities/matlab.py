"""Arrays of MATLAB files of any version, by name: numbers, text, cells and structs alike.

Fields of a struct are named with it, as ``data.velocity``. A cell of texts is a list of texts, a
cell of arrays of one size is one array with the cells first. Files of version 7.3 are HDF5: the
last dimension comes first there, complex numbers are pairs, text is numbers, and cells refer to
arrays elsewhere in the file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.lazy import h5py, scipy
from sldvexp.limits import too_much_claimed

#: Groups of an HDF5 file in which MATLAB keeps what cells refer to.
INTERNAL = "#"
#: How deep structs may lie in structs.
DEEPEST = 8
#: Arrays of a file at most.
MOST = 100_000
#: Kinds of arrays by what a file calls them; of others a byte an entry is counted.
BYTES = {"double": "f8", "single": "f4", "int64": "i8", "uint64": "i8", "int32": "i4"}


def read_arrays(path: Path) -> dict[str, NDArray]:
    """Read all arrays of a file.

    Raises
    ------
    UserError
        If it is not a MATLAB file, or damaged.
    """
    opened = _Opened(path)
    try:
        for _, shape, kind in scipy.io.whosmat(path):
            opened.take(math.prod(map(int, shape)) * np.dtype(BYTES.get(kind, "u1")).itemsize)
        found = scipy.io.loadmat(path)
    except NotImplementedError:
        return _of_version_7_3(opened)
    except UserError:
        raise
    except Exception:  # whatever the reader stumbles over in a file that is none, or is damaged
        raise UserError(f"{path}: is not a readable MATLAB file") from None
    arrays: dict[str, NDArray] = {}
    for name, value in found.items():
        if not name.startswith("__"):
            _add(arrays, name, value)
    return arrays


@dataclass
class _Opened:
    """A file, and how much it has claimed so far."""

    path: Path
    file: Any = None
    claimed: int = 0
    arrays: int = 0

    def take(self, claimed: int) -> None:
        """Count an array or a group, and complain about more than the file can hold."""
        self.claimed += max(claimed, 0)
        self.arrays += 1
        told = too_much_claimed(self.claimed, self.path.stat().st_size)
        if self.arrays > MOST:
            told = f"has more than {MOST} arrays, those that are referred to counted each time"
        if told:
            raise UserError(f"{self.path}: {told}; it is damaged, or no measurement")


def _add(arrays: dict[str, NDArray], name: str, value: Any, depth: int = 0) -> None:
    """Put an array, or the fields of a struct, under their names."""
    value = np.asarray(value)
    if value.dtype.names and value.size == 1 and depth < DEEPEST:
        for field in value.dtype.names:
            _add(arrays, f"{name}.{field}", value.ravel()[0][field], depth + 1)
    elif not value.dtype.names:
        arrays[name] = _of_cells(value) if value.dtype == object else value


def _of_cells(cells: NDArray) -> NDArray:
    """Make one array of cells: of their texts, or of numbers of one size."""
    inner = [np.squeeze(np.asarray(cell)) for cell in cells.ravel(order="F")]
    if inner and all(one.dtype.kind in "US" for one in inner):
        return np.array([str(one).strip() for one in inner])
    alike = len({one.shape for one in inner}) == 1
    if alike and all(one.dtype.kind in "biufc" for one in inner):
        return np.stack(inner)
    return cells


def _of_version_7_3(opened: _Opened) -> dict[str, NDArray]:
    """Read a file of HDF5."""
    arrays: dict[str, NDArray] = {}
    try:
        with h5py.File(opened.path, "r") as opened.file:
            for name in opened.file:
                if not name.startswith(INTERNAL):
                    _add_of_hdf5(arrays, str(name), opened.file[name], opened)
    except (OSError, RuntimeError, ValueError, KeyError, TypeError, AttributeError):
        raise UserError(f"{opened.path}: is not a readable MATLAB 7.3 file") from None
    return arrays


def _add_of_hdf5(
    arrays: dict[str, NDArray], name: str, node: Any, opened: _Opened, depth: int = 0
) -> None:
    """Put a variable, or the fields of a struct, under their names."""
    if isinstance(node, h5py.Group):
        opened.take(0)
        if depth < DEEPEST:
            for field in node:
                _add_of_hdf5(arrays, f"{name}.{field}", node[field], opened, depth + 1)
        return
    if h5py.check_ref_dtype(node.dtype) is None:
        arrays[name] = _value(node, opened)
        return
    opened.take(node.nbytes)
    references = node[()].T
    cells = np.empty(references.shape, object)
    for place in np.ndindex(cells.shape):
        target = opened.file[references[place]]
        if isinstance(target, h5py.Group) or h5py.check_ref_dtype(target.dtype) is not None:
            return  # cells of structs or of cells are no arrays
        cells[place] = _value(target, opened)
    arrays[name] = _of_cells(cells)


def _value(node: Any, opened: _Opened) -> NDArray:
    """Read numbers or text."""
    opened.take(node.nbytes)
    stored = np.asarray(node[()])
    if node.attrs.get("MATLAB_empty", 0):
        return np.empty(0)
    if stored.dtype.names and set(stored.dtype.names) == {"real", "imag"}:
        stored = stored["real"] + 1j * stored["imag"]
    kind = node.attrs.get("MATLAB_class", b"")
    if kind in (b"char", "char") and stored.ndim == 2:
        rows = np.array(["".join(map(chr, row)).strip() for row in stored.T])
        return rows if len(rows) > 1 else rows[0]
    return stored.T
