"""Sparse matrices of small blocks: what scipy's lack."""

from __future__ import annotations

import numpy as np

from sldvexp.lazy import scipy
from sldvexp.typing import Array, IndexArray


def block_rows(matrix: scipy.sparse.bsr_array, rows: IndexArray) -> scipy.sparse.bsr_array:
    """Some block rows of a matrix."""
    length = np.diff(matrix.indptr)[rows]
    start = np.concatenate([[0], np.cumsum(length)])
    entry = np.arange(start[-1]) + np.repeat(matrix.indptr[rows] - start[:-1], length)
    shape = (len(rows) * matrix.blocksize[0], matrix.shape[1])
    return scipy.sparse.bsr_array((matrix.data[entry], matrix.indices[entry], start), shape=shape)


def diagonal_blocks(matrix: scipy.sparse.bsr_array, weight: Array) -> Array:
    """Blocks on the diagonal of ``A W A^T``, shape (row, p, p), of a matrix of (p, 1) blocks.

    Parameters
    ----------
    matrix : bsr_array, shape (row * p, column)
    weight : ndarray, shape (column,)
        The diagonal matrix W.
    """
    p = matrix.blocksize[0]
    rows = matrix.shape[0] // p
    found = np.empty((rows, p, p))
    for i in range(p):
        for j in range(i + 1):
            product = matrix.data[:, i, 0] * matrix.data[:, j, 0]
            square = scipy.sparse.csr_array(
                (product, matrix.indices, matrix.indptr), (rows, matrix.shape[1])
            )
            found[:, i, j] = found[:, j, i] = square @ weight
    return found


def kronecker_identity(line: Array, nodes: int, block: int) -> scipy.sparse.bsr_array:
    """``line (x) I``, shape (layer * node * block,) * 2, in blocks of that size."""
    layers = len(line)
    data = np.broadcast_to(line[:, None, :], (layers, nodes, layers)).reshape(-1, 1, 1)
    columns = np.arange(nodes)[:, None] + nodes * np.arange(layers)
    indices = np.broadcast_to(columns, (layers, nodes, layers)).ravel()
    indptr = layers * np.arange(layers * nodes + 1)
    size = layers * nodes * block
    return scipy.sparse.bsr_array((data * np.eye(block), indices, indptr), shape=(size, size))
