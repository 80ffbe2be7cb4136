"""`check=phase_image`: what the phase correction does to velocity images (Figures 3.4 to 3.7).

A mode has two phases half a turn apart, so that doubled phases are compared, by directional
statistics with weights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.config.registry import register
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr


@register("check", "phase_image")
@dataclass
class PhaseImage(Check):
    """How much the phases of an image's pixels scatter before and after the correction.

    A structure that vibrates in one mode has two phases, half a turn apart. So the doubled phase
    is what scatters or not; each pixel counts with its squared amplitude, since a node has none.
    """

    def examine(self, run: Examination) -> xr.Dataset:
        """Find ``phase``, ``phase_std`` and ``p_uniform`` over view, stage and frequency."""
        images = run.below("image")
        if not images:
            raise UserError("check=phase_image needs velocity images: choose scan=rectangle")
        frequency = next(iter(images.values()))["frequency"].values
        if not all(np.array_equal(g["frequency"].values, frequency) for g in images.values()):
            raise UserError("check=phase_image needs images of the same frequencies in all views")
        found = []
        for image in images.values():
            good = image.isel(pixel=image["flags"].values == 0)
            stages = (good["uncorrected"].values, good["velocity"].values)
            found.append([_statistics(velocity) for velocity in stages])
        phase, std, p = np.moveaxis(np.array(found), 2, 0)
        coords = {
            "view": np.array(list(images)),
            "stage": np.array(["uncorrected", "corrected"]),
            "frequency": frequency,
        }
        return dataset.group(
            "examined/phase_image", coords, phase=phase, phase_std=std, p_uniform=p
        )


def _statistics(velocity: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Compute mean phase (rad, of half a turn), circular std (rad) and Rayleigh's p-value.

    With the weights |v|^2 the doubled phases have the resultant R = |sum v^2| / sum |v|^2. If all
    phases are alike likely, R^2 is exponential with mean sum |v|^4 / (sum |v|^2)^2.
    """
    power = np.abs(velocity) ** 2
    vector = (velocity**2).sum(axis=0) / power.sum(axis=0)
    size = np.abs(vector)
    std = np.sqrt(-2 * np.log(np.minimum(size, 1.0))) / 2
    p_uniform = np.exp(-(size**2) * power.sum(axis=0) ** 2 / (power**2).sum(axis=0))
    return np.angle(vector) / 2, std, p_uniform
