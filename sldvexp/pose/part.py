"""`pose=part`: where the instrument stood, from the outline of the part that it measures.

The part's mesh tells the outline that a pose would show (`sldvexp.laser.outline`); edges that scan
lines found across it (``scan=outline``) tell where it is. Each view is solved for itself from its
rough pose (`sldvexp.pose.outline_fit`), and the world's axes are those of the mesh. Of other poses
that show the outline as well, the mirror image in depth of a flat part and the half turns of a
symmetric one are looked for and told.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from sldvexp import dataset
from sldvexp.config.registry import register
from sldvexp.dataset import Finding, Severity
from sldvexp.errors import Checks, UserError, nearest
from sldvexp.geometry import KnownPose
from sldvexp.laser import PartOutline, TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.base import PoseMethod, PoseResult, pose_to_dataset
from sldvexp.pose.from_points import no_pose, require_laser
from sldvexp.pose.from_scans import edge_views, with_failed
from sldvexp.pose.initial_pose import flipped
from sldvexp.pose.outline_fit import (
    OutlineEdges,
    OutlineFit,
    fit_likewise,
    fit_outline,
    half_turns,
    lack_of_fit,
    of_hysteresis,
    root_mean_square,
    shows,
)
from sldvexp.pose.raster_edges import raster_edges
from sldvexp.scan.base import check_rough_pose
from sldvexp.scan.outline import PartMesh
from sldvexp.session.outline import PART, PART_UNIT, ROUGH_ORIGIN, ROUGH_ROTATION
from sldvexp.targets import Target
from sldvexp.typing import Array
from sldvexp.units import LengthUnit

#: Probability that a right mesh is doubted, for all views together.
FALSE_ALARM = 0.01
#: How many times wider bounds may become; beyond it they are left, and void.
TOO_SMALL = 2.0
#: Share of edges beside the outline from which the poses are doubted.
MANY = 0.15
#: Rise of the cost from which another pose is refuted: 0.1 % of chi-square of 2.
REFUTED_RISE = 13.8
#: Cosine of the angle between two rotations, and distance in m, within which poses are one.
SAME, SAME_PLACE = 1 - 1e-5, 2e-3


class OtherPose(NamedTuple):
    """Another pose that shows the outline.

    Parameters
    ----------
    fit : OutlineFit
    turned : bool
        Whether it is that of a part that looks alike after half a turn.
    """

    fit: OutlineFit
    turned: bool


@register("pose", "part")
@dataclass
class Part(PartMesh, PoseMethod):
    """Pose of each view from edges on the outline of the part itself, without a calibration object.

    The mesh, its unit and the rough poses are those of ``scan=outline``. Edges beside the outline
    are left out and counted.

    Parameters
    ----------
    path : str
        Another mesh than that of the scan, in the same axes; with `views`, the mesh.
    unit : LengthUnit
        Of that.
    views : dict of str to KnownPose
        Rough poses of views whose velocity images (``scan=rectangle``) show the whole part before
        something that rests, in place of scanned outlines.
    hysteresis : float, rad
        By how much the angles differ that a mirror takes at one step from the two sides. Lines out
        of the part come from one side alone, so that the bounds have to be told of it.
    confidence : float
        Level of the intervals.
    """

    views: dict[str, KnownPose] = field(default_factory=dict)
    hysteresis: float = 5e-6
    confidence: float = 0.95

    def __post_init__(self) -> None:
        checks = Checks()
        checks.probability("confidence", self.confidence)
        checks.non_negative("hysteresis", self.hysteresis)
        if self.views:
            self.check_mesh(checks)
        for name, pose in self.views.items():
            check_rough_pose(checks, f"views.{name}", pose)
        checks.done()

    def estimate(
        self, laser: TwoMirror | None, target: Target | None, tree: Mapping[str, xr.Dataset]
    ) -> PoseResult:
        """Solve every view."""
        groups = self._rasters(tree) if self.views else _outlines(tree)
        laser = require_laser(laser)
        solved: dict[str, ViewOutline] = {}
        failed: dict[str, UserError] = {}
        for view, group in groups.items():
            try:
                part = self._part(view, group)
                one = _solved(view, group, part, laser)
                if not self.views:  # a raster's edges are known to a pixel at best
                    more = of_hysteresis(part, one.edges, laser, one.fit, self.hysteresis)
                    fit = one.fit._replace(covariance=one.fit.covariance + more)
                    one = replace(one, fit=fit)
                solved[view] = replace(one, raster=bool(self.views))
            except UserError as error:
                failed[view] = error
        if not solved:
            raise next(iter(failed.values()))
        judged = {view: _judged(one, len(solved)) for view, one in solved.items()}
        fits = [one.fit for one in solved.values()]
        pose = pose_to_dataset(
            [*solved],
            np.array([fit.rotation for fit in fits]),
            np.array([fit.origin for fit in fits]),
            np.array([covariance for covariance, _ in judged.values()]),
            np.array([fit.dof for fit in fits], float),
            self.confidence,
            residual_rms=np.array([root_mean_square(fit.residual[fit.used]) for fit in fits]),
            pointing_std=np.array([fit.pointing for fit in fits]),
            cost=np.array([fit.cost for fit in fits]),
        )
        pose = _with_others(pose, solved)
        pose.attrs["mirror_offset"] = laser.mirror_offset
        pose.attrs["step"] = laser.step
        pose.attrs["notes"] = "\n".join(note for one in solved.values() for note in one.notes())
        findings = [no_pose(view, str(error)) for view, error in failed.items()]
        pose = with_failed(pose, findings)
        findings += [f for _, told in judged.values() for f in told]
        return PoseResult(pose, findings=findings)

    def _rasters(self, tree: Mapping[str, xr.Dataset]) -> dict[str, xr.Dataset]:
        """Find the edges in the images of views that have rough poses."""
        groups = {}
        for view, pose in self.views.items():
            if f"image/{view}" not in tree:
                there = [name.removeprefix("image/") for name in tree if name.startswith("image/")]
                told = nearest(view, there) if there else "scan images, as with scan=rectangle"
                raise UserError(f"pose.views: there is no image of a view {view}; {told}")
            groups[view] = raster_edges(view, tree[f"image/{view}"])
            groups[view].attrs |= {
                PART: self.path,
                PART_UNIT: self.unit.name,
                ROUGH_ROTATION: pose.rotation.ravel(),
                ROUGH_ORIGIN: pose.place,
            }
        return groups

    def _part(self, view: str, group: xr.Dataset) -> PartOutline:
        """Read the mesh of a view's scan, or the own one."""
        scanned = PartMesh(str(group.attrs[PART]), LengthUnit[str(group.attrs[PART_UNIT])])
        mesh = PartMesh(self.path, self.unit) if self.path else scanned
        part = mesh.outline()
        mesh.require_size(part, [np.asarray(group.attrs[ROUGH_ORIGIN])])
        return part


