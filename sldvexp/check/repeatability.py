"""`check=repeatability`: how much repeated scans of one pose scatter (Figures 4.25 to 4.27)."""

from __future__ import annotations

from dataclasses import dataclass

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.config.registry import register
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr


@register("check", "repeatability")
@dataclass
class Repeatability(Check):
    """Standard deviation of every image point over all views, which must be of one pose."""

    def examine(self, run: Examination) -> xr.Dataset:
        """Find ``dac_std (point, mirror)`` and the largest of them."""
        if "registration" not in run.groups or run.groups["registration"].sizes["view"] < 2:
            raise UserError(
                "check=repeatability needs image points of at least two views of one pose: choose "
                "pose=bitangent and repeat the view under other names"
            )
        dac = run.groups["registration"]["dac"]
        std = dac.std("view", ddof=1)
        return dataset.group(
            "examined/repeatability",
            {"point": dac["point"].values},
            dac_std=std.values,
            largest=float(std.max()),
        )
