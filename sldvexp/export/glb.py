"""`export=glb`: the moving surface for browsers, Blender and slides.

A node is drawn at p + s Re(V exp(i phi)) = p + cos(phi) s Re V - sin(phi) s Im V, so that two morph
targets, s Re V and s Im V, with the weights cos(phi) and -sin(phi) are the whole motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from matplotlib import colormaps

from sldvexp.config.registry import register
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import Checks
from sldvexp.export.base import Export
from sldvexp.export.motion import Motion, MotionColour, motion_of
from sldvexp.export.velocities import describe
from sldvexp.io import glb
from sldvexp.plot import style
from sldvexp.typing import Array
from sldvexp.writing import whole_or_nothing

#: Instants of a period, between which players go straight: the circle of the weights is met to
#: 1 - cos(pi / 60) = 0.14 %.
INSTANTS = 60
#: Colour of what is not determined.
UNKNOWN = (0.6, 0.6, 0.6)


@register("export", "glb")
@dataclass
class Glb(Export):
    """The surface in motion at one frequency, glTF 2.0 (binary), for browsers and Blender.

    Triangles, or points and the lines between them, with two morph targets, real and imaginary
    part of the velocity as they are drawn, and an animation of their weights over one period, which
    players repeat. Positions are those of the run, in m; the file's only node turns z upwards.
    Drawn metres for 1 m/s, the frequency, what the colours say with their range and unit, and the
    conventions are in the mesh's ``extras``. What is not determined is grey and rests.

    Parameters
    ----------
    frequency : float, optional
        Of the motion in Hz; without it, the strongest of the surface.
    colour : MotionColour, optional
        What colours say; without it strain, if the run has it, else amplitude.
    seconds : float
        Duration of a drawn period.
    """

    frequency: float | None = None
    colour: MotionColour | None = None
    seconds: float = 2.5

    suffix = ".glb"
    called: ClassVar[str] = "motion"

    def __post_init__(self) -> None:
        checks = Checks()
        if self.frequency is not None:
            checks.positive("frequency", self.frequency)
        checks.positive("seconds", self.seconds)
        checks.done()

    def write(self, run: RunData, path: Path) -> None:
        """Write the file.

        Raises
        ------
        UserError
            If places are not known, or the frequency, or there is no strain to be shown.
        """
        motion = motion_of(run, "glb", self.frequency, self.colour)
        turn = np.linspace(0.0, 2 * np.pi, INSTANTS + 1)
        made = glb(
            motion.position,
            motion.cells,
            {"real": motion.drawn.real, "imaginary": motion.drawn.imag},
            _colours(motion),
            self.seconds * turn / (2 * np.pi),
            np.column_stack([np.cos(turn), -np.sin(turn)]),
            "motion" if motion.hertz is None else f"{motion.hertz:g} Hz",
            describe(run) | _told(motion),
        )
        with whole_or_nothing(path) as beside:
            beside.write_bytes(made)


def _told(motion: Motion) -> dict[str, Any]:
    """Say what is drawn, and what its colours mean."""
    return {
        "frequency_hz": motion.hertz,
        "metres_drawn_per_metre_per_second": motion.scale,
        "colour": motion.title,
        "colour_unit": motion.unit,
        "colour_range": [0.0, motion.largest],
    }


def _colours(motion: Motion) -> Array:
    """Colour the nodes, shape (node, 3)."""
    known = np.isfinite(motion.value)
    share = np.where(known, motion.value, 0.0) / (motion.largest or 1.0)
    return np.where(known[:, None], colormaps[style.SIZE_MAP](share)[:, :3], UNKNOWN)
