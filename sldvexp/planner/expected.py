"""Expected bounds: those that the project's own estimator gives for images that are still empty.

The standard error of a node depends on where the pixels are, which views see the samples around it,
and how the elements mix these, but on no velocity. So the images of a plan are laid out as the scan
will lay them, with zeros in the place of velocities, and the field's bounds of noise are computed
as for any run. They differ from the closed form by a factor of each node: less than one where there
are several pixels in an element, more at edges. Pixels that speckle will cost are drawn at random,
since the worst node of a field is usually beside one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.errors import UserError
from sldvexp.field.bounds.residuals_and_bounds import noise_only
from sldvexp.field.equations.assembly import normal_equations, pixel_data
from sldvexp.field.equations.regions import RegionIterator
from sldvexp.field.equations.sample_model import FieldModel
from sldvexp.field.equations.undetermined import (
    constrain_singular,
    factorise,
    find_undetermined,
)
from sldvexp.field.solvers.base import Solver
from sldvexp.field.solvers.iterative import Iterative
from sldvexp.field.visibility.view import View
from sldvexp.field.visibility.visibility import VolumeVisibility
from sldvexp.image import Interpolation
from sldvexp.laser import TwoMirror
from sldvexp.reconstruction import Contravariant, Reconstruction
from sldvexp.signal import Flag
from sldvexp.typing import Array, BoolArray, IntArray
from sldvexp.volume import Coordinates, Volume


@dataclass(frozen=True, eq=False)
class ExpectedBounds:
    """Standard errors of the velocity on the surface, in units of the pixels' noise.

    Attributes
    ----------
    std : ndarray, shape (surface_node, component)
        NaN where a component is not determined.
    components : tuple of str
    """

    std: Array
    components: tuple[str, ...]


def empty_view(
    name: str, rotation: Array, origin: Array, raster: IntArray, lost: BoolArray | None = None
) -> View:
    """Make a view whose image is still empty, with pixels of unit noise.

    Parameters
    ----------
    raster : ndarray of int, shape (row, column, 2), steps
    lost : ndarray of bool, shape (row, column), optional
        Pixels that speckle costs.
    """
    pixels = raster.reshape(-1, 2)
    flags = np.zeros(len(pixels), int)
    if lost is not None:
        flags[lost.ravel()] = int(Flag.dropped_out)
    return View.from_arrays(
        name,
        rotation,
        origin,
        np.zeros(len(pixels)),
        1.0,
        dac=pixels,
        flags=flags,
        shape=(raster.shape[0], raster.shape[1]),
    )


def expected_bounds(
    views: Sequence[View],
    laser: TwoMirror,
    volume: Volume,
    method: object = None,
    solver: Solver | None = None,
) -> ExpectedBounds:
    """Compute the bounds of noise of a field whose images are still empty.

    Parameters
    ----------
    method : Reconstruction, optional
        That of the run where it takes all views by rules; else every place by itself from all
        views, as ``reconstruction=samplewise``.
    """
    if not isinstance(method, Reconstruction) or method.rows.strip() not in ("all", "best"):
        method = Contravariant(rows="all")
    thin = _thin(volume)
    local = volume.coordinates is Coordinates.local
    visibility = VolumeVisibility.from_volume(views, laser, thin)
    parts = RegionIterator(visibility, FieldModel.from_method(method, visibility, local))
    equations = normal_equations(parts, pixel_data(views))
    equations, found = constrain_singular(equations, find_undetermined(equations))
    if not found.observable.any():
        raise UserError("plan: these stands determine nothing anywhere; give more of them")
    equations, _ = factorise(solver or Iterative(), equations, found)
    variance = noise_only(parts, equations.system)
    known = found.determined.reshape(variance.shape)
    layer = int(np.abs(thin.depths()).argmin())
    std = np.where(known, np.sqrt(variance), np.nan)[layer, :, :3]
    return ExpectedBounds(std, ("t1", "t2", "n") if local else ("x", "y", "z"))


def _thin(volume: Volume) -> Volume:
    """Keep the layers around the surface, which others change by less than a thousandth.

    Interpolation that would be chosen by the images is taken for cubic, whose bounds are wider.
    """
    depths = volume.depths() / volume.unit.value
    middle = int(np.abs(depths).argmin())
    first = min(max(middle - 1, 0), max(len(depths) - 3, 0))
    kept = [float(d) for d in depths[first : first + 3]]
    sight = volume.sight
    if sight.interpolation is Interpolation.auto:
        sight = replace(sight, interpolation=Interpolation.cubic)
    return replace(volume, depth=kept, sight=sight)
