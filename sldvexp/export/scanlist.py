"""`export=scanlist`: the pixels of a velocity image as the legacy `ScanList` (Appendix A)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from sldvexp.config.registry import register
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import UserError
from sldvexp.export.base import Export, one_view
from sldvexp.io import write_list


@register("export", "scanlist")
@dataclass
class ScanList(Export):
    """DAC steps of all pixels of one view's image, one pair a line: left-right, then up-down.

    The order is that of the pixels in the image. ``scan=list`` reads the file, so that the same
    pixels can be scanned again.

    Parameters
    ----------
    view : str
        Which is written, if the run has several.
    """

    suffix = ".txt"
    called: ClassVar[str] = "scanlist"
    groups: ClassVar[tuple[str, ...]] = ("image/",)

    view: str = ""

    def write(self, run: RunData, path: Path) -> None:
        """Write the file."""
        images = run.below("image", "dac")
        if not images:
            raise UserError(
                "export=scanlist needs velocity images in DAC steps: choose scan=rectangle, "
                "scan=list or scan=session"
            )
        view = one_view("scanlist", self.view, images)
        dac = images[view]["dac"].sel(mirror=["up_down", "left_right"]).transpose("pixel", ...)
        steps = np.rint(dac.values).astype(np.int64)
        if not np.array_equal(steps, dac.values):
            raise UserError(
                f"export=scanlist: the image of view {view} has pixels between whole DAC steps, "
                "which the file cannot hold"
            )
        write_list(path, steps.tolist())
