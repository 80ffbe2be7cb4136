"""`check=gages`: strains that gages would show, with bounds, and those that they showed (6.2).

A gage and the field agree if their difference lies within its interval, which has the gage's
uncertainty, the field's and that of the sheet's thickness in it. With z the larger of the real and
the imaginary part of the difference, each over its standard error, the probability of such a one is
at most ``p = 2 P(|x| > z)``, whatever the correlation of the parts; N comparisons of a run are made
at the level of each over N.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.check.on_surface import surface_field_of
from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.dataset import Finding, Severity, with_findings
from sldvexp.errors import Checks, UserError, nearest
from sldvexp.io import GageTable, read_gages
from sldvexp.lazy import scipy
from sldvexp.lazy import xarray as xr
from sldvexp.shell import SurfaceField, SurfaceReconstruction
from sldvexp.shell.gage import Gage, along
from sldvexp.statistics import student_factor
from sldvexp.typing import Array, ComplexArray
from sldvexp.virtual_lab.plate import VibratingPlate

#: Difference of frequencies, over them, that rounding in a file makes.
SAME_LINE = 1e-4
#: Probability of a difference by chance, in any comparison of a run, below which it is a finding.
OFF = 1e-3


@register("check", "gages")
@dataclass
class Gages(Check):
    """Strain of the measured face as gages show it: averaged over their grids, along them.

    Parameters
    ----------
    gages : dict of str to Gage
    path : str
        File of the strains that they showed, a CSV table with the columns gage, frequency, and
        amplitude and phase or real and imag; `sldvexp handbook shell` has its units. Without it
        strains are predicted alone.
    """

    gages: dict[str, Gage] = field(default_factory=dict)
    path: str | None = None

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
        found, frequency = surface_field_of(run, "gages", SurfaceReconstruction)
        self._check_places(found)
        predicted, variance = self._predicted(found)
        made = dataset.group(
            "examined/gages",
            {"gage": list(self.gages), "frequency": frequency, "part": ["real", "imaginary"]},
            strain=predicted,
            confidence=found.factor * np.sqrt(variance.max(axis=0)),
            confidence_by_part=found.factor * np.sqrt(variance),
            **self._true(run, found),
        )
        if self.path is None:
            return made
        measured = MeasuredGages.of(read_gages(locate(self.path)), list(self.gages), frequency)
        return _compared(made, measured, variance, found.method.confidence)

    def inputs(self) -> list[str]:
        """Name the file of measured strains."""
        return [] if self.path is None else [self.path]

    def _check_places(self, found: SurfaceField) -> None:
        """Refuse gages that do not lie on the surface with their whole grid."""
        outline = found.fit.outline
        for name, gage in self.gages.items():
            places, _ = gage.points()
            if not outline.holds(places).all():
                (a, b), (c, d) = outline.low, outline.high
                if (np.ptp(places, axis=0) > outline.high - outline.low).any():
                    raise UserError(
                        f"check.gages: {name}, {1e3 * gage.length:g} x {1e3 * gage.width:g} mm, is "
                        f"longer than the surface, {1e3 * (c - a):.4g} x {1e3 * (d - b):.4g} mm"
                    )
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
            strains = [tuple(plate.strain(points, f, chart.frames(places)).T) for f in hertz]
            true.append([weight @ along(strain, gage.along) for strain in strains])
        return {"true_strain": images[0].sampling.amplitude_at(hertz) * np.array(true)}


@dataclass(frozen=True, eq=False)
class MeasuredGages:
    """Measured strains of a run's gages at its frequencies.

    Attributes
    ----------
    strain : ndarray of complex, shape (gage, frequency)
        NaN where the file has none.
    std : ndarray, shape (gage, frequency)
    notes : list of str
        Sentences on everything of the file that was not used, and on what it lacks.
    """

    strain: ComplexArray
    std: Array
    notes: list[str]

    @classmethod
    def of(cls, table: GageTable, gages: Sequence[str], frequency: Array) -> MeasuredGages:
        """Take a file's strains to the gages and frequencies of a run.

        Raises
        ------
        UserError
            If none of them is of a gage and a frequency of the run.

        Examples
        --------
        >>> import numpy as np
        >>> from pathlib import Path
        >>> from sldvexp.io import GageTable
        >>> strain, std = np.array([1e-6, 2e-6, 3e-6j]), np.zeros(3)
        >>> table = GageTable(
        ...     Path("a.csv"), ["a", "b", "a"], np.array([50, 50, 60.0]), strain, std, True, []
        ... )
        >>> found = MeasuredGages.of(table, ["a"], np.array([60.0, 70.0]))
        >>> found.strain.tolist()
        [[3e-06j, (nan+nanj)]]
        >>> for note in found.notes:
        ...     print(note)
        a.csv: strains of gages that check.gages does not have are left out: b
        a.csv: 1 of 2 strains is at a frequency that the run does not have, as 50 Hz
        gage a: no strain was measured at 1 of 2 frequencies
        """
        known = [i for i, name in enumerate(table.gage) if name in gages]
        if not known:
            message = nearest(table.gage[0], gages)
            raise UserError(f"{table.path}: gage {table.gage[0]} is none of check.gages; {message}")
        line = np.abs(table.frequency[:, None] - frequency).argmin(axis=1)
        meets = np.abs(table.frequency - frequency[line]) <= SAME_LINE * frequency[line]
        used = [i for i in known if meets[i]]
        if not used:
            hertz = table.frequency[known[0]]
            raise UserError(
                f"{table.path}: has no strain at a frequency of the run: it has {hertz:.6g} Hz, "
                f"the run {frequency[line[known[0]]]:.6g} Hz"
            )
        strain = np.full((len(gages), len(frequency)), np.nan + 1j * np.nan)
        std = np.full(strain.shape, np.nan)
        for i in used:
            at = gages.index(table.gage[i]), line[i]
            strain[at], std[at] = table.strain[i], table.std[i]
        others = [table.frequency[i] for i in known if not meets[i]]
        notes = _unused(table, gages, others, len(known))
        return cls(strain, std, [*notes, *_missing(gages, strain)])


def _unused(
    table: GageTable, gages: Sequence[str], others: Sequence[float], known: int
) -> Iterator[str]:
    """Say which strains of a file are not used, and what it does not say."""
    if table.ignored:
        yield f"{table.path}: the columns {', '.join(table.ignored)} have no meaning here"
    if not table.has_std:
        yield f"{table.path}: has no std; the gages are taken for exact"
    if strange := sorted(set(table.gage) - set(gages)):
        yield (
            f"{table.path}: strains of gages that check.gages does not have are left out: "
            f"{', '.join(strange)}"
        )
    if others:
        yield (
            f"{table.path}: {len(others)} of {known} strains {'is' if len(others) == 1 else 'are'} "
            f"at a frequency that the run does not have, as {others[0]:g} Hz"
        )


def _missing(gages: Sequence[str], strain: ComplexArray) -> Iterator[str]:
    """Say for how many frequencies gages have no strain."""
    for name, row in zip(gages, strain, strict=True):
        if absent := int(np.isnan(row).sum()):
            yield f"gage {name}: no strain was measured at {absent} of {len(row)} frequencies"


def _compared(
    made: xr.Dataset, measured: MeasuredGages, variance: Array, confidence: float
) -> xr.Dataset:
    """Add measured strains, and how they compare with the predicted ones of a group."""
    difference = measured.strain - made["strain"].values
    std = np.sqrt(variance + measured.std**2)
    off = np.abs(np.stack([difference.real, difference.imag])) / std
    p_value = np.minimum(4 * scipy.special.ndtr(-off.max(axis=0)), 1.0)
    found = dataset.group(
        "examined/gages",
        {name: made[name].values for name in ("gage", "frequency", "part")},
        measured=measured.strain,
        measured_std=measured.std,
        difference=difference,
        difference_confidence=student_factor(confidence, np.inf) * std,
        p_value=p_value,
        agrees=p_value >= 1 - confidence,
    )
    whole = made.merge(found).assign_attrs(notes="\n".join(measured.notes))
    return with_findings(whole, list(_disagreements(whole)))


def _disagreements(made: xr.Dataset) -> Iterator[Finding]:
    """Find gages that differ from the field by more than chance, each where it does most."""
    tried = int(made["p_value"].notnull().sum())
    for name in made["gage"].values:
        one = made.sel(gage=name)
        if not one["p_value"].notnull().any():
            continue
        worst = one.isel(frequency=int(np.nanargmin(one["p_value"])))
        p_value = min(1.0, tried * float(worst["p_value"]))
        if p_value < OFF:
            showed, strain = (1e6 * worst[key].item() for key in ("measured", "strain"))
            bound = 1e6 * float(worst["difference_confidence"].max())
            yield Finding(
                "gage",
                f"gage {name}",
                f"gage {name} showed {showed:.3g} microstrain at {worst['frequency'].item():g} Hz "
                f"where {strain:.3g} is predicted, and their difference is known to {bound:.2g}: "
                "are its place, direction, unit, sign and phase right, and the thickness?",
                Severity.doubtful,
                p_value=p_value,
                size=abs(showed - strain),
            )
