"""Lines of all views' pixels, and how their noise depends on pixel and line.

Every pixel without a flag is a response function of its own, to one excitation. Its noise is taken
as a product, ``std_dl = a_d b_l`` of pixel d and line l: that of the light times the spectrum of
the receiver's. The factors are means over many estimates, so that weights have none of the scatter
of standard errors that a few records tell.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, ComplexArray, IndexArray

#: Lines of two views are the same if they differ by less, relatively.
SAME_LINE = 1e-9


@dataclass(frozen=True, eq=False)
class ViewResponses:
    """Response functions of one view's pixels.

    Parameters
    ----------
    name : str
    velocity : ndarray of complex, shape (pixel, line), m/s
        For the nominal excitation.
    std : ndarray, shape (pixel, line), m/s
        Per real and imaginary part.
    every_line : ndarray of complex, shape (pixel, line of the image), m/s
        All lines as they were measured.
    """

    name: str
    velocity: ComplexArray
    std: Array
    every_line: ComplexArray


@dataclass(frozen=True, eq=False)
class Responses:
    """Response functions of all views, read view by view, so that one is in memory at a time.

    Parameters
    ----------
    frequency : ndarray, shape (line,), Hz
        In rising order.
    images : mapping of str to xarray.Dataset
        Groups ``image/<view>`` by the name of the view.
    place : ndarray of int, shape (line,)
        Places of the lines in the images.
    reference : ndarray, shape (line,), V or N, optional
        Amplitude of the reference that the images' velocities belong to.
    """

    frequency: Array
    images: Mapping[str, xr.Dataset]
    place: IndexArray
    reference: Array | None = None

    @classmethod
    def from_images(
        cls,
        images: Mapping[str, xr.Dataset],
        band: tuple[float, float] | None = None,
        left_out: Sequence[float] = (),
    ) -> Responses:
        """Take the lines of a band of images that all have the same lines.

        Parameters
        ----------
        images : mapping of str to xarray.Dataset
            By the name of the view.
        band : pair of float, Hz, optional
        left_out : sequence of float, Hz
            Lines that are not taken.

        Raises
        ------
        UserError
            If there are no images, their lines differ, or none lies in the band.
        """
        if not images:
            raise UserError("needs velocity images: scan the structure from some views")
        first = next(iter(images))
        if "frequency" not in images[first].dims:
            raise UserError(
                f"view {first}: has one line without a name; modes need the lines of a band, as "
                "scan.sampling.frequency=[55,60,65,...]"
            )
        lines = np.asarray(images[first]["frequency"].values, float)
        for name, image in images.items():
            own = image["frequency"].values if "frequency" in image.dims else np.zeros(0)
            if own.shape != lines.shape or not np.allclose(own, lines, rtol=SAME_LINE, atol=0):
                raise UserError(f"view {name}: has other lines than view {first}")
        if not any((image["flags"].values == 0).any() for image in images.values()):
            raise UserError("there is no pixel without a flag in any view")
        place = np.argsort(lines, kind="stable")
        if band is not None:
            low, high = band
            place = place[(lines[place] >= low) & (lines[place] <= high)]
            if not len(place):
                raise UserError(f"band: no line lies between {low:g} and {high:g} Hz")
        for hertz in left_out:
            same = np.isclose(lines[place], hertz, rtol=SAME_LINE, atol=0)
            if not same.any():
                raise UserError(f"leave_out: there is no line at {hertz:g} Hz")
            place = place[~same]
        if (twice := np.flatnonzero(np.diff(lines[place]) <= 0)).size:
            raise UserError(f"the line at {lines[place][twice[0]]:g} Hz is there twice")
        return cls(lines[place], images, place, _reference(images, place))

    @property
    def nominal(self) -> float:
        """Amplitude of the reference that velocities are told for, V or N; NaN if unknown."""
        if self.reference is None:
            return float("nan")
        return float(np.sqrt(np.mean(self.reference**2)))

    @property
    def every_line(self) -> Array:
        """Lines of the images, used or not, in the images' order, Hz."""
        return np.asarray(next(iter(self.images.values()))["frequency"].values, float)

    @property
    def level(self) -> Array:
        """Factors from the images' velocities to those for the nominal excitation, (line,)."""
        if self.reference is None:
            return np.ones(len(self.place))
        return self.nominal / self.reference

    def _std(self, image: xr.Dataset) -> Array:
        """Read the standard errors of an image, (pixel, line)."""
        std = image["velocity_std"].values.astype(float)
        std = std[:, self.place] if std.ndim == 2 else std[:, None]
        return np.asarray(std * self.level)

    def views(self, flagged: bool = False) -> Iterator[ViewResponses]:
        """Read view after view, with pixels that have a flag or without them."""
        for name, image in self.images.items():
            pixel = np.flatnonzero((image["flags"].values == 0) | flagged)
            every = np.asarray(image["velocity"].values[pixel], complex)
            seen = np.asarray(every[:, self.place] * self.level, complex)
            yield ViewResponses(name, seen, self._std(image)[pixel], every)

    def noise(self) -> tuple[dict[str, Array], Array]:
        """Find the factors of the noise.

        Returns
        -------
        pixel : dict of str to ndarray, shape (pixel,), m/s
            Of every view, the root of the mean over lines.
        line : ndarray, shape (line,)
            Root of the mean of the squares over all pixels, in units of the pixel's.
        """
        line, pixel = np.ones(len(self.place)), {}
        for _ in range(2):  # weights of lines by rough factors of the pixels, then these again
            squares = np.zeros(len(line))
            for name, image in self.images.items():
                std = self._std(image)[image["flags"].values == 0]
                if not (np.isfinite(std) & (std > 0)).all():
                    raise UserError(f"view {name}: has unflagged pixels of unknown noise")
                pixel[name] = np.sqrt(np.mean((std / line) ** 2, axis=1))
                squares += np.sum((std / pixel[name][:, None]) ** 2, axis=0)
            line = np.sqrt(squares / sum(map(len, pixel.values())))
        return pixel, line

    def power(self) -> Array:
        """Compute the mean square of a part of all unflagged pixels' velocities over their noise.

        Returns
        -------
        ndarray, shape (line of the images,)
            For the excitation as it was; the noise is that of a pixel's factor, see `noise`.
        """
        pixel, squares = self.noise()[0], np.zeros(len(self.every_line))
        for view in self.views():
            squares += np.sum(np.abs(view.every_line / pixel[view.name][:, None]) ** 2, axis=0) / 2
        return squares / sum(map(len, pixel.values()))


def _reference(images: Mapping[str, xr.Dataset], place: IndexArray) -> Array | None:
    """Read the mean amplitude of the reference over the views, if all know it."""
    known = [image["reference_amplitude"] for image in images.values() if _knows(image)]
    if len(known) < len(images):
        return None
    found = np.mean([k.values for k in known], axis=0)[place]
    return np.asarray(found) if (found > 0).all() else None


def _knows(image: xr.Dataset) -> bool:
    return "reference_amplitude" in image
