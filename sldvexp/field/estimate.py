"""The velocity field over a volume of prisms (Section 5.3), from views to values with bounds.

The field is ``V(P) = sum_i V_i N_i(P)`` (Eq 5.21) with the prisms' linear basis functions N_i;
every method is a least-squares fit of it to the velocities that the views have at the samples. The
equations' matrix depends on the geometry alone, so that real and imaginary part at every frequency
are right-hand sides of one matrix.

There are three ways in, one upon the other: `estimate_field` from views made of arrays,
`reconstruct` from the groups of a run, and `solve_field` from what the views see of the volume.
"""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sldvexp.dataset import with_findings
from sldvexp.errors import UserError
from sldvexp.field.bounds.advice import advice
from sldvexp.field.bounds.calibration import calibration_changes
from sldvexp.field.bounds.pointing import pointing_variance
from sldvexp.field.bounds.pose_uncertainty import (
    PoseEffect,
    PoseErrors,
    of_modes,
    pose_covariance,
)
from sldvexp.field.bounds.residuals_and_bounds import residuals_only, variance_factors
from sldvexp.field.equations.assembly import normal_equations, pixel_data
from sldvexp.field.equations.conditioning import condition_numbers
from sldvexp.field.equations.regions import RegionIterator
from sldvexp.field.equations.sample_model import FieldModel
from sldvexp.field.equations.system import solution
from sldvexp.field.equations.undetermined import factorise, find_undetermined
from sldvexp.field.fit import FieldEstimate, FieldSetUp
from sldvexp.field.result import FieldResult
from sldvexp.field.solvers.base import Solver
from sldvexp.field.solvers.iterative import Iterative
from sldvexp.field.visibility.view import View, views_of
from sldvexp.field.visibility.visibility import VolumeVisibility
from sldvexp.image import Interpolation
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.reconstruction import Reconstruction
from sldvexp.typing import Array
from sldvexp.volume import Coordinates, Prisms, Volume

NO_COVARIANCE = "the poses have no covariance: bounds are those of the velocities' noise"


def estimate_field(
    views: Sequence[View],
    laser: TwoMirror,
    volume: Volume,
    method: Reconstruction,
    solver: Solver | None = None,
    *,
    frequency: ArrayLike | None = None,
    covariance: Array | None = None,
) -> FieldResult:
    """Estimate the velocity field around a surface from views of it, without any run.

    A run does the same with its poses and images: from the same arrays come the same bits.

    Parameters
    ----------
    views : sequence of View
        Poses and velocity images; `View.from_arrays` makes them.
    laser : TwoMirror
        Which all views were taken with.
    volume : Volume
        The surface, the layers around it, their samples and how views see them.
    method : Reconstruction
        absolute, relative, combined or contravariant; its rows, model, weights and confidence.
    solver : Solver, optional
        `Iterative` without it.
    frequency : array_like, shape (frequency,), Hz, optional
        Of the views' images; needed for the dataset of more than one.
    covariance : ndarray, shape (6 views, 6 views), optional
        Of all poses together; without it that of each view, by itself.

    Raises
    ------
    UserError
        See `solve_field`; or if the volume is unsound.

    Examples
    --------
    A plate that moves as a whole, seen from three places that all face it along -z:

    >>> import numpy as np
    >>> from sldvexp import field, reconstruction, volume
    >>> from sldvexp.laser.model import direction_cosines
    >>> from sldvexp.laser.two_mirror import TwoMirror
    >>> rng, laser, rotation = np.random.default_rng(1), TwoMirror(), np.diag([1.0, -1.0, -1.0])
    >>> step = np.radians(np.linspace(-24, 24, 25))
    >>> angle = np.stack(np.meshgrid(step, step), axis=-1).reshape(-1, 2)
    >>> seen = direction_cosines(angle) @ rotation @ [0, 1e-3, 2e-3 + 1e-3j]
    >>> views = []
    >>> for name, x, y in ("left", -0.4, -0.3), ("right", 0.4, -0.3), ("top", 0.0, 0.4):
    ...     image, origin = seen + rng.normal(scale=1e-6, size=len(seen)), [x, y, 1.5]
    ...     view = field.View.from_arrays(
    ...         name, rotation, origin, image, 1e-6, angle=angle, laser=laser
    ...     )
    ...     views.append(view)
    >>> plate = volume.Grid(size=[0.2, 0.2], shape=[3, 3], layers=2)
    >>> result = field.estimate_field(views, laser, plate, reconstruction.Absolute())
    >>> np.abs(1e3 * result.velocity[0, :, 0]).round(2).tolist()
    [0.0, 1.0, 2.24]
    >>> result.to_dataset()["velocity"].dims
    ('node', 'component')
    """
    visibility = VolumeVisibility.from_volume(views, laser, volume)
    return _in_volume(
        visibility, volume, method, solver or Iterative(), frequency, covariance=covariance
    )


