"""Error of a field because its samples lie between pixels, estimated by cross-validation.

Near each pixel interpolation is off by an error that predictions of pixels from their neighbours
tell, ``e_k = E_k v_k``; see `sldvexp.image.interpolation.cross_validation`. A field of such errors
instead of velocities is what they do to the nodal values, sign and all: views that see the same
wave err together. It depends on the frequencies through the modes of the data alone.
"""

from __future__ import annotations

from sldvexp.field.equations.assembly import right_sides
from sldvexp.field.equations.regions import RegionIterator
from sldvexp.field.equations.system import NormalEquations, Solve, solution
from sldvexp.typing import Array


def interpolation_error(
    parts: RegionIterator, system: NormalEquations, solve: Solve, data: list[Array]
) -> Array | None:
    """Estimate the error of nodal values, interpolated minus true; None if no pixel tells.

    Parameters
    ----------
    data : list of ndarray, shape (pixel, mode), m/s
        Velocities of each view's pixels.

    Returns
    -------
    ndarray, shape (layer, surface_node, parameter, mode), m/s
    """
    matrices = parts.visibility.interpolation_errors
    if not any(matrix.nnz for matrix in matrices):
        return None
    errors = [matrix @ velocity for matrix, velocity in zip(matrices, data, strict=True)]
    return solution(right_sides(parts, errors), system, solve)
