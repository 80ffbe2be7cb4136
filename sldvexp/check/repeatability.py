"""`check=repeatability`: how much repeated scans of one pose scatter (Figures 4.25 to 4.27)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sldvexp.check.base import Check
from sldvexp.errors import UserError
from sldvexp.registry import register

if TYPE_CHECKING:
    import numpy as np
    import xarray as xr


@register("check", "repeatability")
@dataclass
class Repeatability(Check):
    """Standard deviation of every image point over all views, which must be of one pose."""

    def examine(self, tree: Mapping[str, xr.Dataset], rng: np.random.Generator) -> xr.Dataset:
        """``dac_std (point, mirror)`` and the largest of them."""
        from sldvexp import dataset

        if "registration" not in tree or tree["registration"].sizes["view"] < 2:
            raise UserError(
                "check=repeatability needs image points of at least two views of one pose: choose "
                "pose=bitangent and repeat the view under other names"
            )
        dac = tree["registration"]["dac"]
        std = dac.std("view", ddof=1)
        return dataset.group(
            "examined/repeatability",
            {"point": dac["point"].values},
            dac_std=std.values,
            largest=float(std.max()),
        )
