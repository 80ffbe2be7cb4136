"""What bitangent points are worth: their errors are shared by ellipse and by circle.

Four points lie on each fitted ellipse and share its five numbers; four on each machined circle and
share its errors. Taking them as independent would make the pose's bounds too small by a factor of
two. The least-squares pose ``P r`` of residuals r with covariance C has the covariance ``P C P^T``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from sldvexp.geometry.bitangent import Bitangents
from sldvexp.geometry.rotation import skew
from sldvexp.laser.model import project, project_jacobian
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.pose.solver import PoseSolution
from sldvexp.target.base import std_of_bound
from sldvexp.target.circles import Circles

Array = NDArray[np.float64]

#: Change of a circle's number for its derivative, as a part of the circle's diameter.
SMALL = 1e-5


def with_shared_errors(
    solution: PoseSolution, bitangents: Bitangents, target: Circles, laser: TwoMirror
) -> tuple[PoseSolution, float]:
    """The same pose with the covariance that follows from ellipses and circles.

    Parameters
    ----------
    solution : PoseSolution
        Of one view, from the target's selected points.
    bitangents : Bitangents
        Of the selected pairs, DAC steps.
    target : Circles
    laser : TwoMirror

    Returns
    -------
    solution : PoseSolution
        Its covariance is known, not estimated from the residuals.
    probability : float
        Of residuals this large, if ellipses and circles are the only sources of error.
    """
    points = target.points().position
    in_laser = (points - solution.origin) @ solution.rotation.T
    by_point, by_offset = project_jacobian(in_laser, solution.intrinsics["mirror_offset"])
    by_point = by_point / laser.step[:, None]
    # A small rotation moves a point P by w x P, a displaced origin by -R dO.
    by_rotation = np.einsum("nij,njk->nik", by_point, -skew(in_laser))
    by_origin = -by_point @ solution.rotation
    angle = project(in_laser, solution.intrinsics["mirror_offset"])
    adjusted = [
        _by_intrinsic(name, angle, by_offset)[..., None] / laser.step[:, None]
        for name in solution.parameters[6:]
    ]
    jacobian = np.concatenate([by_rotation, by_origin, *adjusted], axis=-1)
    jacobian = jacobian.reshape(2 * len(points), -1)
    by_object = np.einsum("nij,jk,nkc->nic", by_point, solution.rotation, _by_circles(target))
    by_object = by_object.reshape(2 * len(points), -1)
    shared = std_of_bound(target.accuracy) ** 2 * by_object @ by_object.T
    gain = np.linalg.pinv(jacobian)  # a prior is left out: bounds are then on the safe side
    of_points = _of_images(bitangents) + shared
    left = np.eye(len(jacobian)) - jacobian @ gain
    probability = _probability(solution.residual.ravel(), left @ of_points @ left)
    covariance = gain @ of_points @ gain.T
    return replace(solution, covariance=covariance, noise_known=True), probability


def _probability(residual: Array, covariance: Array) -> float:
    """Of a larger sum of squares of correlated normal residuals, after Satterthwaite."""
    expected = np.trace(covariance)
    dof = expected**2 / np.sum(covariance**2)
    return float(chdtrc(dof, dof * residual @ residual / expected))


def _of_images(bitangents: Bitangents) -> Array:
    """Covariance of the selected image points, in the object's numbering, shape (2N, 2N)."""
    # (pair, line, ellipse, mirror) twice; the external lines; numbered a left, a right, b left ...
    joint = bitangents.covariance[:, :2][:, :, :, :, :, :2]
    joint = joint.transpose(0, 2, 1, 3, 4, 6, 5, 7)
    size = int(np.prod(joint.shape[:4]))
    return joint.reshape(size, size)


def _by_circles(target: Circles) -> Array:
    """Change of the selected points with each circle's numbers, shape (N, 3, 4 * circles).

    Per unit of the target: the centre's x and y, the diameter, and the height above the plane.
    """
    position = target.points().position
    touched = np.array([[a, a, b, b] for a, b in target.selected_pairs()]).ravel()
    columns = []
    for number, circle in target.circles.items():
        step = SMALL * circle.diameter
        for name in ("x", "y", "diameter"):
            moved = replace(circle, **{name: getattr(circle, name) + step})
            other = replace(target, circles={**target.circles, number: moved})
            columns.append((other.points().position - position) / step)
        normal = target.planes[circle.plane].axes()[2] * target.unit.value
        columns.append(np.where((touched == number)[:, None], normal, 0.0))
    return np.stack(columns, axis=-1)


def _by_intrinsic(name: str, angle: Array, by_offset: Array) -> Array:
    """Change of the recorded angles, (angle - zero) / gain, with an intrinsic near its nominal."""
    if name == "mirror_offset":
        return by_offset
    what, _, mirror = name.partition("_")
    column = ("up_down", "left_right").index(mirror)
    change = np.zeros_like(angle)
    change[:, column] = -angle[:, column] if what == "gain" else -1.0
    return change
