"""What all pose methods share that start from scans of the calibration object."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.images import CircleImages, edge_views, image_notes, match_images
from sldvexp.pose.registration import FromPoints
from sldvexp.session.circles import edges_of
from sldvexp.targets.circles import Circles


@dataclass
class FromScans(FromPoints):
    """Edges of circles are matched to the object once mirrors that are wired wrongly are excluded.

    Parameters
    ----------
    upright : bool
        Whether the instrument stands upright before an object whose y axis points up, within
        60 deg. Two inverted mirrors can be recognised by nothing else.

    Attributes
    ----------
    name : str
        Of the method, for messages.
    """

    name: ClassVar[str]

    upright: bool = True

    def images(
        self,
        circles: Circles,
        laser: TwoMirror,
        tree: Mapping[str, xr.Dataset],
        pinhole: bool,
    ) -> list[CircleImages]:
        """The circles' images in every view.

        Parameters
        ----------
        circles : Circles
        laser : TwoMirror
        tree : mapping of str to xarray.Dataset
            With the groups ``edge/<view>``.
        pinhole : bool
            See `sldvexp.pose.images.match_images`.

        Raises
        ------
        UserError
            If nothing was scanned, the mirrors look wired wrongly, or a circle makes no ellipse or
            the ellipses fit the object in no way or in two.
        """
        from sldvexp.pose.wiring import recognised

        found = []
        for view, group in edge_views(tree, self.name).items():
            edges, adjusted = edges_of(group), self.adjust | self.shared
            images = recognised(view, edges, circles, laser, adjusted, self.upright)
            if not pinhole:
                images = match_images(view, edges, circles, laser, pinhole)
            found.append(images)
        return found

    def notes(self, images: Sequence[CircleImages]) -> list[str]:
        """What to mind about the images of all views."""
        from sldvexp.pose.wiring import phase_notes

        return [*(n for i in images for n in image_notes(i)), *phase_notes(images)]
