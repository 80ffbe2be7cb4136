"""`scene=calibration`: the calibration object, its speakers moving behind resting washers."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError, nearest
from sldvexp.targets.base import Target
from sldvexp.targets.circles import Circles
from sldvexp.virtual_lab.scene import Scene
from sldvexp.virtual_lab.scene_object import SceneObject


@dataclass
class Speaker:
    """A speaker, moving as a piston along the normal of its washer's plane.

    Parameters
    ----------
    velocity : float, m/s per V of excitation
        Peak; 0 is a dead speaker.
    phase : float, rad
        Of the velocity towards the viewer, relative to the excitation.
    """

    velocity: float = 0.01
    phase: float = 0.0

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what no speaker can be."""
        checks.non_negative(f"{name}.velocity", self.velocity)
        checks.finite(f"{name}.phase", self.phase)


@register("scene", "calibration")
@dataclass
class Calibration(Scene):
    """The calibration object of Section 4.4 in front of the instrument.

    Parameters
    ----------
    speaker : Speaker
        Behind every circle that `speakers` does not list.
    speakers : dict of int to Speaker
        Other speakers, by the circle's number.
    washer : float, m
        Width of the resting rim around every circle; it hides what is behind.
    machine_error : bool
        Whether the true circles differ from the configured ones by as much as the machine that
        measured them may err: every coordinate, diameter and height, uniformly within +-accuracy.
    mirrored : bool
        The true object is the mirror image of ``target``, left and right of its middle.
    """

    speaker: Speaker = field(default_factory=Speaker)
    speakers: dict[int, Speaker] = field(default_factory=dict)
    washer: float = 0.01
    machine_error: bool = True
    mirrored: bool = False

    def check(self, checks: Checks) -> None:
        """Note what is wrong with the speakers and washers."""
        self.speaker.check(checks, "speaker")
        for number, speaker in self.speakers.items():
            speaker.check(checks, f"speakers.{number}")
        checks.non_negative("washer", self.washer)

    def objects(self, target: Target | None, rng: np.random.Generator) -> list[SceneObject]:
        """The calibration object."""
        from sldvexp.virtual_lab.calibration_object import CalibrationObject

        if not isinstance(target, Circles):
            found = "null" if target is None else type(target).__name__.lower()
            raise UserError(
                f"the virtual lab's calibration object needs circles, but target is {found}; "
                "choose target=dissertation or another target of circles"
            )
        for number in self.speakers:
            if number not in target.circles:
                numbers = (str(n) for n in target.circles)
                raise UserError(
                    f"scene.speakers.{number}: the calibration object has no circle {number}; "
                    f"{nearest(str(number), numbers)}"
                )
        speakers = {n: self.speakers.get(n, self.speaker) for n in target.circles}
        errors = rng if self.machine_error else None
        built = CalibrationObject.built(target, speakers, self.washer, self.residual, errors)
        return [built.mirror_image() if self.mirrored else built]
