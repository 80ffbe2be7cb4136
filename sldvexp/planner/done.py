"""Stands that are given: those of a run that is done, or of a configuration, with their images."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sldvexp.config.experiment import Experiment
from sldvexp.dataset import RunData
from sldvexp.errors import UserError
from sldvexp.field.visibility.view import View, views_of
from sldvexp.geometry import KnownPose
from sldvexp.planner.images import Stand, empty_image, known_stand, looked_at, raster_of
from sldvexp.planner.place import Place
from sldvexp.pose.given import Given
from sldvexp.scan.rectangle import Rectangle
from sldvexp.scan.session import Session
from sldvexp.typing import Array


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
        If it gives none.
    """
    if isinstance(experiment.pose, Given):
        found = experiment.pose.read()
        poses = dict(zip(found.views, zip(found.rotation, found.origin, strict=True), strict=True))
    else:
        known: dict[str, KnownPose] = experiment.scan.rough_poses() if experiment.scan else {}
        known = known or getattr(experiment.scene, "views", {})
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


def _stand(name: str, origin: Array, rotation: Array, place: Place) -> Stand:
    """Take a pose for a stand, which looks along its own axis."""
    look_at = looked_at(origin, rotation[2], place)
    return known_stand(name, origin, look_at, rotation, place)


def _image(stand: Stand, experiment: Experiment, number: int, place: Place) -> View:
    """Lay the pixels that the configuration's scan has of a stand, or those that it would get."""
    scan = experiment.scan
    part = scan.structure if isinstance(scan, Session) else scan
    scanned = isinstance(part, Rectangle) and stand.name in part.views
    raster = part.grid(stand.name) if scanned else raster_of(stand, experiment)
    return empty_image(stand, experiment, raster, number, place)


def _emptied(view: View) -> View:
    """Put zeros in the place of velocities, and unit noise."""
    pixels = len(view.dac)
    nothing, unit = np.zeros((pixels, 1), complex), np.ones(pixels)
    return replace(view, velocity=nothing, std=unit, covariance=None)
