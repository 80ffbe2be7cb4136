"""`pose=edge`: maximum likelihood straight from all edge points, without a conic in between."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sldvexp.errors import Checks
from sldvexp.pose.registration import FromPoints
from sldvexp.registry import register

if TYPE_CHECKING:
    import xarray as xr

    from sldvexp.laser.two_mirror import TwoMirror
    from sldvexp.target.base import Target


@register("pose", "edge")
@dataclass
class Edge(FromPoints):
    """Every edge point's beam must meet its circle's rim; the pose that does so best.

    The two-mirror model is exact here, while the image of a circle is a conic only nearly. Of the
    intrinsics, `adjust` may name the mirror offset.
    """

    def _check(self, checks: Checks) -> None:
        super()._check(checks)
        others = [name for name in self.adjust if name != "mirror_offset"]
        message = f"pose=edge adjusts mirror_offset only, not {', '.join(others)}"
        checks.require(not others, "adjust", message)

    def estimate(
        self, laser: TwoMirror, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> dict[str, xr.Dataset]:
        """The group ``pose`` of all scanned views."""
        from sldvexp.pose.from_edges import estimate

        return {"pose": estimate(self, laser, target, tree)}
