"""`pose=bitangent`: the dissertation's automated pose from bitangent points of fitted conics."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sldvexp.pose.registration import FromPoints
from sldvexp.registry import register

if TYPE_CHECKING:
    import xarray as xr

    from sldvexp.laser.two_mirror import TwoMirror
    from sldvexp.pose.solver import PoseSolution
    from sldvexp.target.base import Target


#: Probability of residuals below which they are noted.
UNLIKELY = 1e-4


@register("pose", "bitangent")
@dataclass
class Bitangent(FromPoints):
    """Conics through the edges, their bitangent points, and the pose from these (4.4.4.2).

    Parameters
    ----------
    pinhole : bool
        Fit the conics in coordinates in which the image of a circle is an ellipse but for the
        mirror offset. With false they are fitted in DAC steps, as the dissertation does.
    """

    pinhole: bool = True

    def estimate(
        self, laser: TwoMirror, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> dict[str, xr.Dataset]:
        """Groups ``registration`` and ``pose`` of all scanned views."""
        from sldvexp.pose.bitangent_bounds import with_shared_errors
        from sldvexp.pose.from_points import estimate
        from sldvexp.pose.images import (
            circles_of,
            edge_views,
            image_notes,
            match_images,
            registration_table,
        )
        from sldvexp.session.circles import edges_of

        circles = circles_of(target, "bitangent")
        images = [
            match_images(view, edges_of(group), circles, laser, self.pinhole)
            for view, group in edge_views(tree, "bitangent").items()
        ]
        tables = [registration_table(i, circles) for i in images]

        notes = [n for i in images for n in image_notes(i)]

        def judge(view: int, solution: PoseSolution) -> PoseSolution:
            image = images[view]
            judged, probability = with_shared_errors(solution, image.bitangents, circles, laser)
            if probability < UNLIKELY:
                notes.append(
                    f"view {image.view}: the residuals are larger than the edges' noise and the "
                    "circles' accuracy explain, so that the bounds are too small; a mirror offset "
                    "or calibration that is not the true one, or pinhole: false, looks like this"
                )
            return judged

        groups = estimate(self, tables, laser, None, judge=judge)
        kept = str(groups["pose"].attrs["notes"]).splitlines()
        groups["pose"].attrs["notes"] = "\n".join([*notes, *kept])
        return groups
