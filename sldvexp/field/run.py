"""The field of a run: from its poses and images to nodal velocities."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from sldvexp.field.bounds.element_error import element_error, mean_squares, told
from sldvexp.field.bounds.intrinsic_effect import PoseErrors
from sldvexp.field.estimate import estimate_field
from sldvexp.field.solvers.base import Solver
from sldvexp.field.to_dataset import field_group
from sldvexp.field.visibility.looks import Looks
from sldvexp.field.visibility.view import views_of
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.reconstruction.base import Reconstruction
from sldvexp.volume.base import Coordinates, Volume
from sldvexp.volume.prisms import Prisms

#: Images of more bytes are not kept for another look at them.
REMEMBERED = 2**26


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
    prisms = volume.prisms()
    needed = {k: g for k, g in tree.items() if k == "pose" or k.startswith("image/")}
    if sum(group.nbytes for group in needed.values()) > REMEMBERED:
        return _looks(needed, laser, volume, prisms)
    digest = hashlib.sha256(repr((laser, volume)).encode())
    for array in (prisms.position, prisms.triangles, prisms.depth):
        digest.update(array.tobytes())
    for name in sorted(needed):
        digest.update(pickle.dumps((name, needed[name].to_dict(data="array"))))
    return _remembered(Content(digest.digest(), needed, laser, volume, prisms))


@dataclass(frozen=True)
class Content:
    """What looks are made of, known by its digest."""

    digest: bytes
    tree: Mapping[str, xr.Dataset] = field(compare=False)
    laser: TwoMirror = field(compare=False)
    volume: Volume = field(compare=False)
    prisms: Prisms = field(compare=False)


@lru_cache(maxsize=2)
def _remembered(of: Content) -> Looks:
    """Looks for the checks of a run, and for the next runs of a sweep over methods."""
    return _looks(of.tree, of.laser, of.volume, of.prisms)


def _looks(
    tree: Mapping[str, xr.Dataset], laser: TwoMirror, volume: Volume, prisms: Prisms
) -> Looks:
    sight = volume.sight
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
