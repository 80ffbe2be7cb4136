"""`reconstruction=spline`: three smooth fields on the face, each by itself.

For structures that are not thin, or to see what the data say without any assumption on how a shell
moves: bounds of the motion along the surface are wider than `shell`'s, those of strains much wider.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.shell.method import PoseTreatment, SurfaceReconstruction


@register("reconstruction", "spline")
@dataclass
class Spline(SurfaceReconstruction):
    """Free splines of u, v and w, with penalised third derivatives of u and v.

    Poses are not adjusted with them: a pose that is off and a smooth motion along the surface look
    alike.

    Examples
    --------
    >>> from sldvexp.shell import Spline
    >>> Spline().poses.name
    'propagate'
    """

    membrane_cells: int = 10
    poses: PoseTreatment = PoseTreatment.propagate

    of_middle: ClassVar[bool] = False

    def _check(self, checks: Checks) -> None:
        message = "must be propagate: free splines cannot tell a turned view from a smooth motion"
        checks.require(self.poses is PoseTreatment.propagate, "poses", message)
