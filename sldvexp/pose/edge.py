"""`pose=edge`: maximum likelihood straight from all edge points, without a conic in between."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from sldvexp.config.registry import register
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.from_scans import FromScans
from sldvexp.targets.base import Target


@register("pose", "edge")
@dataclass
class Edge(FromScans):
    """Every edge point's beam must meet its circle's rim; the poses that do so best.

    The two-mirror model is exact here, while the image of a circle is a conic only nearly. All
    views are adjusted together, since they share the circles and their machining errors.
    """

    name: ClassVar[str] = "edge"

    def estimate(
        self, laser: TwoMirror, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> dict[str, xr.Dataset]:
        """The group ``pose`` of all scanned views."""
        from sldvexp.pose.from_edges import estimate

        return {"pose": estimate(self, laser, target, tree)}
