"""`check=strain_truth`: strains of a surface against those of the virtual lab's plate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.check.truth import errors_and_coverage
from sldvexp.config.registry import register
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr
from sldvexp.statistics import student_factor


@register("check", "strain_truth")
@dataclass
class StrainTruth(Check):
    """How far strains of the measured face are from the truth, and how often their bounds hold."""

    def examine(self, run: Examination) -> xr.Dataset:
        """Find errors and coverage of each strain at each frequency, and in all of them."""
        own = [run.groups["strain"]] if "strain" in run.groups else []
        strains = own or list(run.below("compare_strain", "strain").values())
        if not strains or not run.has("truth", "strain"):
            raise UserError(
                "check=strain_truth needs strains and the virtual lab's truth: choose "
                "reconstruction=shell and scene=plate"
            )
        strain, truth = strains[0], run.groups["truth"]["strain"].values
        level = float(student_factor(strain.attrs["confidence_level"], np.inf))
        bound = level * strain["strain_std_by_part"].values
        return dataset.group(
            "examined/strain_truth",
            {name: strain[name].values for name in ("strain_component", "frequency")},
            **errors_and_coverage(strain["strain"].values - truth, truth, bound),
        )
