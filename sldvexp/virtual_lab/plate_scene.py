"""`scene=plate`: a vibrating plate or cylindrical panel beside the calibration object."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from sldvexp import dataset
from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.lazy import xarray as xr
from sldvexp.targets import Circles, Target
from sldvexp.typing import Array
from sldvexp.virtual_lab.beam import SceneObject
from sldvexp.virtual_lab.calibration_scene import CalibrationScene
from sldvexp.virtual_lab.plate import Plate, VibratingPlate


@register("scene", "plate")
@dataclass
class PlateScene(CalibrationScene):
    """A vibrating plate; beside it the calibration object, if `target` has circles.

    Parameters
    ----------
    plate : Plate
    """

    plate: Plate = field(default_factory=Plate)

    def check(self, checks: Checks) -> None:
        """Note what is wrong with the plate, the speakers and washers."""
        super().check(checks)
        self.plate.check(checks, "plate")

    def objects(self, target: Target | None, rng: np.random.Generator) -> list[SceneObject]:
        """List the plate, and the calibration object if there is one."""
        objects = super().objects(target, rng) if isinstance(target, Circles) else []
        return [*objects, VibratingPlate.built(self.plate)]


def truth_to_dataset(
    scene: PlateScene, points: Array, frequency: ArrayLike, amplitude: float
) -> xr.Dataset:
    """Make the group ``truth``: true velocity of the plate near points.

    Parameters
    ----------
    points : ndarray, shape (node, 3), m
        In the world.
    frequency : array_like, shape (frequency,), Hz
    amplitude : float, V
        Of the excitation at each frequency.

    Returns
    -------
    xarray.Dataset
        ``velocity`` of the measured surface at the place nearest to each point, NaN beside the
        plate, and the point's ``height`` above that surface.
    """
    plate = VibratingPlate.built(scene.plate)
    hertz = np.atleast_1d(np.asarray(frequency, float))
    velocity = np.stack([amplitude * plate.velocity(points, f) for f in hertz], axis=-1)
    return dataset.group(
        "truth",
        {"node": np.arange(len(points)), "frequency": hertz},
        velocity=velocity,
        height=plate.height(points),
        position=points,
    )
