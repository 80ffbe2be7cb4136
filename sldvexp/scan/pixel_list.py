"""`scan=list`: any pixels, one by one (the legacy `ScanList`, Appendix A)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.io import read_list
from sldvexp.scan.base import ImageScan, Sampling, check_pairs, check_view_names
from sldvexp.typing import IntArray

#: Pixels that are scanned and kept at a time.
LINE = 64


@dataclass
class PixelSequence:
    """Pixels of a view, in the order of the scan, DAC steps (up_down, left_right).

    Parameters
    ----------
    dac : list of pairs
    path : str
        A legacy file of them (`ScanList`), instead.
    """

    dac: list[list[int]] = field(default_factory=list)
    path: str = ""


@register("scan", "list")
@dataclass
class PixelList(ImageScan):
    """A list of pixels for each view.

    Parameters
    ----------
    views : dict of str to PixelSequence
    sampling : Sampling
    """

    views: dict[str, PixelSequence] = field(default_factory=dict)
    sampling: Sampling = field(default_factory=Sampling)

    def __post_init__(self) -> None:
        checks = Checks()
        check_view_names(checks, self.views)
        for name, pixels in self.views.items():
            check_pairs(checks, f"views.{name}", "dac", pixels.dac, pixels.path)
        self.sampling.check(checks, "sampling")
        checks.done()

    def lines(self, view: str) -> list[IntArray]:
        """See `ImageScan`; every `LINE` pixels are a line."""
        given = self.views[view]
        dac = read_list(locate(given.path)) if given.path else np.array(given.dac, np.int64)
        return [dac[first : first + LINE] for first in range(0, len(dac), LINE)]
