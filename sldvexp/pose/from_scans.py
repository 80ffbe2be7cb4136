"""What all pose methods share that start from scans of the calibration object.

What every pose method needs that starts from the edges of circles: views, conics, matching.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from sldvexp.errors import UserError
from sldvexp.geometry.bitangent import BitangentPoints
from sldvexp.image.matching import Match, bitangent_images, match_circles
from sldvexp.image.pinhole import dac_bitangents, dac_edges, fit_circle, pinhole_edges
from sldvexp.image.scan_lines import ScanLineEdges
from sldvexp.io.registration import RegistrationTable
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.registration import FromPoints
from sldvexp.session.circles import edges_of
from sldvexp.targets.base import Target
from sldvexp.targets.circles import Circles
from sldvexp.typing import BoolArray


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
            See `sldvexp.pose.from_scans.match_images`.

        Raises
        ------
        UserError
            If nothing was scanned, the mirrors look wired wrongly, or a circle makes no ellipse or
            the ellipses fit the object in no way or in two.
        """
        from sldvexp.pose.wiring import check_wiring

        found = []
        for view, group in edge_views(tree, self.name).items():
            edges, adjusted = edges_of(group), self.adjust | self.shared
            images = check_wiring(view, edges, circles, laser, adjusted, self.upright)
            if not pinhole:
                images = match_images(view, edges, circles, laser, pinhole)
            found.append(images)
        return found

    def notes(self, images: Sequence[CircleImages]) -> list[str]:
        """What to mind about the images of all views."""
        from sldvexp.pose.wiring import phase_notes

        return [*(n for i in images for n in image_notes(i)), *phase_notes(images)]


#: Residual of the conics, in standard errors of the edges, that is noted.
MISFIT = 3.0


@dataclass(frozen=True)
class CircleImages:
    """The edges of one view's circles, matched to the calibration object.

    Parameters
    ----------
    view : str
    edges : dict of int to ScanLineEdges
        By the circle's number, in DAC steps, freed from the spot's size; outliers left out.
    bitangents : BitangentPoints
        Image points of the selected pairs, DAC steps.
    match : Match
    misfit : float
        Root mean square of the conics' residuals over their standard errors.
    """

    view: str
    edges: dict[int, ScanLineEdges]
    bitangents: BitangentPoints
    match: Match
    misfit: float


def edge_views(tree: Mapping[str, xr.Dataset], method: str) -> dict[str, xr.Dataset]:
    """The groups ``edge/<view>`` of a run, by view.

    Raises
    ------
    UserError
        If nothing was scanned.
    """
    views = {k.removeprefix("edge/"): v for k, v in tree.items() if k.startswith("edge/")}
    if not views:
        raise UserError(
            f"pose={method} needs scans of the calibration object: choose scan=calibration and an "
            "instrument that scans, for example instrument=simulated scene=calibration"
        )
    return views


def circles_of(target: Target | None, method: str) -> Circles:
    """The target, if it is one of circles; UserError otherwise."""
    if not isinstance(target, Circles):
        raise UserError(f"pose={method} needs a target of circles, for example target=dissertation")
    return target


def match_images(
    view: str, edges: list[ScanLineEdges], target: Circles, laser: TwoMirror, pinhole: bool
) -> CircleImages:
    """Fit a conic to each circle's image and find out which circle it is.

    Parameters
    ----------
    view : str
    edges : list of ScanLineEdges
        Of the circles in any order, DAC steps.
    target : Circles
    laser : TwoMirror
    pinhole : bool
        Fit in coordinates where the image of a circle is an ellipse, instead of in DAC steps.

    Raises
    ------
    UserError
        If a circle makes no ellipse or the ellipses fit the object in no way or in two.
    """
    image = [pinhole_edges(laser, e) for e in edges] if pinhole else edges
    try:
        fits = [fit_circle(e) for e in image]
        ellipses = [fit.ellipse for fit, _ in fits]
        match = match_circles(target, ellipses)
        found = bitangent_images(ellipses, match, target.selected_pairs())
    except UserError as error:
        raise UserError(f"view {view}: {error}") from None
    if pinhole:
        found = dac_bitangents(laser, found)
    square = sum(fit.chi_square for fit, _ in fits)
    freedom = sum(fit.dof for fit, _ in fits)
    freed = {n: _used(fits[k][1], fits[k][0].used) for n, k in match.ellipse.items()}
    return CircleImages(
        view,
        {n: dac_edges(laser, e) for n, e in freed.items()} if pinhole else freed,
        found,
        match,
        float(np.sqrt(square / freedom)),
    )


def registration_table(images: CircleImages, target: Circles) -> RegistrationTable:
    """The view's bitangent points as registration data, with the object's numbering."""
    points = target.points()
    # (pair, line, circle, mirror) to the numbering a left, a right, b left, b right.
    external = images.bitangents.points[:, :2].swapaxes(1, 2).reshape(-1, 2)
    return RegistrationTable(
        name=images.view, number=points.number, object_point=points.position, dac=external
    )


def image_notes(images: CircleImages) -> list[str]:
    """What to mind about a view's images."""
    notes = []
    if images.misfit > MISFIT:
        notes.append(
            f"view {images.view}: the edges lie {images.misfit:.1f} standard errors beside their "
            "ellipses; circles that hide one another, or that move unevenly, look like this"
        )
    return notes


def _used(edges: ScanLineEdges, used: BoolArray) -> ScanLineEdges:
    """The edges that are no outliers."""
    parts = ("position", "std", "direction", "width", "line", "rising", "phase")
    return replace(edges, **{p: getattr(edges, p)[used] for p in parts})
