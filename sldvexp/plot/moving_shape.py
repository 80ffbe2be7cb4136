"""Pictures of a surface in motion, one a phase: what moving pictures are made of.

A node is at p + Re(d exp(i phi)), with its deflection d as it is drawn. The eye stands at a
distance from the middle and sees p at (right.p, up.p) D / (D - toward.p); what is nearer is drawn
later. Colours say a value that stays, darker where the surface turns away from the light.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps, rcdefaults
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, TriMesh
from matplotlib.figure import Figure
from matplotlib.tri import Triangulation
from numpy.typing import NDArray

from sldvexp.geometry import rim
from sldvexp.plot import style
from sldvexp.plot.moving_look import PALE, PALENESS
from sldvexp.typing import Array, BoolArray, ComplexArray, IntArray

#: Colour of what has no value, and of what lies at rest.
UNKNOWN, REST = (0.6, 0.6, 0.6), "#999999"
#: Pixels of an inch, so that letters of 9 points are 12 pixels high.
DPI = 100
#: Where shape and scale are, as shares of the picture: left, bottom, width, height.
SHAPE_PLACE, SCALE_PLACE = (0.02, 0.02, 0.80, 0.88), (0.86, 0.15, 0.025, 0.55)
#: Distance of the eye, as a multiple of the shape's diagonal.
EYE = 2.5
#: Light of a surface that the light only grazes.
DARKEST = 0.55


def size_colours(value: Array, faint: BoolArray) -> Array:
    """Colour values from 0 to the largest, shape (n, 3) of 0 to 1.

    Parameters
    ----------
    value : ndarray, shape (n,)
        Grey where it is NaN.
    faint : ndarray of bool, shape (n,)
        Where colours are pale.

    Examples
    --------
    >>> value = np.array([np.nan, 2.0, 2.0])
    >>> size_colours(value, np.array([False, False, True])).round(2).tolist()
    [[0.6, 0.6, 0.6], [0.99, 0.91, 0.14], [0.95, 0.92, 0.73]]
    """
    known = np.isfinite(value)
    share = np.where(known, value, 0.0) / (np.nan_to_num(value).max() or 1.0)
    full = colormaps[style.SIZE_MAP](share)[:, :3]
    seen = np.where(faint[:, None], full + PALENESS * (PALE - full), full)
    return np.where(known[:, None], seen, UNKNOWN)


class MovingShape:
    """Pictures of a shape at any phase of its motion.

    Parameters
    ----------
    position : ndarray, shape (node, 3)
        At rest; z is upwards.
    cells : sequence of ndarray of int, shape (cell, corner)
        Triangles, lines or points, by nodes from 0.
    deflection : ndarray of complex, shape (node, 3)
        As it is drawn, in the unit of the positions.
    value : ndarray, shape (node,)
        That colours say; NaN where there is none.
    faint : ndarray of bool, shape (node,)
        Where the value is below its bound, and colours are pale.
    title, label, unit : str
        Above the shape, and of the scale, whose unit gets the prefix that suits it.
    pixels : tuple of (int, int)
        Width and height of the pictures.
    azimuth, elevation : float, deg
        Of the eye about the shape's middle.

    Examples
    --------
    >>> corner, up = np.eye(3), np.array([[0, 0, 0.0], [0, 0, 0], [0, 0, 0.1j]])
    >>> shape = MovingShape(corner, [np.arange(3)[None]], up, np.arange(3.0), np.zeros(3, bool),
    ...                     "197 Hz", "amplitude", "m/s", (160, 120), 20.0, 30.0)
    >>> shape.picture(0.0).shape
    (120, 160, 3)
    """

    def __init__(
        self,
        position: Array,
        cells: Sequence[IntArray],
        deflection: ComplexArray,
        value: Array,
        faint: BoolArray,
        title: str,
        label: str,
        unit: str,
        pixels: tuple[int, int],
        azimuth: float,
        elevation: float,
    ) -> None:
        self.middle = (position.min(axis=0) + position.max(axis=0)) / 2
        self.position, self.deflection = position - self.middle, deflection
        self.colour = size_colours(value, faint)
        self.diagonal = float(np.linalg.norm(np.ptp(position, axis=0))) or 1.0
        a, e = np.radians([azimuth, elevation])
        toward = [np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)]
        right = [-np.sin(a), np.cos(a), 0.0]
        self.axes_of_eye = np.array([right, np.cross(toward, right), toward])
        light = self.axes_of_eye.T @ [-0.3, 0.5, 1.0]
        self.light = light / np.linalg.norm(light)
        by_corners = {own.shape[1]: own for own in cells}
        self.triangles = by_corners.get(3, np.empty((0, 3), np.int64))
        self.lines = by_corners.get(2, np.empty((0, 2), np.int64))
        self.dots = by_corners.get(1, np.unique(self.lines))
        with style.settings_kept():
            rcdefaults()
            self.figure = Figure((pixels[0] / DPI, pixels[1] / DPI), DPI, facecolor="#ffffff")
            self.canvas = FigureCanvasAgg(self.figure)
            self.axes: Any = self.figure.add_axes(SHAPE_PLACE)
            notes = {"grey: unknown": ~np.isfinite(value), "pale: below\nits bound": faint}
            told = [f"{label},\n{{unit}}", *(note for note, where in notes.items() if where.any())]
            self._label(title, ";\n".join(told), unit, value)
            self._draw_rest()

    def picture(self, phase: float) -> NDArray[np.uint8]:
        """Draw the shape at a phase, rad, shape (height, width, 3) of red, green and blue."""
        place = self.position + (self.deflection * np.exp(1j * phase)).real
        seen, depth = self._seen(place)
        if len(self.triangles):
            nearer = np.argsort(depth[self.triangles].mean(axis=1), kind="stable")
            mesh = Triangulation(seen[:, 0], seen[:, 1], self.triangles[nearer])
            shades = self.colour * self._lit(place)[:, None]
            faces = self.axes.add_collection(TriMesh(mesh, facecolors=shades), autolim=False)
        self.joined.set_segments(list(seen[self.lines]))
        self.marks.set_offsets(seen[self.dots.ravel()])
        self.canvas.draw()
        if len(self.triangles):
            faces.remove()
        return np.asarray(self.canvas.buffer_rgba())[..., :3].copy()

    def _seen(self, place: Array) -> tuple[Array, Array]:
        """Project places onto the picture, shape (n, 2), and find how near to the eye they are."""
        across, up, near = self.axes_of_eye @ place.T
        distance = EYE * self.diagonal
        return np.stack([across, up], axis=1) * (distance / (distance - near))[:, None], near

    def _lit(self, place: Array) -> Array:
        """Find how bright the surface is at its nodes, 0 to 1; both sides are alike."""
        first, second, third = place[self.triangles].transpose(1, 0, 2)
        doubled = np.cross(second - first, third - first)
        normal = np.zeros_like(place)
        for corner in self.triangles.T:
            np.add.at(normal, corner, doubled)
        length = np.linalg.norm(normal, axis=1)
        return DARKEST + (1 - DARKEST) * np.abs(normal @ self.light) / np.where(length, length, 1.0)

    def _label(self, title: str, label: str, unit: str, value: Array) -> None:
        """Write the title, and the scale of the colours with its numbers."""
        factor, unit = style.prefixed(value, unit)
        most = float(factor * np.nan_to_num(value).max()) or 1.0
        self.figure.text(0.02, 0.98, title, va="top", fontsize=9)
        above, beside = SCALE_PLACE[1] + SCALE_PLACE[3] + 0.03, 0.98
        self.figure.text(beside, above, label.format(unit=unit), ha="right", fontsize=9)
        scale: Any = self.figure.add_axes(SCALE_PLACE)
        colours = np.linspace(0.0, most, 256)[:, None]
        look: dict[str, Any] = {"origin": "lower", "aspect": "auto", "cmap": style.SIZE_MAP}
        scale.imshow(colours, extent=(0, 1, 0, most), **look)
        scale.yaxis.tick_right()
        scale.xaxis.set_visible(False)
        scale.tick_params(labelsize=8)

    def _draw_rest(self) -> None:
        """Make axes that the whole motion fits in, and draw the rim or the lines at rest."""
        turn = np.exp(2j * np.pi * np.arange(12) / 12)
        every = [self._seen(self.position + (self.deflection * t).real)[0] for t in (0, *turn)]
        (left, bottom), (right, top) = (f(every, axis=(0, 1)) for f in (np.min, np.max))
        self.axes.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
        self.axes.set_axis_off()
        rest = list(every[0][rim(self.triangles) if len(self.triangles) else self.lines])
        look: dict[str, Any] = {"linewidths": 0.8, "clip_on": False}
        self.axes.add_collection(LineCollection(rest, colors=REST, **look), autolim=False)
        self.joined = LineCollection([], colors="#333333", **look)
        self.axes.add_collection(self.joined, autolim=False)
        look = {"edgecolors": "#000000", "linewidths": 0.3, "clip_on": False}
        colours = self.colour[self.dots.ravel()]
        self.marks = self.axes.scatter(*every[0][self.dots.ravel()].T, s=16, c=colours, **look)
