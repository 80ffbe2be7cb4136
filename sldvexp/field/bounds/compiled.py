"""Kernels of bounds, compiled by the optional package numba where that pays.

``pip install 'sldvexp[fast]'`` brings it. To import it takes 0.2 s of a processor, and to compile
some ten seconds the first time; what is compiled is kept in the user's cache. So it is used for
large fields alone, and whether one is large is told by its samples: the same field is computed in
the same way, whatever was computed before it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cache
from threading import Lock
from typing import Any

import numpy as np

from sldvexp.config.kept import private_folder
from sldvexp.field.bounds import kernels
from sldvexp.field.equations.elements import Patch
from sldvexp.field.visibility.visibility import VolumeVisibility
from sldvexp.lazy import scipy
from sldvexp.typing import Array, IndexArray

#: Samples, counted in every view, from which compiled kernels save what it takes to load them.
WORTHWHILE = 500_000
#: Folder of the user's cache that compiled kernels are kept in.
FOLDER = "sldvexp_compiled"


@dataclass(frozen=True)
class CompiledKernels:
    """Compiled functions of `sldvexp.field.bounds.kernels`, called with sparse matrices."""

    pixels_of_triangles: Callable[..., Any]
    pixels_of_nodes: Callable[..., Any]
    influences: Callable[..., Any]
    coupled_noise: Callable[..., Any]
    scalar_noise: Callable[..., Any]
    pose_sums: Callable[..., Any]

    def influences_by_layers(
        self, patch: Patch, estimators: Sequence[Array], weights: scipy.sparse.csr_array
    ) -> list[scipy.sparse.bsr_array]:
        """Compute as `sldvexp.field.equations.elements.influences_by_layers` does."""
        layers, pixels = patch.layers, weights.shape[1]
        used = [e for e in estimators if e.any()]
        shapes = [(len(patch.nodes) * e.shape[1], pixels * layers) for e in estimators]
        blocks = [(e.shape[1], layers) for e in estimators]
        if used:
            corners = _short(patch.gather.indptr, patch.gather.indices)
            sizes, seen = (
                np.array([*patch.sample_shape, pixels]),
                _short(weights.indptr, weights.indices),
            )
            near = self.pixels_of_triangles(sizes, *seen)
            indptr, indices, place = self.pixels_of_nodes(*corners, pixels, *near)
            values = weights.data, np.ascontiguousarray(patch.shape), np.concatenate(used, axis=1)
            data = self.influences(sizes, *seen, *values, *near, place, len(indices))
        found, first = [], 0
        for e, shape, block in zip(estimators, shapes, blocks, strict=True):
            if not e.any():  # the rows leave this view out
                found.append(scipy.sparse.bsr_array(shape, blocksize=block))
                continue
            own = np.ascontiguousarray(data[:, first : first + block[0]])
            found.append(scipy.sparse.bsr_array((own, indices, indptr), shape=shape))
            first += block[0]
        return found

    def coupled(
        self,
        surface: scipy.sparse.bsr_array,
        own: IndexArray,
        influence: tuple[scipy.sparse.bsr_array, Array],
        variance: Array,
        fitted: bool,
    ) -> tuple[Array, Array]:
        """Compute blocks on the diagonals of ``K_l S K_l^T``, and the sums of that of ``K S R^T``.

        Parameters
        ----------
        surface : bsr_array, shape (own * 3, patch_node * 3)
            The matrix Z of ``K = Z R``.
        own : ndarray of int
            Places of the own nodes in the patch.
        influence : tuple of bsr_array and ndarray, shape (entry, 3, layer)
            R, and its blocks with the line's inverse before them.
        variance : ndarray, shape (pixel,)
        fitted : bool
            Whether the second is wanted; zeros otherwise.

        Returns
        -------
        covariance : ndarray, shape (layer, own, 3, 3)
        of_both : ndarray, shape (3,)
        """
        r, along = influence
        second = r.data if fitted else r.data[:0]
        found, of_both = self.coupled_noise(
            *_short(surface.indptr, surface.indices), surface.data, *_short(own),
            *_short(r.indptr, r.indices), along, second, variance, _longest(surface, r),
        )  # fmt: skip
        return found[:, BLOCK].transpose(3, 0, 1, 2), of_both

    def scalar(
        self,
        surface: scipy.sparse.bsr_array,
        own: IndexArray,
        influence: tuple[scipy.sparse.bsr_array, Array],
        variance: Array,
        fitted: bool,
    ) -> tuple[Array, Array]:
        """Compute as `coupled` does where the rows are the same for every parameter.

        Returns
        -------
        nodal : ndarray, shape (layer, own, parameter)
        of_both : ndarray, shape (parameter,)
        """
        r, along = influence
        entries, p, layers = r.data.shape
        second, along = (x.reshape(entries, p * layers) for x in (r.data, along))
        found, of_both = self.scalar_noise(
            *_short(surface.indptr, surface.indices), surface.data.ravel(), *_short(own),
            *_short(r.indptr, r.indices), along,
            second if fitted else second[:0], variance, _longest(surface, r),
        )  # fmt: skip
        nodal = np.moveaxis(found.reshape(-1, p, layers), 2, 0)
        return nodal, of_both.reshape(p, layers).sum(axis=1)


#: Places of a symmetric block's entries among 00, 10, 11, 20, 21 and 22.
BLOCK = np.array([[0, 1, 3], [1, 2, 4], [3, 4, 5]])


def _short(*arrays: IndexArray) -> list[IndexArray]:
    """Give indices one type, so that kernels are compiled for no other."""
    return [np.asarray(array, np.int32) for array in arrays]


def _longest(surface: scipy.sparse.bsr_array, r: scipy.sparse.bsr_array) -> int:
    """Bound the pixels of a row of ``Z R``."""
    ends = np.concatenate([[0], np.cumsum(np.diff(r.indptr)[surface.indices])])
    longest = int(np.diff(ends[surface.indptr]).max(initial=0))
    return min(longest, r.shape[1] // r.blocksize[1])


#: Views ask side by side, and numba is set up once.
LOCK = Lock()


def kernels_for(visibility: VolumeVisibility) -> CompiledKernels | None:
    """Compile kernels, or load what was compiled; None if that does not pay, or cannot be."""
    samples = visibility.prisms.gaps * len(visibility.prisms.triangles) * visibility.rule.points
    if samples * len(visibility.views) < WORTHWHILE:
        return None
    with LOCK:
        return _compiled()


@cache
def _compiled() -> CompiledKernels | None:
    """Load the compiler, if it is installed and whole."""
    try:
        import numba
    except ImportError:  # also where it does not go with numpy's version
        return None
    config: Any = numba.config
    told, folder = config.CACHE_DIR, private_folder(FOLDER)
    config.CACHE_DIR = told or folder
    try:
        # Products and sums may be rounded once instead of twice; their order stays.
        compiled = numba.njit(
            cache=bool(told or folder), nogil=True, error_model="numpy", fastmath={"contract"}
        )
        names = [field.name for field in fields(CompiledKernels)]
        return CompiledKernels(*(compiled(getattr(kernels, name)) for name in names))
    finally:
        config.CACHE_DIR = told