def reconstruct(
    tree: Mapping[str, xr.Dataset],
    visibility: VolumeVisibility,
    volume: Volume,
    method: Reconstruction,
    solver: Solver,
) -> xr.Dataset:
    """Make the group ``field`` of a run by one method, or recall it if it was the last one.

    A run often compares its field with what is the same method.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        With the groups ``pose`` and ``image/<view>``.
    visibility : VolumeVisibility
        What these views see of the volume; see `volume_visibility`.
    """
    kept, poses = visibility.common, tree["pose"].to_dict(data="array")
    key = "field", repr((method, solver, volume)), _digest(_content(poses))
    if kept is None or key not in kept:
        image = tree[f"image/{visibility.names[0]}"]
        frequency = image["frequency"].values if "frequency" in image.coords else None
        errors = PoseErrors.from_dataset(tree["pose"], visibility.names)
        found = _in_volume(visibility, volume, method, solver, frequency, errors=errors)
        made = with_findings(found.to_dataset(), visibility.findings)
        if kept is None or made.nbytes > CACHE_BYTES:
            return made
        for other in [k for k in kept if k[0] == key[0]]:
            del kept[other]
        kept[key] = made
    again: xr.Dataset = kept[key]
    return again.copy(deep=True)


def _in_volume(
    visibility: VolumeVisibility,
    volume: Volume,
    method: Reconstruction,
    solver: Solver,
    frequency: ArrayLike | None,
    **poses: Any,
) -> FieldResult:
    """Solve in the volume's coordinates, with the errors of its model in the bounds."""
    local = volume.coordinates is Coordinates.local
    result = solve_field(visibility, method, solver, local=local, **poses).with_model_errors()
    cubic = visibility.interpolation is Interpolation.cubic
    advised = advice(result.mean_squares, result.components, cubic) if result.variance else []
    return replace(
        result,
        frequency=None if frequency is None else np.asarray(frequency, float),
        messages=(*result.messages, *advised),
    )


def solve_field(
    visibility: VolumeVisibility,
    method: Reconstruction,
    solver: Solver,
    *,
    local: bool = False,
    bounds: bool = True,
    covariance: Array | None = None,
    errors: PoseErrors | None = None,
) -> FieldResult:
    """Solve for the velocity field, given what views see of a volume (Section 5.3.6).

    Parameters
    ----------
    visibility : VolumeVisibility
        The volume, its samples and the views.
    method : Reconstruction
        absolute, relative, combined or contravariant; its rows, model, weights and confidence.
    local : bool
        Components along each node's tangents and normal instead of the world's axes. The basis
        functions interpolate the components, and the frame turns with the surface.
    bounds : bool
        Compute standard errors and condition numbers, which takes a while longer.
    covariance : ndarray, shape (6 views, 6 views), optional
        Of all poses together; without it those of the views, each by itself.
    errors : PoseErrors, optional
        Instead of `covariance`, where intrinsics may have been adjusted with the poses.

    Raises
    ------
    UserError
        If there are too few views or rows for the method, a view sees nothing, or nothing is
        determined anywhere.
    """
    check_views(visibility)
    poses = pose_covariance(visibility.views, covariance if errors is None else errors.covariance)
    data = pixel_data(visibility.views)
    setup = FieldSetUp.recalled(visibility, method, local, data, bounds=bounds)
    fit = setup.solved(solver, data)
    del setup  # with right sides that are no longer needed
    model, messages, modes = fit.parts.model, fit.messages, fit.modes
    if modes is None:
        left = residuals_only(fit.parts, fit.theta, fit.data)
        return FieldEstimate.from_fit(fit, left).result(messages)
    factor = variance_factors(visibility.views, model.pixel_std)
    effect = None if poses is None else PoseEffect.from_modes(poses, modes, fit.theta, fit.data)
    found = fit.with_bounds(factor, effect)
    test = fit.intercept_test(found, effect)
    others: dict[str, Array] = {}
    if changes := calibration_changes(visibility, errors, solved_with(model, solver)):
        others["calibration"] = np.sum(np.square(changes), axis=0)
        if test is not None and effect is not None:
            test = test.with_changes(modes.of_columns(np.stack(changes)))
    system, reduced = fit.equations.system, [modes.of_columns(d) for d in fit.data]
    pointing = pointing_variance(fit.parts, system, fit.solve, reduced)
    if pointing is not None:
        others["pointing"] = of_modes(modes, pointing)
    error = None if fit.interpolation is None else modes.to_columns(fit.interpolation)
    found = replace(found, others=others, interpolation=error)
    if poses is None:
        messages.append(NO_COVARIANCE)
    condition = condition_numbers(fit.equations.system, fit.roughly)
    tested = None
    if test is not None:
        of_poses = None if effect is None else modes
        tested = test.test(fit.theta, fit.data, found, factor, of_poses, method.confidence)
    return FieldEstimate.from_fit(fit, found, tested).result(messages, condition)


