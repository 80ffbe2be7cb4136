"""`reconstruction=shell`: the motion of a thin shell by Love's kinematics, from splines.

The measured face moves with the middle surface as its slopes turn the normal. So what is known of w
to a few hundredths of a percent tells most of the motion along the surface too, and of its strain;
what stretches the middle surface besides is found as far as the data show it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.shell.method import SurfaceReconstruction


@register("reconstruction", "shell")
@dataclass
class Shell(SurfaceReconstruction):
    """Thin shell: w with penalised fourth derivatives, u0 and v0 of the middle with a proper prior.

    Parameters
    ----------
    membrane_length : float, m, optional
        Over which the middle surface's own motion along itself varies; two thirds of the longer
        side without it.
    membrane_level : float
        Level at which images reject a motion of the middle surface along itself: where poses are
        adjusted, bounds hold the largest one that they do not reject. With 1 bounds are those of
        an average over all such motions, in which one too small to be found counts as none.

    Examples
    --------
    >>> from sldvexp.shell import Shell
    >>> Shell().poses.name
    'adjust'
    """

    membrane_length: float | None = None
    membrane_level: float = 0.01

    of_middle: ClassVar[bool] = True

    def _check(self, checks: Checks) -> None:
        if self.membrane_length is not None:
            checks.positive("membrane_length", self.membrane_length)
        message = f"must be above 0 and at most 1, not {self.membrane_level}"
        checks.require(0 < self.membrane_level <= 1, "membrane_level", message)
