"""`check=truth`: a field against what truly happens in the virtual lab, component by component."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examined
from sldvexp.check.columns import Columns
from sldvexp.config.registry import register
from sldvexp.errors import UserError
from sldvexp.lazy import xarray as xr


@register("check", "truth")
@dataclass
class Truth(Check):
    """How far the field is from the truth on the true surface, and how often its bounds hold.

    The field is taken where each column of nodes crosses the true surface, linearly between the
    layers, as the element does; so is its bound, which is then no smaller than the exact one.
    """

    def examine(self, run: Examined) -> xr.Dataset:
        """Errors and coverage of each component at each frequency, and in all frequencies."""
        tree = run.tree
        if not {"field", "truth", "volume"} <= set(tree):
            raise UserError(
                "check=truth needs a field and the virtual lab's truth: choose a volume, a "
                "reconstruction and scene=plate"
            )
        columns = Columns.of(tree["volume"], tree["truth"]["height"].values)
        field, truth = tree["field"], columns.at_surface(tree["truth"]["velocity"].values)
        found = columns.at_surface(field["velocity"].values)
        if "n" in field["component"].values:
            truth = np.einsum("nca,naf->ncf", tree["volume"]["frame"].values[columns.inside], truth)
        error = found - truth
        bound = columns.at_surface(field["confidence"].values)
        parts = np.stack([error.real, error.imag])
        known = np.isfinite(parts) & np.isfinite(bound)
        with np.errstate(invalid="ignore"):
            covered = (np.abs(parts) <= bound) & known
        largest = np.sqrt(np.nanmean(np.abs(truth) ** 2, axis=0))
        rms = np.sqrt(np.nanmean(np.abs(error) ** 2, axis=0))
        coords = {"component": field["component"].values, "frequency": field["frequency"].values}
        group = dataset.group(
            "examined/truth",
            coords,
            relative_error=rms / largest,
            rms_error=rms,
            rms_bound=np.sqrt(np.nanmean(bound**2, axis=0)),
            covered=covered.sum(axis=(0, 1)) / known.sum(axis=(0, 1)),
            relative_error_in_all=np.linalg.norm(rms, axis=1) / np.linalg.norm(largest, axis=1),
            covered_in_all=covered.sum(axis=(0, 1, 3)) / known.sum(axis=(0, 1, 3)),
        )
        group.attrs["columns"] = len(columns.inside)
        return group
