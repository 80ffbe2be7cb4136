"""`pose=bitangent`: the dissertation's automated pose from bitangent points of fitted conics.

Where the errors of bitangent points come from: they share ellipses, and the object's circles.

Four points lie on each fitted ellipse and share its five numbers; four on each machined circle and
share its errors. Taking them as independent would make the pose's bounds too small by a factor of
two.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from sldvexp.config.registry import register
from sldvexp.geometry.bitangent import BitangentPoints
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.correlated_errors import Errors, with_errors
from sldvexp.pose.from_points import estimate
from sldvexp.pose.from_scans import FromScans, circles_of, registration_table
from sldvexp.pose.single_view import PoseSolution
from sldvexp.targets.base import Target, std_of_bound
from sldvexp.targets.circles import Circles
from sldvexp.typing import Array

#: Probability of residuals below which they are noted.
UNLIKELY = 1e-4


@register("pose", "bitangent")
@dataclass
class Bitangent(FromScans):
    """Conics through the edges, their bitangent points, and the pose from these (4.4.4.2).

    Parameters
    ----------
    pinhole : bool
        Fit the conics in coordinates in which the image of a circle is an ellipse but for the
        mirror offset. With false they are fitted in DAC steps, as the dissertation does.
    """

    name: ClassVar[str] = "bitangent"

    pinhole: bool = True

    def estimate(
        self, laser: TwoMirror, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> dict[str, xr.Dataset]:
        """Groups ``registration`` and ``pose`` of all scanned views."""
        circles = circles_of(target, self.name)
        images = self.images(circles, laser, tree, self.pinhole)
        tables = [registration_table(i, circles) for i in images]

        def judge(
            solutions: Sequence[PoseSolution],
        ) -> tuple[list[PoseSolution], Array, list[str]]:
            errors = [bitangent_errors(i.view, i.bitangents, circles) for i in images]
            judged, joint, probability = with_errors(
                solutions, errors, laser, self.adjust, self.shared
            )
            unlikely = [e.view for e, p in zip(errors, probability, strict=True) if p < UNLIKELY]
            notes = [
                f"view {view}: the residuals are larger than the edges' noise and the circles' "
                "accuracy explain, so that the bounds are too small; a mirror offset or "
                "calibration that is not the true one, or pinhole: false, looks like this"
                for view in unlikely
            ]
            return judged, joint, notes

        groups = estimate(self, tables, laser, None, judge=judge)
        kept = str(groups["pose"].attrs["notes"]).splitlines()
        groups["pose"].attrs["notes"] = "\n".join([*self.notes(images), *kept])
        return groups


#: Change of a circle's number for its derivative, as a part of the circle's diameter.
SMALL = 1e-5


def bitangent_errors(view: str, bitangents: BitangentPoints, target: Circles) -> Errors:
    """Of one view's selected points: from its ellipses and from the circles.

    Parameters
    ----------
    view : str
    bitangents : BitangentPoints
        Of the selected pairs, DAC steps.
    target : Circles
    """
    return Errors(
        view=view,
        points=target.points().position,
        of_image=_of_images(bitangents),
        of_object=std_of_bound(target.accuracy) * _by_circles(target),
    )


def with_shared_errors(
    solution: PoseSolution, bitangents: BitangentPoints, target: Circles, laser: TwoMirror
) -> tuple[PoseSolution, float]:
    """One view's pose with the covariance that follows from ellipses and circles.

    Parameters
    ----------
    solution : PoseSolution
        From the target's selected points; adjusted intrinsics are taken as free.
    bitangents : BitangentPoints
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
    errors = bitangent_errors("", bitangents, target)
    adjusted = dict.fromkeys(solution.parameters[6:], np.inf)
    judged, _, probability = with_errors([solution], [errors], laser, adjusted, {})
    return judged[0], probability[0]


def _of_images(bitangents: BitangentPoints) -> Array:
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