@dataclass(frozen=True, eq=False)
class ViewOutline:
    """One view's edges and the pose that fits them.

    Parameters
    ----------
    others : list of OtherPose
        That fit as well as far as the edges can tell.
    raster : bool
        Whether the edges are those of an image.
    """

    view: str
    edges: OutlineEdges
    fit: OutlineFit
    others: list[OtherPose]
    raster: bool = False

    def notes(self) -> Iterator[str]:
        """Say what a reader should mind."""
        alike = sum(other.turned for other in self.others)
        if alike:
            places = f"{alike} other place" + ("s" if alike > 1 else "")
            yield (
                f"view {self.view}: after half a turn the part looks the same, so that {places} "
                "would fit as well; the rough pose decides"
            )


def _outlines(tree: Mapping[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    """Take the edges of outlines.

    Raises
    ------
    UserError
        If no outline was scanned.
    """
    told = (
        "pose=part needs scans of the part's outline: choose scan=outline, or scan=session with "
        "scan.outline, and an instrument that scans"
    )
    if not any(name.startswith("edge/") for name in tree):
        raise UserError(told)
    groups = edge_views(tree, "part")
    if any(PART not in group.attrs for group in groups.values()):
        raise UserError(told)
    return groups


def _solved(view: str, group: xr.Dataset, part: PartOutline, laser: TwoMirror) -> ViewOutline:
    """Solve one view from its rough pose, and from the poses that it could be mistaken for."""
    edges = OutlineEdges.from_dataset(group, laser)
    rotation = np.asarray(group.attrs[ROUGH_ROTATION]).reshape(3, 3)
    origin = np.asarray(group.attrs[ROUGH_ORIGIN])
    try:
        fit = fit_outline(part, edges, laser, rotation, origin)
    except UserError as error:
        raise UserError(f"view {view}: {error}") from None
    found = [fit]
    others = []
    for start, turned in _mistaken(part, fit):
        if turned and not shows(part, edges, laser, start):
            continue
        try:
            other = fit_likewise(part, edges, laser, start, fit)
        except UserError:
            continue
        if all(_differ(other, known) for known in found):
            found.append(other)
            others.append(OtherPose(other, turned))
    better = [o for o in others if not o.turned and o.fit.cost < fit.cost - REFUTED_RISE]
    if better:  # the rough pose led into the wrong valley
        fit = fit_outline(part, edges, laser, better[0].fit.rotation, better[0].fit.origin)
        return ViewOutline(view, edges, fit, [])
    return ViewOutline(
        view, edges, fit, [o for o in others if o.fit.cost < fit.cost + REFUTED_RISE]
    )


def _mistaken(part: PartOutline, fit: OutlineFit) -> Iterator[tuple[tuple[Array, Array], bool]]:
    """Give the poses that a part may be seen from as well: mirrored in depth, and half turns."""
    low, high = part.position.min(axis=0), part.position.max(axis=0)
    middle = (low + high) / 2
    centre = fit.rotation @ (middle - fit.origin)
    normal = np.linalg.svd(part.position - part.position.mean(axis=0))[2][2]
    mirrored = flipped(fit.rotation, centre, normal)
    yield (mirrored, middle - mirrored.T @ centre), False
    for turn in half_turns(part.position):
        yield (fit.rotation @ turn, middle + turn @ (fit.origin - middle)), True


def _differ(one: OutlineFit, other: OutlineFit) -> bool:
    """Tell whether two poses are not the same."""
    cosine = (np.trace(one.rotation @ other.rotation.T) - 1) / 2
    return bool(cosine < SAME or np.linalg.norm(one.origin - other.origin) > SAME_PLACE)


def _judged(one: ViewOutline, views: int) -> tuple[Array, list[Finding]]:
    """Give the covariance of a pose and what is to be said of its edges."""
    fit, where = one.fit, f"view {one.view}"
    covariance = fit.covariance
    findings = [*_beside(one, where)]
    # Edges of a raster err together, whatever the shape of the part.
    ratio, p_value = (1.0, 1.0) if one.raster else lack_of_fit(one.edges, fit)
    if p_value < FALSE_ALARM / views:
        wider = float(np.sqrt(ratio))
        void = wider > TOO_SMALL
        told = (
            f"bounds that had it in them would be {wider:.1f} times as wide: they are left, and "
            "void"
            if void
            else f"the bounds are made {wider:.1f} times as wide for it"
        )
        findings.append(
            Finding(
                "outline",
                where,
                f"{where}: neighbouring edges lie beside the outline of the mesh together, to "
                f"{root_mean_square(fit.residual[fit.used]):.2g} DAC steps rms, as if the part "
                f"had another shape or size, or the mirrors another calibration; {told}",
                Severity.void if void else Severity.doubtful,
                ratio,
                p_value,
                views=(one.view,),
            )
        )
        if not void:
            covariance = ratio * covariance
    mirrored = [other for other in one.others if not other.turned]
    if mirrored:
        x, y, z = mirrored[0].fit.origin
        findings.append(
            Finding(
                "other_pose",
                where,
                f"{where}: a second pose at ({x:.3f}, {y:.3f}, {z:.3f}) m shows the outline nearly "
                "as well; see the part more at a slant, or from nearer",
                Severity.doubtful,
                views=(one.view,),
            )
        )
    return covariance, findings


def _beside(one: ViewOutline, where: str) -> Iterator[Finding]:
    """Say which edges are left out."""
    out = int(np.sum(~one.fit.used))
    if not out:
        return
    share = out / len(one.fit.used)
    beside = np.abs(one.fit.residual[~one.fit.used])
    far = f", up to {np.nanmax(beside):.3g} DAC steps" if np.isfinite(beside).any() else ""
    yield Finding(
        "wrong_edges",
        where,
        f"{where}: {out} of {len(one.fit.used)} edges lie beside the outline{far}, and are left "
        "out",
        Severity.doubtful if share > MANY else Severity.note,
        size=share,
        views=(one.view,),
    )


def _with_others(pose: xr.Dataset, solved: Mapping[str, ViewOutline]) -> xr.Dataset:
    """Add the second pose of each view to the group ``pose``, NaN where there is none."""
    count = len(solved)
    rotation, origin = np.full((count, 3, 3), np.nan), np.full((count, 3), np.nan)
    cost, there = np.full(count, np.nan), np.zeros(count)
    for k, one in enumerate(solved.values()):
        mirrored = [other.fit for other in one.others if not other.turned]
        if mirrored:
            rotation[k], origin[k] = mirrored[0].rotation, mirrored[0].origin
            cost[k], there[k] = mirrored[0].cost, 1
    others = dataset.group(
        "pose",
        {"view": [*solved]},
        other_found=there,
        other_origin=origin,
        other_rotation=rotation,
        other_cost=cost,
    )
    return pose.merge(others)
