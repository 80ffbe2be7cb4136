"""The field of a run: from its poses and images to nodal velocities."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from sldvexp.field.element_error import element_error, mean_squares, told
from sldvexp.field.estimate import estimate_field
from sldvexp.field.group import field_group
from sldvexp.field.intrinsic_effect import PoseErrors
from sldvexp.field.looks import Looks
from sldvexp.field.view import views_of
from sldvexp.volume.base import Coordinates

if TYPE_CHECKING:
    from sldvexp.field.solvers.base import Solver
    from sldvexp.laser.two_mirror import TwoMirror
    from sldvexp.reconstruction.base import Reconstruction
    from sldvexp.volume.base import Volume


def looks_of(tree: Mapping[str, xr.Dataset], laser: TwoMirror, volume: Volume) -> Looks:
    """What the views of a run see of a volume.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        With the groups ``pose`` and ``image/<view>``.
    laser : TwoMirror
    volume : Volume

    Raises
    ------
    UserError
        If an image has no pose, or the volume is unsound.
    """
    prisms, sight = volume.prisms(), volume.sight
    thickness = float(np.ptp(prisms.depth))
    grazing = np.radians(sight.grazing)
    return Looks(
        views_of(tree, laser),
        laser,
        prisms,
        volume.rule(),
        sight.interpolation,
        grazing,
        one_sided=not sight.both_sides,
        clearance=thickness / 2 / np.cos(grazing) if sight.occlusion else None,
    )


def reconstruct(
    tree: Mapping[str, xr.Dataset],
    looks: Looks,
    volume: Volume,
    method: Reconstruction,
    solver: Solver,
) -> xr.Dataset:
    """The group ``field`` of a run by one method; see `sldvexp.field.estimate.estimate_field`."""
    local = volume.coordinates is Coordinates.local
    errors = PoseErrors.of(tree["pose"], looks.names)
    result = estimate_field(looks, method, solver, local=local, errors=errors)
    image = tree[f"image/{looks.names[0]}"]
    frequency = image["frequency"].values if "frequency" in image.coords else None
    error = element_error(looks.prisms, looks.rule, result.velocity)
    if result.confidence is not None:
        coarse = told(mean_squares(error, result.confidence))
        result = replace(result, messages=(*result.messages, *coarse))
    return field_group(result, looks.prisms, method, frequency, error)
