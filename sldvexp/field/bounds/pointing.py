"""Variance of nodal values because mirrors come to rest beside where they are sent.

A pixel that is off by a random part of a DAC step has the velocity of a place beside it: its error
is the slope of the image there times that step, independent from pixel to pixel. It is propagated
as the noise is, but changes with the frequency, since the slope does: a few fields of such errors
with random signs are solved, for the modes of the data, and their squares averaged over the fields
and over the nodes around each. The image is taken as it was interpolated.
"""

from __future__ import annotations

import numpy as np

from sldvexp.field.bounds.element_error import SurfaceMean
from sldvexp.field.equations.assembly import right_sides
from sldvexp.field.equations.regions import RegionIterator
from sldvexp.field.equations.system import NormalEquations, Solve, solution
from sldvexp.field.visibility.view import View
from sldvexp.typing import Array

#: Fields of errors with random signs; with the nodes around, a variance is right to some 10 %.
FIELDS = 16
#: How often squares are averaged over the nodes around.
AVERAGED = 2


def pointing_variance(
    parts: RegionIterator, system: NormalEquations, solve: Solve, data: list[Array]
) -> Array | None:
    """Compute covariances of the modes; None if no view's pointing is known.

    Parameters
    ----------
    data : list of ndarray, shape (pixel, mode), m/s
        Velocities of each view's pixels.

    Returns
    -------
    ndarray, shape (layer, surface_node, parameter, mode * mode), m2/s2
        See `sldvexp.field.bounds.pose_uncertainty.of_modes`.
    """
    visibility = parts.visibility
    steps = [pointing_std(visibility.laser.pointing_std, view) for view in visibility.views]
    if not any(steps):
        return None
    rng, modes = np.random.default_rng(0), data[0].shape[1]
    errors = []
    for step, (up_down, left_right) in zip(steps, visibility.slopes(data), strict=True):
        one, other = rng.choice([-step, step], (2, len(up_down), FIELDS, 1))
        each = one * up_down[:, None] + other * left_right[:, None]
        errors.append(each.reshape(len(up_down), FIELDS * modes))
    found = solution(right_sides(parts, errors), system, solve)
    found = found.reshape(*found.shape[:-1], FIELDS, modes)
    square = np.einsum("lnpfa,lnpfb->lnpab", found, found) / FIELDS
    mean = SurfaceMean.from_prisms(visibility.prisms, visibility.rule)
    flat = square.reshape(visibility.prisms.nodes, -1)
    for _ in range(AVERAGED):
        flat = mean.of(flat)
    return flat.reshape(*found.shape[:3], modes * modes)


def pointing_std(configured: float, view: View) -> float:
    """Take the laser's configured pointing noise, or what the pose has found of it; DAC steps."""
    return configured or view.pointing_std
