"""Stands that are given: those of a run that is done, or of a configuration, with their images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.config.experiment import Experiment
from sldvexp.dataset import RunData
from sldvexp.errors import UserError
from sldvexp.field.visibility.view import View, views_of
from sldvexp.geometry import KnownPose
from sldvexp.planner.images import Stand, empty_image, held_by, known_stand, looked_at, raster_of
from sldvexp.planner.place import Place
from sldvexp.pose.given import Given
from sldvexp.scan.rectangle import Rectangle
from sldvexp.scan.session import Session
from sldvexp.typing import Array, IntArray

#: Part of the surface's nodes that a box holds at least whose corners are of that stand.
HELD = 0.9


@dataclass(frozen=True, eq=False)
class GivenStands:
    """Stands that are there already.

    Attributes
    ----------
    stands : tuple of Stand
    images : tuple of View
        Pixels of each, still empty.
    noise : float, m/s, or None
        Standard error of a pixel's velocity, where images tell it.
    """

    stands: tuple[Stand, ...]
    images: tuple[View, ...]
    noise: float | None = None


NOBODY = GivenStands((), ())


def of_run(run: RunData, experiment: Experiment, place: Place) -> GivenStands:
    """Take the stands that a run has poses and images of.

    Raises
    ------
    UserError
        If it has none.
    """
    views = views_of(dict(run.groups), place.laser)
    stands = tuple(_stand(v.name, v.origin, v.rotation, place) for v in views)
    known = [np.square(v.std.reshape(len(v.std), -1)[v.usable]).ravel() for v in views]
    noise = float(np.sqrt(np.median(np.concatenate(known))))
    return GivenStands(stands, tuple(map(_emptied, views)), noise)


def of_experiment(experiment: Experiment, place: Place) -> GivenStands:
    """Take the stands that a configuration gives.

    Those of ``pose=given``, rough poses of the scan, or those of a virtual lab.

    Raises
    ------
    UserError
        If it gives none, or only those of some of the views that the scan has rough poses or
        marks of.
    """
    if isinstance(experiment.pose, Given):
        found = experiment.pose.read()
        poses = dict(zip(found.views, zip(found.rotation, found.origin, strict=True), strict=True))
    else:
        known = _rough_poses(experiment)
        poses = {name: (pose.rotation, pose.place) for name, pose in known.items()}
    if not poses:
        raise UserError(
            "plan: there are no stands to go on from: give a run's folder, or rough poses with "
            "scan=session and scan.poses, or their poses with pose=given and pose.views"
        )
    stands = tuple(
        _stand(name, origin, rotation, place) for name, (rotation, origin) in poses.items()
    )
    images = tuple(_image(stand, experiment, k, place) for k, stand in enumerate(stands))
    return GivenStands(stands, images)


def _rough_poses(experiment: Experiment) -> dict[str, KnownPose]:
    """Give the rough poses of all views of a scan; those of a virtual lab where it has none.

    A view of which somebody has marked where it is scanned is measured from where its entry of
    ``scan.poses`` stands, though its scan does not need that any more.

    Raises
    ------
    UserError
        If it has those of some of its views only.
    """
    scan, scene = experiment.scan, getattr(experiment.scene, "views", {})
    if scan is None:
        return dict(scene)
    known = scan.rough_poses()
    known = {**scan.poses, **known} if isinstance(scan, Session) else known
    if not known:
        return dict(scene)
    every = dict.fromkeys([*known, *scan.view_names()])
    known = {name: known.get(name) or scene.get(name) for name in every}
    missing = [name for name, pose in known.items() if pose is None]
    if missing:
        several = len(missing) > 1
        raise UserError(
            f"plan: the stand{'s' * several} of view{'s' * several} {', '.join(missing)} "
            f"{'are' if several else 'is'} not known, since DAC steps of marks alone do not tell "
            f"{'them' if several else 'it'}: give "
            f"{'their rough poses' if several else 'its rough pose'} too "
            f"(scan.poses.{missing[0]}), or the folder of a run of these views"
        )
    return known


def _stand(name: str, origin: Array, rotation: Array, place: Place) -> Stand:
    """Take a pose for a stand, which looks along its own axis."""
    look_at = looked_at(origin, rotation[2], place)
    return known_stand(name, origin, look_at, rotation, place)


def _image(stand: Stand, experiment: Experiment, number: int, place: Place) -> View:
    """Lay the pixels that the configuration's scan has of a stand, or those that it would get.

    Corners in DAC steps that are of another stand or object do not count.
    """
    raster = _own_raster(stand, experiment)
    if raster is None or held_by(raster, stand, place) < HELD * len(place.nodes):
        raster = raster_of(stand, experiment)
    return empty_image(stand, experiment, raster, number, place)


def _own_raster(stand: Stand, experiment: Experiment) -> IntArray | None:
    """Lay the pixels of the box that the scan gives a view in DAC steps; None without one."""
    scan = experiment.scan
    part = scan.structure if isinstance(scan, Session) else scan
    region = part.views.get(stand.name) if isinstance(part, Rectangle) else None
    if region is None or region.pose is not None:
        return None
    assert isinstance(part, Rectangle)
    return part.grid(stand.name)


def boxes_told(stands: Sequence[Stand], place: Place, experiment: Experiment) -> Iterator[str]:
    """Say of which stands the scan's corners in DAC steps are of another stand, or object."""
    key = "scan.structure.views" if isinstance(experiment.scan, Session) else "scan.views"
    for stand in stands:
        raster = _own_raster(stand, experiment)
        if raster is None:
            continue
        held, count = held_by(raster, stand, place), len(place.nodes)
        if held < HELD * count:
            yield (
                f"stand {stand.name}: {key}.{stand.name} gives corners in DAC steps that hold "
                f"{held} of {count} nodes as seen from there, so that they are of another stand or "
                "object; bounds are told as if the surface was imaged whole, and a run needs other "
                f"corners (~{key}.{stand.name} takes these out)"
            )


def _emptied(view: View) -> View:
    """Put zeros in the place of velocities, and unit noise."""
    pixels = len(view.dac)
    nothing, unit = np.zeros((pixels, 1), complex), np.ones(pixels)
    return replace(view, velocity=nothing, std=unit, covariance=None)
