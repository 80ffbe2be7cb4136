"""`check=surface_depth`: where in the volume the views agree best, which is the real surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from sldvexp.check.base import Check, Examined
from sldvexp.errors import Checks
from sldvexp.registry import register

if TYPE_CHECKING:
    import xarray as xr


@register("check", "surface_depth")
@dataclass
class SurfaceDepth(Check):
    """Depth of the vibrating surface in the volume, without any geometry.

    At each sample the views' velocities fit one vector only if the sample lies on the surface;
    elsewhere every view sees another place of it. The misfit grows with the square of the distance,
    so that a parabola through it has its minimum there. How the minimum scatters between parts of
    the surface is its uncertainty, whatever its cause.

    Parameters
    ----------
    parts : int
        Into how many parts the surface is cut for the uncertainty.
    confidence : float
        Level of the interval.
    """

    parts: int = 16
    confidence: float = 0.95

    def __post_init__(self) -> None:
        checks = Checks()
        checks.require(self.parts >= 4, "parts", f"must be at least 4, not {self.parts}")
        checks.probability("confidence", self.confidence)
        checks.done()

    def examine(self, run: Examined) -> xr.Dataset:
        """``depth`` along the normals with bounds, and ``misfit`` at every sampled depth.

        Raises
        ------
        UserError
            If there is no field, fewer than four views, or no minimum inside of the volume.
        """
        from sldvexp import dataset
        from sldvexp.check.agreement import agreement, best_depth
        from sldvexp.statistics.student import student_factor

        found = agreement(run, self.parts)
        depth, std, dof = best_depth(found)

        return dataset.group(
            "examined/surface_depth",
            {"sample_depth": found.depth},
            depth=depth,
            depth_std=std,
            depth_confidence=std * float(student_factor(self.confidence, dof)),
            misfit=found.misfit.sum(axis=0) / found.freedom.sum(axis=0),
        )
