"""What views measured point by point, as images, a pixel for each point."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sldvexp import dataset
from sldvexp.errors import UserError
from sldvexp.importers.pointwise import PointwiseData, PointwiseImport
from sldvexp.importers.to_line_of_sight import pose_of, positions, record
from sldvexp.laser.model import project
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.lazy import xarray as xr


def read_images(
    settings: PointwiseImport, tree: Mapping[str, xr.Dataset], laser: TwoMirror | None
) -> dict[str, xr.Dataset]:
    """The groups ``image/<view>``, for a field over a volume.

    Raises
    ------
    UserError
        If there is no geometry, pose, or standard error, or a point is off the board.
    """
    views = list(settings.measured())
    return {f"image/{view.name}": _image(view, tree, laser) for view in views}


def _image(
    view: PointwiseData, tree: Mapping[str, xr.Dataset], laser: TwoMirror | None
) -> xr.Dataset:
    rotation, origin, laser = pose_of(view.name, tree, laser)
    position = positions([view], view.node)
    if position is None:
        raise UserError(
            f"{view.source}: has no geometry (data set 15 or 2411), by which points become pixels; "
            "name a file that has with instrument.geometry"
        )
    if view.std is None:
        raise UserError(
            f"{view.source}: does not state standard errors, which a field needs; say them with "
            "instrument.std, or instrument.averages if the file has coherence functions"
        )
    angle = project((position - origin) @ rotation.T, laser.mirror_offset)
    dac = laser.dac_from_angle(angle, [f"view {view.name}, node {n}" for n in view.node])
    flagged = int(view.missing.sum())
    made = dataset.group(
        "image",
        {"frequency": view.frequency},
        velocity=view.velocity,
        velocity_std=view.std,
        angle=angle,
        dac=dac,
        flags=view.missing.astype(np.int8),
    )
    summary = f"{flagged} of {len(view.node)} pixels are flagged"
    return made.assign_attrs({"summary": summary} | record([view]))
