"""`instrument=replay`: a recorded session in the place of an instrument."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

from omegaconf import MISSING

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.instrument.base import ScanningPlugin
from sldvexp.instrument.protocol import Instrument
from sldvexp.instrument.recording import Recording
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.targets.base import Target


@register("instrument", "replay")
@dataclass
class Replay(ScanningPlugin):
    """The scan lines that an earlier run kept, so that they can be processed anew.

    Parameters
    ----------
    path : str
        Folder of that run.
    """

    real = False
    path: str = MISSING

    def open(
        self,
        scene: Any,
        laser: TwoMirror,
        target: Target | None = None,
        seed: int = 0,
        view: str = "",
    ) -> AbstractContextManager[Instrument]:
        """See `ScanningPlugin`.

        Raises
        ------
        UserError
            If the run has no scan lines of that view.
        """
        return Recording(locate(self.path), view)
