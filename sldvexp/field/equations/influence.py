"""From pixels to the right-hand sides of a field: sparse matrices, ``b = sum_k R_k v_k``."""

from __future__ import annotations

from sldvexp.field.equations.elements import Patch
from sldvexp.lazy import scipy
from sldvexp.typing import Array


def influence(
    patch: Patch, estimator: Array, weights: scipy.sparse.csr_array
) -> scipy.sparse.bsr_array:
    """``R = sum_s B_s^T (x) T_s W_s`` of one view over a patch.

    Parameters
    ----------
    patch : Patch
    estimator : ndarray, shape (sample, parameter)
        The view's column of T_s.
    weights : csr_array, shape (sample, pixel)
        Of the pixels' velocities.

    Returns
    -------
    bsr_array, shape (node * parameter, pixel), blocks (parameter, 1)
    """
    basis = patch.transposed
    parameters = estimator.shape[1]
    data = patch.shape.ravel()[basis.data, None] * estimator[basis.indices]
    shape = (patch.count * parameters, len(estimator))
    if not estimator.any():  # the rows leave this view out
        return scipy.sparse.bsr_array((shape[0], weights.shape[1]), blocksize=(parameters, 1))
    return (
        scipy.sparse.bsr_array((data[..., None], basis.indices, basis.indptr), shape=shape)
        @ weights
    )
