"""Pixels of all views as equations of the splines, and how they change with what is not exact.

Pixel p of view k, whose beam meets the face at (s, t), is one row ``v_p = D_p . V(s_p, t_p)``,
divided by its standard error. If the pose of its view is off, the face lies higher or the sheet is
thicker, the place and the direction cosines change:

    dv = dD . V + D . (V,s ds + V,t dt) + D . V,z dz.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp.field import View
from sldvexp.field.bounds.pose_uncertainty import POSE
from sldvexp.laser import TwoMirror, rays
from sldvexp.shell.love import ThinShell
from sldvexp.shell.outline import Outline
from sldvexp.typing import Array, BoolArray, IndexArray

#: Step of the differences by which places are differentiated, rad and m.
STEP = 1e-6


@dataclass(frozen=True, eq=False)
class ViewPixels:
    """Pixels of one view that see the structure.

    Attributes
    ----------
    view : View
    pixel : ndarray of int, shape (pixel,)
        Of the view's image.
    coordinates : ndarray, shape (pixel, 2), m
        Where they meet the face.
    cosine : ndarray, shape (pixel, 3)
        Direction cosines along t1, t2 and n.
    """

    view: View
    pixel: IndexArray
    coordinates: Array
    cosine: Array

    @classmethod
    def of(cls, view: View, laser: TwoMirror, outline: Outline, face: float) -> ViewPixels:
        """Follow the beams of all pixels without a flag to the face, so high above the splines."""
        pixel = np.flatnonzero(np.asarray(view.flags) == 0)
        coordinates, cosine, meets = _met(view, laser, outline, face, pixel)
        kept = np.flatnonzero(meets)
        kept = kept[outline.holds(coordinates[kept])]
        return cls(view, pixel[kept], coordinates[kept], cosine[kept])

    def seen_from(self, pose: Array, laser: TwoMirror, outline: Outline, face: float) -> ViewPixels:
        """Follow the same pixels' beams from a pose that is off by a rotation vector and origin."""
        view = self.view.moved(pose)
        coordinates, cosine, _ = _met(view, laser, outline, face, self.pixel)
        return ViewPixels(view, self.pixel, coordinates, cosine)

    def changes(self, laser: TwoMirror, outline: Outline, face: float) -> tuple[Array, Array]:
        """Differentiate place and cosines by the pose and by the face's height.

        Returns
        -------
        place : ndarray, shape (pixel, 2, 7), m/rad and 1
        cosine : ndarray, shape (pixel, 3, 7), 1/rad and 1/m
        """
        place, cosine = [], []
        for i in range(POSE + 1):
            by = STEP * np.eye(POSE + 1)[i]
            ahead = self.seen_from(by[:POSE], laser, outline, face + by[POSE])
            behind = self.seen_from(-by[:POSE], laser, outline, face - by[POSE])
            place.append((ahead.coordinates - behind.coordinates) / (2 * STEP))
            cosine.append((ahead.cosine - behind.cosine) / (2 * STEP))
        return np.stack(place, axis=-1), np.stack(cosine, axis=-1)

    def design(self, shell: ThinShell, face: float) -> Array:
        """Make the rows, shape (pixel, coefficient)."""
        velocity = shell.velocity(self.coordinates, face)
        return np.asarray(
            sum(d[:, None] * of for d, of in zip(self.cosine.T, velocity, strict=True))
        )


def _met(
    view: View, laser: TwoMirror, outline: Outline, face: float, pixel: IndexArray
) -> tuple[Array, Array, BoolArray]:
    """Follow beams of some pixels to the face."""
    own = view.laser(laser)
    start, along = rays(own.angle_from_dac(view.dac[pixel]), own.mirror_offset)
    begin, way = view.origin + start @ view.rotation, along @ view.rotation
    return outline.chart.met(begin, way, face)
