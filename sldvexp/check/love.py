"""`check=love`: whether the velocity is constant through the thickness of the volume."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.config.registry import register
from sldvexp.lazy import xarray as xr


@register("check", "love")
@dataclass
class Love(Check):
    """How much each component of the field changes from layer to layer.

    The normal velocity of a thin shell is the same through its thickness (Love). In a volume that
    is thicker than the shell the views look at different places of it away from the real surface,
    which changes the tangential components much and the normal one little. A field of splines on
    the surface changes as Love's kinematics say, which is no test of them.

    Parameters
    ----------
    of : str
        Which field: ``field``, or the name of one in ``compare``.
    """

    of: str = "field"

    def examine(self, run: Examination) -> xr.Dataset:
        """Find ``variation`` of each component through the layers, and its bound."""
        field, volume = run.field_of(self.of), run.groups["volume"]
        layers = volume.sizes["layer"]

        def by_layer(name: str) -> np.ndarray:
            values = field[name].transpose("node", "component", ...).values
            return values.reshape(layers, -1, *values.shape[1:])

        velocity, confidence = by_layer("velocity"), by_layer("confidence")
        size = np.sqrt(np.nanmean(np.abs(velocity) ** 2))
        layers_known = np.isfinite(velocity).sum(axis=0)
        change = velocity - np.nansum(velocity, axis=0) / np.maximum(layers_known, 1)
        coords = {"component": field["component"].values}
        if "frequency" in field.coords:
            coords["frequency"] = field["frequency"].values
        return dataset.group(
            "examined/love",
            coords,
            variation=np.sqrt(np.nanmean(np.abs(change) ** 2, axis=(0, 1))) / size,
            bound=np.sqrt(np.nanmean(confidence**2, axis=(0, 1))) / size,
        )
