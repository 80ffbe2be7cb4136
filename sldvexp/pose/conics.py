"""The fitted conics of a scanned calibration object, and all their bitangent points, to be kept.

Six coefficients ``A x^2 + B y^2 + C x y + D x + E y + F = 0`` of each circle's image (Eq 4.17), x
up-down and y left-right, scaled so that ``A + B = 1``: F, by which one could divide too, is zero
for a conic through the origin. Pairs of four circles have 48 bitangent points, of which 16 are used
(Section 4.5.2); the others are as accurate, and so a check of the image.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sldvexp import dataset
from sldvexp.geometry import conic
from sldvexp.geometry.bitangent import MIRRORED, bitangent_points
from sldvexp.geometry.circles import LINES
from sldvexp.image import dac_from_pinhole
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.pose.circle_images import CircleImages
from sldvexp.targets import Circles
from sldvexp.typing import Array, IntArray

#: Coefficients of Eq 4.17.
TERMS = tuple("ABCDEF")


def conics_to_dataset(
    images: Sequence[CircleImages], target: Circles, laser: TwoMirror, pinhole: bool
) -> xr.Dataset:
    """Make the group ``conic`` of a run.

    Parameters
    ----------
    images : sequence of CircleImages
        One a view.
    pinhole : bool
        Whether the conics are those of `sldvexp.image.pinhole` coordinates, not of DAC steps.

    Returns
    -------
    xarray.Dataset
        ``coefficient``; ``bitangent`` in DAC steps, numbered as ``Circles.all_bitangents`` are on
        the object, NaN for a pair whose images overlap; ``registered``.
    """
    numbers = sorted(target.circles)
    parameters = np.array([[i.ellipses[n].parameters for n in numbers] for i in images])
    first, second = np.array(target.all_pairs()).T
    index = np.searchsorted(numbers, first), np.searchsorted(numbers, second)
    with np.errstate(divide="ignore", invalid="ignore"):  # ellipses that overlap
        points = bitangent_points(parameters[:, index[0]], parameters[:, index[1]])
    mirrored = np.array([i.match.mirrored for i in images])
    points[mirrored] = points[mirrored][:, :, MIRRORED]
    if pinhole:
        points = dac_from_pinhole(laser, points)
    known = target.all_bitangents()
    found = dataset.group(
        "conic",
        {
            "view": [i.view for i in images],
            "circle": numbers,
            "term": list(TERMS),
            "bitangent_point": known.number,
        },
        coefficient=coefficients(parameters),
        bitangent=points.reshape(len(images), -1, 2),
        registered=_registered(target),
        touched=np.array(known.label, dtype=str),
    )
    found.attrs["plane"] = "pinhole coordinates, DAC steps at 0" if pinhole else "DAC steps"
    return found


def coefficients(parameters: Array) -> Array:
    """Give A to F of Eq 4.17 with ``A + B = 1``, shape (..., 6).

    Parameters
    ----------
    parameters : ndarray, shape (..., 5)
        Five numbers of each ellipse (`sldvexp.geometry.conic`).

    Examples
    --------
    The circle of radius 2 around (1, 0):

    >>> coefficients(np.array([1.0, 0.0, 4.0, 4.0, 0.0])).round(6).tolist()
    [0.5, 0.5, 0.0, -1.0, 0.0, -1.5]
    """
    m = conic.point_conic(parameters)
    terms = (m[..., 0, 0], m[..., 1, 1], 2 * m[..., 0, 1], 2 * m[..., 0, 2], 2 * m[..., 1, 2])
    every = np.stack([*terms, m[..., 2, 2]], axis=-1)
    scaled: Array = every / (every[..., :1] + every[..., 1:2])
    return scaled


def _registered(target: Circles) -> IntArray:
    """Give each bitangent point its number in the registration; 0 for those left out."""
    numbers = np.zeros((len(target.all_pairs()), len(LINES), 2), np.int64)
    place = {frozenset(pair): k for k, pair in enumerate(target.all_pairs())}
    count = 0
    for pair in target.selected_pairs():
        k = place[frozenset(pair)]
        turned = pair != target.all_pairs()[k]  # seen from the other end left and right swap
        for end in (0, 1):
            for line in (0, 1):
                count += 1
                numbers[k, 1 - line if turned else line, 1 - end if turned else end] = count
    return numbers.ravel()
