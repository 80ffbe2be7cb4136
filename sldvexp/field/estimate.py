"""The velocity field over a volume of prisms (Section 5.3), from views to values with bounds.

The field of a run: from its poses and images to nodal velocities.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np

from sldvexp.errors import UserError
from sldvexp.field.bounds.element_error import element_error, mean_squares, told
from sldvexp.field.bounds.pose_uncertainty import PoseErrors, pose_covariance
from sldvexp.field.bounds.residuals_and_bounds import pose_effect, residuals_only, variance_factors
from sldvexp.field.equations.assembly import normal_equations, pixel_data
from sldvexp.field.equations.conditioning import condition_numbers
from sldvexp.field.equations.regions import RegionIterator
from sldvexp.field.equations.sample_model import FieldModel
from sldvexp.field.equations.system import solution
from sldvexp.field.equations.undetermined import factorise, find_undetermined
from sldvexp.field.fit import FieldEstimate, FieldFit
from sldvexp.field.result import FieldResult
from sldvexp.field.solvers.base import Solver
from sldvexp.field.to_dataset import field_to_dataset
from sldvexp.field.visibility.view import View, views_of
from sldvexp.field.visibility.visibility import VolumeVisibility
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.reconstruction.base import Reconstruction
from sldvexp.typing import Array
from sldvexp.volume.base import Coordinates, Volume
from sldvexp.volume.prisms import Prisms

NO_COVARIANCE = "the poses have no covariance: bounds are those of the velocities' noise"


def estimate_field(
    looks: VolumeVisibility,
    method: Reconstruction,
    solver: Solver,
    *,
    local: bool = False,
    bounds: bool = True,
    covariance: Array | None = None,
    errors: PoseErrors | None = None,
) -> FieldResult:
    """Reconstruct the velocity field (Section 5.3.6).

    The field is ``V(P) = sum_i V_i N_i(P)`` (Eq 5.21); every method is a least-squares fit of it to
    the velocities that the views have at the samples.

    Parameters
    ----------
    looks : VolumeVisibility
        The volume, its samples and the views.
    method : Reconstruction
        absolute, relative, combined or contravariant; its rows, model, weights and confidence.
    solver : Solver
    local : bool
        Components along each node's tangents and normal instead of the world's axes. The basis
        functions interpolate the components, and the frame turns with the surface.
    bounds : bool
        Compute standard errors and condition numbers, which takes a while longer.
    covariance : ndarray, shape (6 views, 6 views), optional
        Of all poses together; without it those of the views, each by itself.
    errors : PoseErrors, optional
        Instead of `covariance`, where intrinsics may have been adjusted with the poses.

    Returns
    -------
    FieldResult

    Raises
    ------
    UserError
        If there are too few views or rows for the method, a view sees nothing, or nothing is
        determined anywhere.
    """
    check_views(looks)
    poses = pose_covariance(looks.views, covariance if errors is None else errors.covariance)
    fit = FieldFit.from_images(looks, method, solver, local, pixel_data(looks.views))
    model, messages = fit.parts.model, fit.messages
    if not bounds:
        second = residuals_only(fit.parts, fit.theta, fit.data)
        return FieldEstimate.from_fit(fit, second, solver).result(messages)
    factor = variance_factors(looks.views, model.pixel_std)
    effect = pose_effect(model, fit.theta, fit.data, factor, poses)
    second = fit.with_bounds(factor, effect)
    if errors is not None and len(errors.pose) and second.pose is not None:
        added = errors.variance(looks.views, solved_with(looks, model, solver))
        second = replace(second, pose=second.pose + added)
    if poses is None:
        messages.append(NO_COVARIANCE)
    condition = condition_numbers(fit.equations.system, fit.solve)
    return FieldEstimate.from_fit(fit, second, solver).result(messages, condition)


def solved_with(
    looks: VolumeVisibility, model: FieldModel, solver: Solver
) -> Callable[[list[View]], Array]:
    """From views to the solution, (layer, surface_node, parameter, column); all else the same."""

    def solved(views: list[View]) -> Array:
        parts = RegionIterator(looks.seen_by(views), model)
        equations = normal_equations(parts, pixel_data(views))
        equations, solve = factorise(solver, equations, find_undetermined(equations))
        return solution(equations.right, equations.system, solve)

    return solved


def check_views(looks: VolumeVisibility) -> None:
    """Complain if there are no views, or two of them are the same."""
    if not looks.views:
        raise UserError("field: there are no views")
    for i, a in enumerate(looks.views):
        for b in looks.views[:i]:
            if np.array_equal(a.origin, b.origin) and np.array_equal(a.rotation, b.rotation):
                raise UserError(
                    f"views {b.name} and {a.name} have the same pose: they see the same component "
                    "of the velocity; leave one out, or move the instrument"
                )
            if a.velocity.any() and _same_image(a, b):
                raise UserError(
                    f"views {b.name} and {a.name} have the same image, pixel by pixel, from "
                    "different places; give each view its own"
                )


def _same_image(a: View, b: View) -> bool:
    """Whether one image is a copy of the other: noise is never the same twice."""
    return np.array_equal(a.dac, b.dac) and np.array_equal(a.velocity, b.velocity, equal_nan=True)


#: Images of more bytes are not kept for another look at them.
CACHE_BYTES = 2**26


def volume_visibility(
    tree: Mapping[str, xr.Dataset], laser: TwoMirror, volume: Volume
) -> VolumeVisibility:
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
    if sum(group.nbytes for group in needed.values()) > CACHE_BYTES:
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
def _remembered(of: Content) -> VolumeVisibility:
    """Looks for the checks of a run, and for the next runs of a sweep over methods."""
    return _looks(of.tree, of.laser, of.volume, of.prisms)


def _looks(
    tree: Mapping[str, xr.Dataset], laser: TwoMirror, volume: Volume, prisms: Prisms
) -> VolumeVisibility:
    sight = volume.sight
    thickness = float(np.ptp(prisms.depth))
    grazing = np.radians(sight.grazing)
    return VolumeVisibility(
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
    looks: VolumeVisibility,
    volume: Volume,
    method: Reconstruction,
    solver: Solver,
) -> xr.Dataset:
    """The group ``field`` of a run by one method; see `sldvexp.field.estimate.estimate_field`."""
    local = volume.coordinates is Coordinates.local
    errors = PoseErrors.from_dataset(tree["pose"], looks.names)
    result = estimate_field(looks, method, solver, local=local, errors=errors)
    image = tree[f"image/{looks.names[0]}"]
    frequency = image["frequency"].values if "frequency" in image.coords else None
    error = element_error(looks.prisms, looks.rule, result.velocity)
    if result.confidence is not None:
        coarse = told(mean_squares(error, result.confidence))
        result = replace(result, messages=(*result.messages, *coarse))
    return field_to_dataset(result, looks.prisms, method, frequency, error)
