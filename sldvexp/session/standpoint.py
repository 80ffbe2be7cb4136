"""What is at hand while a session is in one view."""

from __future__ import annotations

from dataclasses import dataclass

from sldvexp.laser.two_mirror import TwoMirror
from sldvexp.session.camera import Camera
from sldvexp.session.operator import Operator
from sldvexp.targets.base import Target


@dataclass(frozen=True)
class Standpoint:
    """One view, from the first pixel to the last.

    Attributes
    ----------
    view : str
    camera : Camera
        Its `instrument` is opened when something asks for it.
    laser : TwoMirror
    target : Target or None
    operator : Operator
    """

    view: str
    camera: Camera
    laser: TwoMirror
    target: Target | None
    operator: Operator
