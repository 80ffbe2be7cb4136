"""`volume=points`: points that were digitised on the structure, connected to triangles."""

from __future__ import annotations

from dataclasses import dataclass, field

from omegaconf import MISSING

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.io.points_file import read_points
from sldvexp.volume.base import Volume, vector
from sldvexp.volume.surface import Surface
from sldvexp.volume.triangulation import triangulated


@register("volume", "points")
@dataclass
class Points(Volume):
    """The Delaunay triangulation of digitised points in their best-fit plane (Section 5.3.3).

    Parameters
    ----------
    path : str
        ``.csv`` with the columns ``x_m,y_m,z_m`` (or another unit), one line a point, in any
        order; other columns are left alone.
    towards : list of 3 float
        The side of the points to which the normals point, in the points' own axes.
    slivers : float
        Triangles along the rim whose height is below this part of their longest side are left
        out: they fill the dents of a rim that was digitised by hand. 0 keeps all.
    """

    path: str = MISSING
    towards: list[float] = field(default_factory=lambda: [0.0, 0.0, 1.0])
    slivers: float = 0.1

    def check(self, checks: Checks) -> None:
        """Note what cannot be."""
        vector(checks, "towards", self.towards)
        checks.require(any(self.towards), "towards", "must be a direction, not zero")
        message = f"must be from 0 to 0.5, not {self.slivers}"
        checks.require(0 <= self.slivers <= 0.5, "slivers", message)

    def inputs(self) -> list[str]:
        """The digitised points."""
        return [self.path]

    def surface(self) -> Surface:
        """The triangulated points."""
        position, line = read_points(path := locate(self.path))
        return triangulated(position, line, str(path), self.towards, self.slivers)
