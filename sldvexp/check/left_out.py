"""`check=left_out`: each view predicted from the others, as the verdict does it.

A smooth field is fitted to the pixels of all other views; its velocity along a view's beams is what
the view should have measured. Errors beyond the noise come from poses, gains, phases, a surface
that is elsewhere, and a field finer than the smooth one.
"""

from __future__ import annotations

from dataclasses import dataclass

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.config.registry import register
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.verdict.prediction import predict_views


@register("check", "left_out")
@dataclass
class LeftOut(Check):
    """How well the views agree: the joint fit of all others predicts what a view measured.

    A view that is wrong spoils the predictions of the others, too: the verdict's tests say whether
    chance allows the errors, and the view that its diagnosis names is marked.
    """

    def examine(self, run: Examination) -> xr.Dataset:
        """Find ``error`` of every view beside that ``expected``, and which are ``named`` wrong."""
        e = run.experiment
        if e is None or e.volume is None or "pose" not in run.groups:
            raise UserError(
                "check=left_out compares views over a surface: choose volume=grid and images"
            )
        found = predict_views(run.groups, e.laser, e.volume)
        return dataset.group(
            "examined/left_out",
            {"view": found.views},
            error=found.error,
            expected=found.expected,
            measured=found.measured,
            noise=found.noise,
            p_value=found.p_value,
            named=found.named,
        )
