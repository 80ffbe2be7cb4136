"""Images of the object's circles in one view: matched, as registration data, with their errors.

A conic is fitted to each circle's edge; the object tells which circle each conic is, and the
bitangents of the conics give image points of the object's bitangent points (Sections 4.5.2, 4.5.3).

These points share errors: four lie on each fitted ellipse and share its five numbers, four on each
machined circle and share its centre, diameter and height. Taken as independent they would make the
pose's bounds too small by a factor of two; see `sldvexp.pose.correlated_errors`.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from sldvexp.errors import UserError
from sldvexp.geometry import BitangentPoints, Ellipse
from sldvexp.image import ScanLineEdges, fit_circle
from sldvexp.image.matching import Match, bitangent_images, match_circles
from sldvexp.image.pinhole import blur, dac_bitangents, dac_edges
from sldvexp.io.registration import RegistrationTable
from sldvexp.laser import TwoMirror
from sldvexp.pose.correlated_errors import Errors, with_errors
from sldvexp.pose.pointing import CircleFit, Pointing, find_pointing, widen_edges
from sldvexp.pose.solution import PoseSolution
from sldvexp.targets import Circles, std_of_bound
from sldvexp.typing import Array

#: Change of a circle's number for its derivative, as a part of the circle's diameter.
SMALL = 1e-5


@dataclass(frozen=True)
class CircleImages:
    """Edges of one view's circles, matched to the calibration object.

    Parameters
    ----------
    edges : dict of int to ScanLineEdges
        By the circle's number, in DAC steps, freed from the spot's size; outliers left out. Their
        standard errors have pointing noise in them.
    bitangents : BitangentPoints
        Image points of the selected pairs, DAC steps.
    pointing : Pointing
        Noise of the mirrors, in the order of the ellipses that `match` has.
    ellipses : dict of int to Ellipse
        The conics by the circle's number, in the coordinates in which they were fitted.
    blur : dict of int to float
        Width of the edges over the conic's smaller semi-axis, by the circle's number.
    """

    view: str
    edges: dict[int, ScanLineEdges]
    bitangents: BitangentPoints
    match: Match
    pointing: Pointing
    ellipses: dict[int, Ellipse] = field(default_factory=dict)
    blur: dict[int, float] = field(default_factory=dict)


def match_images(
    view: str,
    edges: list[ScanLineEdges],
    target: Circles,
    laser: TwoMirror,
    pointing: Pointing | None = None,
) -> CircleImages:
    """Fit a conic to each circle's image and find out which circle it is.

    Parameters
    ----------
    edges : list of ScanLineEdges
        Of the circles in any order, DAC steps.
    pointing : Pointing, optional
        Noise of the mirrors, if it is known already. Conics are then fitted in DAC steps, else in
        coordinates where the image of a circle is an ellipse.

    Raises
    ------
    UserError
        If a circle makes no ellipse or the ellipses fit the object in no way or in two.
    """
    pinhole = pointing is None
    try:
        if pointing is None:
            pointing, fits = find_pointing(edges, laser)
        else:
            fits = [fit_circle(e) for e in widen_edges(edges, pointing.std)]
        ellipses = [fit.ellipse for fit, _ in fits]
        match = match_circles(target, ellipses)
        found = bitangent_images(ellipses, match, target.selected_pairs())
    except UserError as error:
        raise UserError(f"view {view}: {error}") from None
    if pinhole:
        found = dac_bitangents(laser, found)
    freed = {n: _used(fits[k]) for n, k in match.ellipse.items()}
    return CircleImages(
        view,
        {n: dac_edges(laser, e) for n, e in freed.items()} if pinhole else freed,
        found,
        match,
        pointing,
        {n: ellipses[k] for n, k in match.ellipse.items()},
        {n: blur(*fits[k]) for n, k in match.ellipse.items()},
    )


def registration_table(images: CircleImages, target: Circles) -> RegistrationTable:
    """Give the view's bitangent points as registration data, with the object's numbering."""
    points = target.points()
    # (pair, line, circle, mirror) to the numbering a left, a right, b left, b right.
    external = images.bitangents.points[:, :2].swapaxes(1, 2).reshape(-1, 2)
    return RegistrationTable(
        name=images.view, number=points.number, object_point=points.position, dac=external
    )


def _used(fitted: CircleFit) -> ScanLineEdges:
    """Keep the edges that are no outliers."""
    fit, edges = fitted
    parts = ["position", "std", "direction", "width", "line", "rising", "phase"]
    parts += [p for p in ("reach", "growth_std") if getattr(edges, p) is not None]
    return replace(edges, **{p: getattr(edges, p)[fit.used] for p in parts})


def bitangent_errors(images: CircleImages, target: Circles) -> Errors:
    """Say where one view's selected points err: by its ellipses and by the circles."""
    return Errors(
        view=images.view,
        points=target.points().position,
        of_image=_of_images(images.bitangents),
        of_object=std_of_bound(target.accuracy) * _by_circles(_Known(repr(target), target)),
        noise_dof=images.pointing.dof,
    )


def with_shared_errors(
    solution: PoseSolution, images: CircleImages, target: Circles, laser: TwoMirror
) -> tuple[PoseSolution, float]:
    """Give one view's pose the covariance that follows from ellipses and circles.

    Parameters
    ----------
    solution : PoseSolution
        From the target's selected points; adjusted intrinsics are taken as free.

    Returns
    -------
    solution : PoseSolution
        Its covariance is known, not estimated from the residuals.
    probability : float
        Of residuals this large, if ellipses and circles are the only sources of error.
    """
    errors = bitangent_errors(images, target)
    adjust = dict.fromkeys(solution.parameters[6:], np.inf)
    known, _, probability = with_errors([solution], [errors], laser, adjust, {})
    return known[0], probability[0]


def _of_images(bitangents: BitangentPoints) -> Array:
    """Take the selected image points' covariance in the object's numbering, shape (2N, 2N)."""
    # (pair, line, ellipse, mirror) twice; the external lines; numbered a left, a right, b left ...
    joint = bitangents.covariance[:, :2][:, :, :, :, :, :2]
    joint = joint.transpose(0, 2, 1, 3, 4, 6, 5, 7)
    size = int(np.prod(joint.shape[:4]))
    return joint.reshape(size, size)


@dataclass(frozen=True)
class _Known:
    """Calibration object, known by what it says of itself."""

    told: str
    target: Circles = field(compare=False)


@lru_cache(maxsize=1)
def _by_circles(known: _Known) -> Array:
    """Differentiate the selected points by each circle's numbers, shape (N, 3, 4 * circles).

    Per unit of the target: the centre's x and y, the diameter, and the height above the plane. All
    views of a run see the same object.
    """
    target = known.target
    position = target.points().position
    touched = np.array([[a, a, b, b] for a, b in target.selected_pairs()]).ravel()
    columns = []
    for number, circle in target.circles.items():
        step = SMALL * circle.diameter
        for name in ("x", "y", "diameter"):
            moved = replace(circle, **{name: getattr(circle, name) + step})
            other = replace(target, circles={**target.circles, number: moved})
            columns.append((other.points().position - position) / step)
        normal = target.planes[circle.plane].axes()[2] * target.unit.value
        columns.append(np.where((touched == number)[:, None], normal, 0.0))
    return np.stack(columns, axis=-1)
