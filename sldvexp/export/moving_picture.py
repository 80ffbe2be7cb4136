"""Frames of the moving surface, from which moving pictures are made."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sldvexp import plot
from sldvexp.dataset import FREQUENCY
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import Checks
from sldvexp.export.motion import Motion, MovingExport, motion_of
from sldvexp.plot.moving_look import AZIMUTH, ELEVATION

#: Pixels of a side: fewer leave no room for the scale, more take minutes.
FEWEST_PIXELS, MOST_PIXELS = 160, 2160
#: Frames of a period: fewer show no direction, more take minutes.
FEWEST_FRAMES, MOST_FRAMES = 4, 250


@dataclass
class MovingPicture(MovingExport):
    """Base of the moving pictures: a whole number of frames a period, seen as on the page.

    Parameters
    ----------
    width : int
        Of the picture in pixels.
    height : int
        Of the picture in pixels.
    fps : float
        Frames a second; a period has the nearest whole number of them.
    azimuth : float
        Of the eye about the z axis in degrees, from x.
    elevation : float
        Of the eye above the plane of x and y in degrees.
    """

    width: int = 640
    height: int = 400
    fps: float = 25.0
    azimuth: float = AZIMUTH
    elevation: float = ELEVATION

    def check(self, checks: Checks) -> None:
        """Note sizes that make no picture."""
        for side in ("width", "height"):
            fits = FEWEST_PIXELS <= getattr(self, side) <= MOST_PIXELS
            checks.require(fits, side, f"must be {FEWEST_PIXELS} to {MOST_PIXELS} pixels")
        checks.positive("fps", self.fps)
        checks.finite("azimuth", self.azimuth)
        checks.finite("elevation", self.elevation)
        frames = self.fps * self.seconds
        if np.isfinite(frames) and frames > 0:
            few = FEWEST_FRAMES <= round(frames) <= MOST_FRAMES
            told = f"must give {FEWEST_FRAMES} to {MOST_FRAMES} frames a period, not {frames:g}"
            checks.require(few, "fps", told)

    @property
    def frames(self) -> int:
        """Frames of a period."""
        return round(self.fps * self.seconds)

    def pictures(self, run: RunData, format_name: str) -> Iterator[NDArray[np.uint8]]:
        """Draw the frames of a period, the first at phase 0, shape (height, width, 3).

        Raises
        ------
        UserError
            If places are not known, or the frequency, or there is no strain to be shown.
        """
        motion = motion_of(run, format_name, self.frequency, self.colour)
        shape = plot.MovingShape(
            motion.position,
            motion.cells,
            motion.drawn,
            motion.value,
            motion.faint,
            _title(motion),
            motion.title,
            motion.unit,
            (self.width, self.height),
            self.azimuth,
            self.elevation,
        )
        for k in range(self.frames):
            yield shape.picture(2 * np.pi * k / self.frames)


def _title(motion: Motion) -> str:
    """Say the frequency, and by how much displacements are enlarged."""
    if not motion.enlarged:
        return f"1 mm/s drawn as {motion.scale:.2g} mm" if motion.scale else "at rest"
    times = float(f"{motion.enlarged:.2g}")
    return f"{motion.hertz:g} {FREQUENCY.units}, displacement × {times:g}"
