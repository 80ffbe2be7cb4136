"""`pose=digitizer`: pose from points digitised on the object and on the instrument itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from omegaconf import MISSING

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.pose.base import PoseMethod
from sldvexp.units import LengthUnit

if TYPE_CHECKING:
    import xarray as xr

    from sldvexp.laser.two_mirror import TwoMirror
    from sldvexp.targets.base import Target


@register("pose", "digitizer")
@dataclass
class Digitizer(PoseMethod):
    """Rigid transform from repeated triples on the object and on the instrument (Section 4.6.3).

    Parameters
    ----------
    path : str
        Digitised points in the digitizer's own axes, every point several times: a ``.csv`` with
        the columns ``point,x_m,y_m,z_m`` (or another unit), or a plain table of x y z (``.sev``)
        with the instrument's points first, then the object's, each with all its repeats together.
    unit : LengthUnit
        Of a plain table, and of the points below.
    instrument_points : dict of str to list of float
        Where the digitised posts stand in the laser frame, ``{low: [x, y, z], med: ...}``.
    object_points : dict of str to list of float
        Where the digitised points of the object stand in the world.
    view : str
        Name of the view.
    confidence : float
        Level of the intervals.
    """

    path: str = MISSING
    unit: LengthUnit = LengthUnit.m
    instrument_points: dict[str, list[float]] = field(default_factory=dict)
    object_points: dict[str, list[float]] = field(default_factory=dict)
    view: str = "digitizer"
    confidence: float = 0.95

    def __post_init__(self) -> None:
        checks = Checks()
        checks.probability("confidence", self.confidence)
        checks.require(bool(self.view.strip()), "view", "must be a name")
        for name in ("instrument_points", "object_points"):
            points = getattr(self, name)
            enough = f"needs at least three points, not {len(points)}"
            checks.require(len(points) >= 3, name, enough)
            for label, xyz in points.items():
                wrong = f"must be three coordinates, not {len(xyz)}"
                checks.require(len(xyz) == 3, f"{name}.{label}", wrong)
                checks.finite(f"{name}.{label}", *xyz)
        both = set(self.instrument_points) & set(self.object_points)
        message = f"has names that object_points has too: {', '.join(sorted(both))}"
        checks.require(not both, "instrument_points", message)
        checks.done()

    def inputs(self) -> list[str]:
        """The digitised points."""
        return [self.path]

    def estimate(
        self, laser: TwoMirror, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> dict[str, xr.Dataset]:
        """The group ``pose``: mean and spread of the poses of the single repeats."""
        from sldvexp.pose.triples import estimate

        return {"pose": estimate(self)}
