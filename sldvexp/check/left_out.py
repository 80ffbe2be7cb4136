"""`check=left_out`: each view predicted from the field of the others.

A field is estimated without a view; its velocity along that view's directions is what the view
should have measured. Errors beyond the noise come from poses, phases and samples off the surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp import dataset
from sldvexp.check.agreement import field_looks, sampled_depth
from sldvexp.check.base import Check, Examination
from sldvexp.config.registry import register
from sldvexp.errors import UserError
from sldvexp.field import VolumeVisibility
from sldvexp.field.estimate import solve_field
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, IndexArray
from sldvexp.volume import shape_matrix


@register("check", "left_out")
@dataclass
class LeftOut(Check):
    """How well the views agree: the field of all others predicts what a view measured.

    What matters is the error where the others agree best, which is on the real surface.
    """

    def examine(self, run: Examination) -> xr.Dataset:
        """Find ``error`` of every view at every sampled depth, the smallest beside the noise."""
        found = predict(run)
        best = found.error.mean(axis=0).argmin()
        return dataset.group(
            "examined/left_out",
            {"view": list(found.views), "sample_depth": found.depth},
            error=found.error,
            error_at_surface=found.error[:, best],
            measured=found.measured,
            noise=found.noise,
        )


@dataclass(frozen=True, eq=False)
class Prediction:
    """What views measured against what the others say that they should measure, root mean squares.

    Attributes
    ----------
    depth : ndarray, shape (depth,), m
        Sampled depths along the normals, ascending.
    error : ndarray, shape (view, depth), m/s
    measured : ndarray, shape (view,), m/s
        Of the velocity itself.
    noise : ndarray, shape (view,), m/s
        Of the standard error of the interpolated velocity.
    """

    views: tuple[str, ...]
    depth: Array
    error: Array
    measured: Array
    noise: Array


def predict(run: Examination) -> Prediction:
    """Leave out each view in turn.

    Raises
    ------
    UserError
        If the run has no field, or too few views to leave one out.
    """
    looks = field_looks(run)
    if run.experiment.reconstruction is None or len(looks.views) < 4:
        raise UserError(
            "a view can only be left out of a field of at least 4 views; choose a reconstruction "
            "and scan more views"
        )
    depth, place = np.unique(np.round(sampled_depth(looks), 12), return_inverse=True)
    found = [_left_out(run, looks, k, place, len(depth)) for k in range(len(looks.views))]
    error, measured, noise = (np.array(each) for each in zip(*found, strict=True))
    return Prediction(looks.names, depth, error, measured, noise)


def _left_out(
    run: Examination, looks: VolumeVisibility, k: int, place: IndexArray, depths: int
) -> tuple[Array, float, float]:
    """Predict one view: error at each depth, size and noise."""
    e, view = run.experiment, looks.views[k]
    look = looks.at(looks.triangles)  # remembered for the others
    field = solve_field(looks.without(k), e.reconstruction, e.solver, bounds=False)
    seen = look.by_view[k]
    basis = shape_matrix(looks.prisms, looks.rule)
    nodal = field.velocity.reshape(len(field.velocity), -1)
    vector = np.asarray(basis @ nodal).reshape(basis.shape[0], 3, -1)
    left = seen.velocity(view) - np.einsum("si,sif->sf", seen.directions, vector)
    used = seen.valid & np.isfinite(left).all(axis=1)
    shape = (looks.prisms.gaps, len(looks.prisms.triangles), looks.rule.points)
    squares = np.where(used, np.mean(np.abs(left) ** 2, axis=1), 0.0).reshape(shape).sum(axis=1)
    total, count = np.zeros(depths), np.zeros(depths)
    np.add.at(total, place, squares.ravel())
    np.add.at(count, place, used.reshape(shape).sum(axis=1).ravel())
    measured = np.mean(np.abs(seen.velocity(view)[used]) ** 2)
    noise = np.mean(2 * seen.std(view)[used] ** 2)
    return np.sqrt(total / count), float(np.sqrt(measured)), float(np.sqrt(noise))
