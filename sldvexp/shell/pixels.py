"""Pixels of all views as equations of the splines, and how they change with what is not exact.

Pixel p of view k, whose beam meets the face at (s, t), is one row ``v_p = D_p . V(s_p, t_p)``,
divided by its standard error. Of views from behind the place is as far below the middle as the face
is above it. If the pose of its view is off, the face lies higher or the sheet is
thicker, the place and the direction cosines change:

    dv = dD . V + D . (V,s ds + V,t dt) + D . V,z dz.

A beam ``b + r w`` that moves by db and dw moves the point by ``db + r dw``, and on along the beam
until it is in the surface again: by d along the surface. With the stretch of lengths at the height,
J, kappa and g (see `sldvexp.shell.chart`), and D = -(t1, t2, n) w, the change of place is
``dl = (1 + z kappa)^-1 d``, ``(ds, dt) = J' dl``, and the axes turn by kappa dl and g dl.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sldvexp.field import View
from sldvexp.field.bounds.pose_uncertainty import POSE
from sldvexp.laser import TwoMirror, rays
from sldvexp.shell.chart import slide
from sldvexp.shell.linear_form import LinearForm, summed
from sldvexp.shell.love import ThinShell
from sldvexp.shell.outline import Outline
from sldvexp.typing import Array, IndexArray


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
    side : int
        1 if the view sees the face, -1 if it sees the back.
    """

    view: View
    pixel: IndexArray
    coordinates: Array
    cosine: Array
    side: int = 1

    @classmethod
    def of(cls, view: View, laser: TwoMirror, outline: Outline, face: float) -> ViewPixels:
        """Follow the beams of all pixels without a flag to the side that the view looks at.

        Parameters
        ----------
        face : float, m
            Height of the face above the splines; the back is as far below.
        """
        pixel, side = np.flatnonzero(np.asarray(view.flags) == 0), outline.side_towards(view.origin)
        own = beams(view, laser, pixel)
        coordinates, cosine, meets = outline.chart.met(*own, side * face, side=side)
        kept = np.flatnonzero(meets & (np.abs(cosine[:, 2]) >= outline.steepest))
        kept = kept[outline.holds(coordinates[kept])]
        return cls(view, pixel[kept], coordinates[kept], cosine[kept], side)

    def part(self, some: slice) -> ViewPixels:
        """Keep some of the pixels."""
        return replace(
            self,
            pixel=self.pixel[some],
            coordinates=self.coordinates[some],
            cosine=self.cosine[some],
        )

    def seen_from(
        self, pose: Array, laser: TwoMirror, outline: Outline, face: float, higher: float
    ) -> ViewPixels:
        """Follow the same pixels' beams from a pose that is off by a rotation vector and origin.

        Parameters
        ----------
        face : float, m
            Height of the face above the splines.
        higher : float, m
            By which the surface lies above where it is given.
        """
        view = self.view.moved(pose)
        moved, height = beams(view, laser, self.pixel), self.side * face + higher
        coordinates, cosine, _ = outline.chart.met(*moved, height, self.coordinates, self.side)
        return replace(self, view=view, coordinates=coordinates, cosine=cosine)

    def changes(
        self,
        laser: TwoMirror,
        outline: Outline,
        face: float,
        higher: float = 0.0,
        others: Sequence[tuple[Array, Array]] = (),
    ) -> tuple[Array, Array]:
        """Differentiate place and cosines by the pose, other errors, and the surface's height.

        Parameters
        ----------
        face, higher : float, m
            See `seen_from`.
        others : sequence of pair of ndarray, shape (pixel, 3) each
            What they do to starts, m, and directions of the beams.

        Returns
        -------
        place : ndarray, shape (pixel, 2, 6 + others + 1), m/rad and 1
        cosine : ndarray, shape (pixel, 3, 6 + others + 1), 1/rad and 1/m
        """
        view, height = self.view, self.side * face + higher
        begin, way = beams(view, laser, self.pixel)
        frames, forms = (
            outline.chart.frames(self.coordinates),
            outline.chart.forms(self.coordinates),
        )
        far = np.einsum("pi,pi->p", outline.chart.points(self.coordinates, height) - begin, way)
        start, turned = (np.zeros((len(way), 3, POSE + len(others) + 1)) for _ in range(2))
        # R turned by a small e about an axis a of the laser: R' (x - e a x x) for all x
        turned[:, :, :3] = -np.cross(view.rotation[:, None], way).transpose(1, 2, 0)
        start[:, :, :3] = -np.cross(view.rotation[:, None], begin - view.origin).transpose(1, 2, 0)
        start[:, :, 3:POSE], start[:, :, -1] = np.eye(3), -frames[:, 2]
        for k, (of_start, of_way) in enumerate(others, POSE):
            start[:, :, k], turned[:, :, k] = of_start, of_way
        moved = start + far[:, None, None] * turned
        step = forms.along(height, slide(frames, moved, way))
        cosine = -(frames @ turned)
        bent = forms.curvature @ step
        about = (forms.turn[:, None] @ step)[:, 0]
        one, two, normal = self.cosine.T[:, :, None]
        cosine[:, 0] += about * two - bent[:, 0] * normal
        cosine[:, 1] += -about * one - bent[:, 1] * normal
        cosine[:, 2] += bent[:, 0] * one + bent[:, 1] * two
        return forms.rate.swapaxes(1, 2) @ step, cosine

    def design(self, shell: ThinShell, face: float) -> Array:
        """Make the rows, shape (pixel, coefficient)."""
        (rows,) = shell.rows(self.coordinates, [self._seen(shell, face)])
        return rows

    def predicted(self, shell: ThinShell, theta: Array, face: float) -> Array:
        """Compute velocities of the pixels from coefficients, (coefficient, column)."""
        return shell.values(theta, self.coordinates, [self._seen(shell, face)])[:, 0]

    def motion(self, shell: ThinShell, face: float, i: int = 0, j: int = 0) -> list[LinearForm]:
        """Make the forms of u, v and w where the beams end, or of derivatives by s and t."""
        return shell.motion(self.coordinates, self.side * face, i, j)

    def _seen(self, shell: ThinShell, face: float) -> LinearForm:
        """Make the form of the motion along the beams."""
        motion = self.motion(shell, face)
        return summed([own * toward for own, toward in zip(motion, self.cosine.T, strict=True)])


def beams(
    view: View, laser: TwoMirror, pixel: IndexArray, off: Array | float = 0.0
) -> tuple[Array, Array]:
    """Compute starts, m, and unit vectors of beams in the world, shape (pixel, 3) each.

    Parameters
    ----------
    off : float or ndarray, shape (2,)
        DAC steps by which mirrors stand beside where they are sent, (up_down, left_right).
    """
    own = view.laser(laser)
    start, along = rays(own.angle_from_dac(view.dac[pixel] + off), own.mirror_offset)
    return view.origin + start @ view.rotation, along @ view.rotation


def beams_by_step(view: View, laser: TwoMirror, pixel: IndexArray) -> list[tuple[Array, Array]]:
    """Differentiate starts, m, and directions of beams by each mirror's DAC step."""
    found = []
    for half in np.eye(2) / 2:
        (begin, way), (start, along) = (beams(view, laser, pixel, o) for o in (half, -half))
        found.append((begin - start, way - along))
    return found
