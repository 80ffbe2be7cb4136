"""`export=gif`: the moving surface for slides, mail and web pages."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from sldvexp import plot
from sldvexp.config.registry import register
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import Checks
from sldvexp.export.moving_picture import MovingPicture
from sldvexp.writing import whole_or_nothing

#: A GIF counts time in steps of so many seconds; players take less than two of them for a mistake.
STEP, FEWEST_STEPS = 0.01, 2
#: Colours of the 256 that a GIF may have: of paper and letters, the scale, and the surface.
GREYS, SCALE, OWN = 18, 18, 220
#: Almost as bright as 255.
ALMOST = 247


@register("export", "gif")
@dataclass
class Gif(MovingPicture):
    """Surface in motion at one frequency as a GIF, which plays in slides, mail and browsers.

    One period, repeated without end. Colours say strain or amplitude, which stay; a grey line is
    where the rim rests. The title says the frequency and by how much displacements are enlarged.
    ``fps`` must be 100 over a whole number of 2 or more, such as 50, 25, 20, 12.5 or 10.
    """

    fps: float = 12.5

    suffix = ".gif"

    def check(self, checks: Checks) -> None:
        """Note frames whose duration a GIF cannot hold."""
        super().check(checks)
        if self.fps > 0:
            steps = 1 / self.fps / STEP
            whole = steps > FEWEST_STEPS - 0.5 and abs(steps - round(steps)) < 1e-6
            checks.require(whole, "fps", "must be 100 over a whole number, 50 at most")

    def write(self, run: RunData, path: Path) -> None:
        """Write the frames, whose colours are those that all of them have most.

        Raises
        ------
        UserError
            If places are not known, or the frequency, or there is no strain to be shown.
        """
        pictures = list(self.pictures(run, "gif"))
        first, *others = _with_few_colours(pictures)
        with whole_or_nothing(path) as beside:
            first.save(
                beside,
                save_all=True,
                append_images=others,
                duration=round(1000 / self.fps),
                loop=0,
                optimize=False,
            )


def _with_few_colours(pictures: list[NDArray[np.uint8]]) -> list[Image.Image]:
    """Give all frames the same colours, so that nothing flickers."""
    greys = np.linspace(0, 255, GREYS).repeat(3)
    scale = 255 * plot.size_colours(np.linspace(0.0, 1.0, SCALE), np.zeros(SCALE, bool))
    some = Image.fromarray(np.concatenate(pictures[:: max(1, len(pictures) // 8)]))
    own = np.array(some.quantize(OWN, dither=Image.Dither.NONE).getpalette())
    own[own > ALMOST] = 255  # or white becomes what is next to it
    chosen = Image.new("P", (1, 1))
    chosen.putpalette(np.concatenate([greys, scale.ravel(), own]).round().astype(int).tolist())
    return [
        Image.fromarray(one).quantize(palette=chosen, dither=Image.Dither.NONE) for one in pictures
    ]
