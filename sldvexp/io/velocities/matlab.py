"""Arrays of MATLAB files of any version, by name: numbers, text, cells and structs alike.

Fields of a struct are named with it, as ``data.velocity``. A cell of texts is a list of texts, a
cell of arrays of one size is one array with the cells first. Files of version 7.3 are HDF5: the
last dimension comes first there, complex numbers are pairs, text is numbers, and cells refer to
arrays elsewhere in the file.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp.errors import UserError
from sldvexp.lazy import h5py, scipy

#: Groups of an HDF5 file in which MATLAB keeps what cells refer to.
INTERNAL = "#"
#: How deep structs may lie in structs.
DEEPEST = 8


def read_arrays(path: Path) -> dict[str, NDArray]:
    """Read all arrays of a file.

    Raises
    ------
    UserError
        If it is not a MATLAB file, or damaged.
    """
    try:
        found = scipy.io.loadmat(path)
    except NotImplementedError:
        return _of_version_7_3(path)
    except Exception:  # whatever the reader stumbles over in a file that is none, or is damaged
        raise UserError(f"{path}: is not a readable MATLAB file") from None
    arrays: dict[str, NDArray] = {}
    for name, value in found.items():
        if not name.startswith("__"):
            _add(arrays, name, value)
    return arrays


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


def _of_version_7_3(path: Path) -> dict[str, NDArray]:
    """Read a file of HDF5."""
    arrays: dict[str, NDArray] = {}
    try:
        with h5py.File(path, "r") as file:
            for name in file:
                if not name.startswith(INTERNAL):
                    _add_of_hdf5(arrays, str(name), file[name], file)
    except (OSError, RuntimeError, ValueError, KeyError, TypeError):
        raise UserError(f"{path}: is not a readable MATLAB 7.3 file") from None
    return arrays


def _add_of_hdf5(
    arrays: dict[str, NDArray], name: str, node: Any, file: Any, depth: int = 0
) -> None:
    """Put a variable, or the fields of a struct, under their names."""
    if isinstance(node, h5py.Group):
        if depth < DEEPEST:
            for field in node:
                _add_of_hdf5(arrays, f"{name}.{field}", node[field], file, depth + 1)
        return
    if h5py.check_ref_dtype(node.dtype) is None:
        arrays[name] = _value(node)
        return
    references = node[()].T
    cells = np.empty(references.shape, object)
    for place in np.ndindex(cells.shape):
        target = file[references[place]]
        if isinstance(target, h5py.Group) or h5py.check_ref_dtype(target.dtype) is not None:
            return  # cells of structs or of cells are no arrays
        cells[place] = _value(target)
    arrays[name] = _of_cells(cells)


def _value(node: Any) -> NDArray:
    """Read numbers or text."""
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
