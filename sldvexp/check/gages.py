"""`check=gages`: strains that gages would show, with bounds, and those that they showed (6.2).

A gage and the field agree if their difference lies within its interval, which has the gage's
uncertainty, the field's and that of the sheet's thickness in it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.lazy import xarray as xr
from sldvexp.shell import SurfaceField, SurfaceReconstruction
from sldvexp.shell.estimate import reconstruct_surface
from sldvexp.shell.gage import Gage, along
from sldvexp.statistics import student_factor
from sldvexp.typing import Array, ComplexArray
from sldvexp.virtual_lab.plate import VibratingPlate


@register("check", "gages")
@dataclass
class Gages(Check):
    """Strain of the measured face as gages show it: averaged over their grids, along them.

    Parameters
    ----------
    gages : dict of str to Gage
    """

    gages: dict[str, Gage] = field(default_factory=dict)

    def __post_init__(self) -> None:
        checks = Checks()
        checks.require(bool(self.gages), "gages", "must be given, as in {g1: {place: [0.0, 0.0]}}")
        for name, gage in self.gages.items():
            gage.check(checks, f"gages.{name}")
        checks.done()

    def examine(self, run: Examination) -> xr.Dataset:
        """Predict every gage, and compare it with what was measured and what is true.

        Raises
        ------
        UserError
            If the run has no smooth field on a surface, or a gage is not on it.
        """
        e = run.experiment
        methods = [e.reconstruction, *e.compare.values()] if e is not None else []
        method = next((m for m in methods if isinstance(m, SurfaceReconstruction)), None)
        if method is None:
            raise UserError("check=gages needs reconstruction=shell or spline, or one in compare")
        found = reconstruct_surface(run.groups, e.laser, e.volume, method, e.material)
        if found.frequency is None:
            raise UserError(
                "check=gages needs the frequency of the images, which none of them says"
            )
        self._check_places(found)
        predicted, variance = self._predicted(found)
        level = float(student_factor(method.confidence, np.inf))
        measured, std = self._measured(len(found.frequency))
        return dataset.group(
            "examined/gages",
            {"gage": list(self.gages), "frequency": found.frequency, "part": ["real", "imaginary"]},
            strain=predicted,
            strain_std_by_part=np.sqrt(variance),
            confidence=level * np.sqrt(variance.max(axis=0)),
            **_compared(predicted, variance, measured, std, level),
            **self._true(run, found),
        )

    def _check_places(self, found: SurfaceField) -> None:
        """Refuse gages that do not lie on the surface with their whole grid."""
        outline = found.fit.outline
        for name, gage in self.gages.items():
            places, _ = gage.points()
            if not outline.holds(places).all():
                (a, b), (c, d) = outline.low, outline.high
                raise UserError(
                    f"check.gages: {name} is not on the surface with its whole grid of "
                    f"{1e3 * gage.length:g} x {1e3 * gage.width:g} mm: place is within "
                    f"[{a:.4g} .. {c:.4g}, {b:.4g} .. {d:.4g}] m, or volume.margin larger"
                )

    def _predicted(self, found: SurfaceField) -> tuple[ComplexArray, Array]:
        """Predict strains, shape (gage, frequency), and their variances by part."""
        fit = found.fit
        rows = np.stack([g.row(fit.shell, fit.face) for g in self.gages.values()])
        return found.strain_of(rows, [g.row for g in self.gages.values()])

    def _measured(self, frequencies: int) -> tuple[ComplexArray | None, Array | None]:
        """Collect measured strains, NaN where a gage has none; None if no gage has any."""
        if not any(gage.amplitude for gage in self.gages.values()):
            return None, None
        strain = np.full((len(self.gages), frequencies), np.nan + 0j)
        std = np.full(strain.shape, np.nan)
        for i, (name, gage) in enumerate(self.gages.items()):
            if gage.amplitude and len(gage.amplitude) != frequencies:
                raise UserError(
                    f"check.gages: {name}.amplitude must have {frequencies} numbers, one for each "
                    f"frequency of the run, not {len(gage.amplitude)}"
                )
            if gage.amplitude:
                strain[i] = np.array(gage.amplitude) * np.exp(1j * np.radians(gage.phase))
                std[i] = gage.std
        return strain, std

    def _true(self, run: Examination, found: SurfaceField) -> Mapping[str, Any]:
        """Find the strains that the virtual lab's plate has there."""
        e = run.experiment
        if "truth" not in run.groups:
            return {}
        images = [p for p in e.scan.parts(e.scan.view_names()[0]) if p.kind == "image"]
        plate, chart = VibratingPlate.built(e.scene.plate), found.fit.outline.chart
        hertz = run.groups["truth"]["frequency"].values
        true = []
        for gage in self.gages.values():
            places, weight = gage.points()
            points = chart.points(places, found.fit.face)
            strains = [tuple(plate.strain(points, f).T) for f in hertz]
            true.append([weight @ along(strain, gage.along) for strain in strains])
        return {"true_strain": images[0].sampling.amplitude * np.array(true)}


def _compared(
    predicted: ComplexArray,
    variance: Array,
    measured: ComplexArray | None,
    std: Array | None,
    level: float,
) -> Mapping[str, Any]:
    """Compare predicted with measured strains."""
    if measured is None or std is None:
        return {}
    difference = measured - predicted
    bound = level * np.sqrt(variance + std**2)
    parts = np.stack([difference.real, difference.imag])
    agrees = (np.abs(parts) <= bound).all(axis=0)
    return {
        "measured": measured,
        "difference": difference,
        "difference_confidence": bound.max(axis=0),
        "agrees": agrees & np.isfinite(difference),
    }
