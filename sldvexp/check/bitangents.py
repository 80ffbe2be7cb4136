"""`check=bitangents`: the calibration object's points as a machinist reads them, in inches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.config.registry import register
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.units import LengthUnit


@register("check", "bitangents")
@dataclass
class Bitangents(Check):
    """Numbered bitangent points of the calibration object in inches, as in Table 4.1."""

    def examine(self, run: Examination) -> xr.Dataset:
        """Find ``position_inch (point, plane_axis)``."""
        if "target" not in run.groups:
            raise UserError("check=bitangents needs a calibration object: choose a target")
        target = run.groups["target"]
        position = target["position"].sel(axis=["x", "y"]) / LengthUnit.inch.value
        coords = {"point": target["point"].values, "plane_axis": np.array(["x", "y"])}
        return dataset.group("examined/bitangents", coords, position_inch=position.values)
