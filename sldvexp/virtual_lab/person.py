"""The person in the virtual lab: points by eye, holds the digitizer, and errs as people do."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sldvexp.instrument.person import Mark, Place, Steps

if TYPE_CHECKING:
    from sldvexp.virtual_lab.lab import VirtualLab


class SimulatedPerson:
    """A `Person` who knows the truth but for the errors that the scene states.

    Errors belong to the seed, the view and the mark or spot: who points again points the same.

    Parameters
    ----------
    lab : VirtualLab
    """

    def __init__(self, lab: VirtualLab) -> None:
        self.lab = lab

    def true_position(self, mark: Mark) -> np.ndarray:
        """Where a mark truly stands, shape (3,), m: within its accuracy, from anywhere the same."""
        if not self.lab.scene.operator.mark_error:
            return mark.position
        bound = math.sqrt(3.0) * mark.std
        return mark.position + bound * self.lab.generator(f"mark {mark.number}").uniform(-1, 1, 3)

    def aim(self, mark: Mark, start: Steps) -> Steps:
        """See `Person`; all marks can be seen from everywhere."""
        lab = self.lab
        true = self.true_position(mark)
        light = lab.light(lab.true_dac(true)[None])
        radius = light.radius(np.linalg.norm(true - light.origin, axis=1))
        rng = lab.generator(f"aim at {mark.number} in {lab.view}")
        # The part of it along the beam moves nothing.
        off = lab.scene.operator.pointing * radius * rng.standard_normal(3)
        up_down, left_right = np.rint(lab.true_dac(true + off)).astype(int).tolist()
        lab.move((up_down, left_right))
        return up_down, left_right

    def digitise(self, spot: int, samples: int) -> list[Place]:
        """See `Person`."""
        rng = self.lab.generator(f"digitise {spot} in {self.lab.view}")
        error = self.lab.scene.operator.digitizer * rng.standard_normal((samples, 3))
        return [(x, y, z) for x, y, z in (self.lab.spot() + error).tolist()]
