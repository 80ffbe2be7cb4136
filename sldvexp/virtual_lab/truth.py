"""What truly happens in the virtual lab where a run has estimated it."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sldvexp import dataset
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array
from sldvexp.virtual_lab.plate import VibratingPlate
from sldvexp.virtual_lab.plate_scene import PlateScene


def truth_to_dataset(
    scene: PlateScene, points: Array, frequency: ArrayLike, amplitude: float
) -> xr.Dataset:
    """True velocity of the plate near points, as the group ``truth``.

    Parameters
    ----------
    scene : PlateScene
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
