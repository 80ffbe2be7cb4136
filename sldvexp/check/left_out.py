"""`check=left_out`: each view predicted from the field of the others."""

from __future__ import annotations

from dataclasses import dataclass

from sldvexp import dataset
from sldvexp.check.base import Check, Examined
from sldvexp.check.prediction import predict
from sldvexp.config.registry import register
from sldvexp.lazy import xarray as xr


@register("check", "left_out")
@dataclass
class LeftOut(Check):
    """How well the views agree: the field of all others predicts what a view measured.

    What matters is the error where the others agree best, which is on the real surface.
    """

    def examine(self, run: Examined) -> xr.Dataset:
        """``error`` of every view at every sampled depth, and the smallest beside the noise."""
        found = predict(run)
        best = found.error.mean(axis=0).argmin()
        return dataset.group(
            "examined/left_out",
            {"view": list(found.views), "sample_depth": found.depth},
            error=found.error,
            error_at_surface=found.error[:, best],
            measured=found.measured,
            noise=found.noise,
        )