def solved_with(model: FieldModel, solver: Solver) -> Callable[[VolumeVisibility], Array]:
    """Make the map from what is seen to the solution, (layer, surface_node, parameter, column)."""

    def solved(visibility: VolumeVisibility) -> Array:
        parts = RegionIterator(visibility, model)
        equations = normal_equations(parts, pixel_data(visibility.views))
        equations, solve = factorise(solver, equations, find_undetermined(equations))
        return solution(equations.right, equations.system, solve)

    return solved


def check_views(visibility: VolumeVisibility) -> None:
    """Complain if there are no views, or two of them are the same."""
    if not visibility.views:
        raise UserError("field: there are no views")
    for i, a in enumerate(visibility.views):
        for b in visibility.views[:i]:
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
    """Compare images: one is a copy of the other, as noise never is."""
    return np.array_equal(a.dac, b.dac) and np.array_equal(a.velocity, b.velocity, equal_nan=True)


#: Images of more bytes are not kept, nor what is seen in them.
CACHE_BYTES = 2**26


def volume_visibility(
    tree: Mapping[str, xr.Dataset], laser: TwoMirror, volume: Volume
) -> VolumeVisibility:
    """Find what the views of a run see of a volume, or recall it.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        With the groups ``pose`` and ``image/<view>``.

    Raises
    ------
    UserError
        If an image has no pose, or the volume is unsound.
    """
    prisms = volume.prisms()
    needed = {k: g for k, g in tree.items() if k == "pose" or k.startswith("image/")}
    if sum(group.nbytes for group in needed.values()) > CACHE_BYTES:
        return VolumeVisibility.from_volume(views_of(needed, laser), laser, volume, prisms)

    def contents() -> Iterator[bytes]:
        yield repr((laser, volume)).encode()
        for array in (prisms.position, prisms.triangles, prisms.depth):
            yield array.tobytes()
        for name in sorted(needed):
            yield name.encode()
            yield from _content(needed[name].to_dict(data="array"))

    return _remembered(Content(_digest(contents()), needed, laser, volume, prisms))


def _digest(contents: Iterable[bytes]) -> bytes:
    """Tell contents that follow one another, each with its length, from all others."""
    told = hashlib.sha256()
    for content in contents:
        told.update(b"%d " % len(content) + content)
    return told.digest()


def _content(value: Any) -> Iterator[bytes]:
    """Yield all that a group is made of: the same for groups that are equal to the bit.

    A pickle tells, too, whether arrays may be changed and which names are one object, and so takes
    a group that a run made for another than the one that the next run reads.
    """
    if isinstance(value, dict):
        for key, entry in value.items():
            yield repr(key).encode()
            yield from _content(entry)
    elif isinstance(value, np.ndarray) and not value.dtype.hasobject:
        yield f"{value.dtype.str} {value.shape}".encode()
        yield value.tobytes()
    else:
        yield pickle.dumps(value) if isinstance(value, np.ndarray) else repr(value).encode()


@dataclass(frozen=True)
class Content:
    """Poses, images, laser and volume, known by their digest."""

    digest: bytes
    tree: Mapping[str, xr.Dataset] = field(compare=False)
    laser: TwoMirror = field(compare=False)
    volume: Volume = field(compare=False)
    prisms: Prisms = field(compare=False)


@lru_cache(maxsize=2)
def _remembered(content: Content) -> VolumeVisibility:
    """Keep what is seen for the checks of a run, and the next runs of a sweep over methods."""
    views = views_of(content.tree, content.laser)
    seen = VolumeVisibility.from_volume(views, content.laser, content.volume, content.prisms)
    seen.common = {}
    return seen
