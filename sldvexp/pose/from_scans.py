"""Edges of a scanned calibration object: what all pose methods share that start from them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from sldvexp import dataset
from sldvexp.dataset import WITHOUT_POSE, Finding, Severity
from sldvexp.errors import UserError
from sldvexp.image.pinhole import WIDEST
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.circle_images import CircleImages, match_images, registration_table
from sldvexp.pose.from_points import FromPoints, no_pose
from sldvexp.pose.pointing import mirror_findings, pointing_findings
from sldvexp.pose.single_view import solve_points
from sldvexp.pose.wiring import check_wiring, phase_notes
from sldvexp.session.circles import edges_of
from sldvexp.targets import Circles, Target
from sldvexp.typing import Array

#: Part of a view's edges above which it is said that they were lost: scans in order lose 0 to 5 %.
MOST_LOST = 0.1
#: Advice to who loses many edges.
LONGER = "more samples or excitation at the edges: scan.calibration.sampling, or look at plot edges"


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
    ) -> tuple[list[CircleImages], list[Finding]]:
        """Match the circles' images in every view.

        A view that cannot be solved does not end the others.

        Parameters
        ----------
        tree : mapping of str to xarray.Dataset
            With the groups ``edge/<view>``.
        pinhole : bool
            Fit in coordinates where the image of a circle is an ellipse, instead of in DAC steps.

        Returns
        -------
        images : list of CircleImages
            Of the views that have a pose.
        failed : list of Finding
            One for each of the others.

        Raises
        ------
        UserError
            If nothing was scanned, or in every view the mirrors look wired wrongly, a circle makes
            no ellipse, or the ellipses fit the object in no way or in two.
        """
        found, failed = [], {}
        for view, group in edge_views(tree, self.name).items():
            try:
                found.append(self._images_of(view, group, circles, laser, pinhole))
            except UserError as error:
                failed[view] = error
        if not found:
            raise next(iter(failed.values()))
        return found, [no_pose(view, str(error)) for view, error in failed.items()]

    def _images_of(
        self, view: str, group: xr.Dataset, circles: Circles, laser: TwoMirror, pinhole: bool
    ) -> CircleImages:
        """Match one view's images, from which there is a pose to start from."""
        edges, adjusted = edges_of(group), self.adjust | self.shared
        images = check_wiring(view, edges, circles, laser, adjusted, self.upright)
        if not pinhole:
            images = match_images(view, edges, circles, laser, images.pointing)
        start_of(images, laser, circles)
        return images

    def notes(self, images: Sequence[CircleImages]) -> list[str]:
        """Say what to mind about the images of all views."""
        return phase_notes(images)

    def findings(
        self, images: Sequence[CircleImages], laser: TwoMirror, tree: Mapping[str, xr.Dataset]
    ) -> list[Finding]:
        """Say what the edges of all views tell about the mirrors and the circles."""
        own = [f for i in images for f in pointing_findings(i.view, i.pointing, i.match.ellipse)]
        lost = [f for i in images for f in lost_edges(i.view, tree[f"edge/{i.view}"])]
        wide = [f for i in images for f in too_wide(i.view, i.blur)]
        return [*mirror_findings({i.view: i.pointing for i in images}, laser), *own, *lost, *wide]


def lost_edges(view: str, group: xr.Dataset) -> list[Finding]:
    """Say that more edges of a view's circles were rejected than a scan in order loses.

    Parameters
    ----------
    group : xarray.Dataset
        ``edge/<view>``.
    """
    lost: dict[str, int] = json.loads(group.attrs.get("lost", "{}"))
    count = sum(lost.values())
    share = count / max(count + group.sizes["edge"], 1)
    if share <= MOST_LOST:
        return []
    why = ", ".join(f"{n} {reason}" for reason, n in lost.items())
    return [
        Finding(
            "edges",
            f"view {view}",
            f"view {view}: {100 * share:.0f} % of the edges of its circles were lost ({why}), "
            f"where {100 * MOST_LOST:.0f} % is much; its pose rests on the others",
            Severity.note,
            size=share,
            remedy=LONGER,
            views=(view,),
        )
    ]


def too_wide(view: str, blurs: Mapping[int, float]) -> Iterator[Finding]:
    """Say on which of a view's circles the spot is too wide to tell where their edges are.

    Parameters
    ----------
    blurs : mapping of int to float
        As in `sldvexp.pose.circle_images.CircleImages`.
    """
    for number, size in blurs.items():
        if size > WIDEST:
            yield Finding(
                "wide_spot",
                f"circle {number}",
                f"view {view}: the spot's 1/e^2 radius is {2 * size:.2g} times the smaller "
                f"semi-axis of the image of circle {number}, where {2 * WIDEST:.2g} is the most "
                "that tells where its edges are; the bounds are made wider for it; a larger "
                "circle, a beam focused nearer to it or a stand that sees it less at a slant "
                "would do",
                Severity.doubtful,
                size=size,
                views=(view,),
            )


def with_pointing(pose: xr.Dataset, images: Sequence[CircleImages]) -> xr.Dataset:
    """Add the mirrors' pointing noise in every view, and which circle is which, to ``pose``."""
    own = {i.view: i for i in images}
    found = [own[str(view)] for view in pose["view"].values]
    numbers = sorted(images[0].match.ellipse)
    more = dataset.group(
        "pose",
        {"view": pose["view"].values, "circle": numbers},
        pointing_std=[i.pointing.whole for i in found],
        # rough centres count from 1 (`sldvexp.session.circles.edges_to_dataset`)
        rough_centre=[[i.match.ellipse[n] + 1 for n in numbers] for i in found],
    )
    return pose.merge(more)


def start_of(images: CircleImages, laser: TwoMirror, circles: Circles) -> tuple[Array, Array]:
    """Solve for rotation and origin from one view's bitangent points."""
    table = registration_table(images, circles)
    try:
        start = solve_points(
            table.object_point,
            table.angle_through(laser),
            step=laser.step,
            mirror_offset=laser.mirror_offset,
        )
    except UserError as error:
        raise UserError(f"view {images.view}: {error}") from None
    return start.rotation, start.origin


def with_failed(pose: xr.Dataset, failed: Sequence[Finding]) -> xr.Dataset:
    """Name the views without a pose in the group ``pose``, so that their images are left out."""
    views = [view for f in failed for view in f.views]
    return pose.assign_attrs({WITHOUT_POSE: json.dumps(views)}) if views else pose


def edge_views(tree: Mapping[str, xr.Dataset], method: str) -> dict[str, xr.Dataset]:
    """Take the groups ``edge/<view>`` of a run, by view.

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
    """Take the target for circles; refuse any other."""
    if not isinstance(target, Circles):
        raise UserError(f"pose={method} needs a target of circles, for example target=dissertation")
    return target
