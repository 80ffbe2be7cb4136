"""Error of a field because its samples lie between pixels, estimated by cross-validation.

Near each pixel interpolation is off by an error that predictions of pixels from their neighbours
tell, ``e_k = E_k v_k``; see `sldvexp.image.interpolation.cross_validation`. A field of such errors
instead of velocities is what they do to the nodal values, sign and all: views that see the same
wave err together. It depends on the frequencies through the modes of the data alone.
"""

from __future__ import annotations

from sldvexp.field.visibility.visibility import VolumeVisibility
from sldvexp.typing import Array


def interpolation_errors(visibility: VolumeVisibility, data: list[Array]) -> list[Array] | None:
    """Estimate errors of every view's interpolation, interpolated minus true, near its pixels.

    Parameters
    ----------
    data : list of ndarray, shape (pixel, mode), m/s
        Velocities of each view's pixels.

    Returns
    -------
    list of ndarray, shape (pixel, mode), m/s, optional
        As columns of the equations they lead to the error of nodal values; None if no pixel tells.
    """
    matrices = visibility.interpolation_errors
    if not any(matrix.nnz for matrix in matrices):
        return None
    return [matrix @ velocity for matrix, velocity in zip(matrices, data, strict=True)]
