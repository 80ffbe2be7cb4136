"""`export=glb`: the moving surface for browsers, Blender and slides.

A node is drawn at p + s Re(V exp(i phi)) = p + cos(phi) s Re V - sin(phi) s Im V, so that two morph
targets, s Re V and s Im V, with the weights cos(phi) and -sin(phi) are the whole motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sldvexp import plot
from sldvexp.config.registry import register
from sldvexp.dataset.run_data import RunData
from sldvexp.export.motion import Motion, MovingExport, motion_of
from sldvexp.export.velocities import describe
from sldvexp.io import glb
from sldvexp.writing import whole_or_nothing

#: Instants of a period, between which players go straight: the circle of the weights is met to
#: 1 - cos(pi / 60) = 0.14 %.
INSTANTS = 60


@register("export", "glb")
@dataclass
class Glb(MovingExport):
    """Surface in motion at one frequency, glTF 2.0 (binary), for browsers and Blender.

    Triangles, or points and the lines between them, with two morph targets, real and imaginary
    part of the velocity as they are drawn, and an animation of their weights over one period, which
    players repeat. Positions are those of the run, in m; the file's only node turns z upwards.
    Drawn metres for 1 m/s, the frequency, what the colours say with their range and unit, and the
    conventions are in the mesh's ``extras``. What is not determined is grey and rests; what is
    below its bound is pale.
    """

    suffix = ".glb"

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
            plot.size_colours(motion.value, motion.faint),
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
        "displacement_enlarged_by": motion.enlarged,
        "colour": motion.title,
        "colour_unit": motion.unit,
        "colour_range": [0.0, float(np.nan_to_num(motion.value).max())],
        "pale_below_their_bound": int(motion.faint.sum()),
    }
