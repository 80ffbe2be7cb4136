"""`instrument=simulated`: the virtual lab inside this process."""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

from sldvexp.config.registry import register
from sldvexp.errors import UserError
from sldvexp.instrument.protocol import Instrument, ScanningPlugin
from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.targets.base import Target
from sldvexp.virtual_lab.lab import VirtualLab


@register("instrument", "simulated")
@dataclass
class Simulated(ScanningPlugin):
    """A scene's virtual lab, without a socket."""

    real = False

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
            If there is no scene, or it has no such view or does not fit the target.
        """
        if scene is None:
            raise UserError("instrument=simulated needs a scene; choose scene=calibration or plate")
        lab = VirtualLab(scene, laser, target, seed)
        if view:
            lab.use_view(view)
        return lab
