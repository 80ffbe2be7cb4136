"""`instrument=file`: line-of-sight velocities from a file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from omegaconf import MISSING

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.dataset import Finding, Severity, with_findings
from sldvexp.errors import Checks, nearest
from sldvexp.importers.base import PointImporter
from sldvexp.importers.conventions import Amplitude, Phase, Positive
from sldvexp.importers.incomplete import Incomplete, check_incomplete, incomplete_by
from sldvexp.io.velocities import FileLayout, LineOfSight, read
from sldvexp.io.velocities.table import DIMENSIONS, IGNORED, KNOWN
from sldvexp.laser import TwoMirror
from sldvexp.lazy import xarray as xr
from sldvexp.units import LengthUnit, VelocityUnit


@register("instrument", "file")
@dataclass
class File(PointImporter):
    """Velocities that were measured before, as CSV, netCDF or MATLAB arrays.

    Parameters
    ----------
    path : str
        A ``.csv`` (``view,dx,dy,dz,frequency,real,imag`` and optionally ``point``, ``std`` and the
        points' ``x,y,z``), or ``.nc`` or ``.mat`` with arrays ``direction_cosines``, ``velocity``,
        ``frequency``, ``std``, ``position``, and ``triangle`` and ``line`` between points.
        Attributes ``units`` in a ``.nc`` are heeded, of frequencies as of velocities.
    unit : VelocityUnit or None
        Of the file's velocities; if none is set, as headings of columns or the attribute units of a
        ``.nc`` say, or m/s.
    positive : Positive
        Which way a positive velocity points.
    phase : Phase
        Sign of the time dependence that complex velocities belong to.
    amplitude : Amplitude or None
        What a velocity gives of a sine; if none is set, as headings of columns say, or its peak.
    mapping : dict of str to str
        From the file's names of variables, dimensions or columns to the program's, ``{vlos:
        velocity, head: view}``; complex velocities may come as ``real`` and ``imag``, and what is
        of no use is called ``ignore``.
    order : list of str
        Dimensions of the arrays of a ``.mat``, if not view, point, frequency, axis; each array has
        those that it needs, and the axis comes last unless it is named.
    group : str
        Of a ``.nc``; empty for the group ``line_of_sight``, or the root.
    length_unit : LengthUnit or None
        Of positions, where neither a column as ``x_mm`` or ``X [mm]`` nor an attribute says it; if
        none is set, m.
    incomplete : bool or str
        What becomes of points that not all views have: false refuses them, drop (or true) leaves
        them out, mark keeps them as NaN with a flag and determines them from the other views if
        these are three or more. They are counted in the verdict.
    """

    path: str = MISSING
    unit: VelocityUnit | None = None
    positive: Positive = Positive.towards
    phase: Phase = Phase.exp_plus
    amplitude: Amplitude | None = None
    mapping: dict[str, str] = field(default_factory=dict)
    order: list[str] = field(default_factory=list)
    group: str = ""
    length_unit: LengthUnit | None = None
    incomplete: bool | str = False

    def __post_init__(self) -> None:
        checks = Checks()
        for theirs, own in self.mapping.items():
            turned = theirs in KNOWN and own not in (*KNOWN, IGNORED)
            message = f"the file's name comes first: write {{{own}: {theirs}}}"
            message = (
                message if turned else f"there is no {own} here; {nearest(own, (*KNOWN, IGNORED))}"
            )
            checks.require(own in (*KNOWN, IGNORED), f"mapping.{theirs}", message)
        known = set(self.order) <= set(DIMENSIONS) and len(set(self.order)) == len(self.order)
        message = f"must be each once of {', '.join(DIMENSIONS)}, with view among them"
        checks.require(not self.order or (known and "view" in self.order), "order", message)
        check_incomplete(checks, self.incomplete)
        checks.done()

    def inputs(self) -> list[str]:
        """Name the file."""
        return [self.path]

    def read(
        self, tree: Mapping[str, xr.Dataset] | None = None, laser: TwoMirror | None = None
    ) -> xr.Dataset:
        """Read the group ``line_of_sight``; the file has its directions itself."""
        incomplete = incomplete_by(self.incomplete)
        gaps = incomplete is not Incomplete.refuse
        layout = FileLayout(self.mapping, tuple(self.order), self.group, self.length_unit, gaps)
        senses = {name: getattr(self, name).name for name in ("positive", "phase")}
        layout = replace(layout, amplitude=self.amplitude, senses=senses)
        table = read(locate(self.path), self.unit, layout)
        found = _missing(table, incomplete)
        group = (table.complete() if incomplete is Incomplete.drop else table).to_dataset()
        amplitude = self.amplitude or table.amplitude or Amplitude.peak
        factor = self.positive.value * amplitude.value
        velocity = group["velocity"].values
        velocity = factor * (np.conj(velocity) if self.phase is Phase.exp_minus else velocity)
        group["velocity"] = group["velocity"].copy(data=velocity)
        if "velocity_std" in group:
            std = group["velocity_std"]
            group["velocity_std"] = std.copy(data=amplitude.value * std.values)
        said = senses | {"amplitude": amplitude.name}
        told = group.assign_attrs({f"import_{name}": value for name, value in said.items()})
        found += [Finding("unit", "velocities", text) for text in table.odd]
        if table.ignored:
            text = f"{table.source}: instrument.mapping leaves out {', '.join(table.ignored)}"
            found.append(Finding("left_out", "velocities", text, Severity.note))
        return with_findings(told, found)


def _missing(table: LineOfSight, incomplete: Incomplete) -> list[Finding]:
    """Count what some view has not measured."""
    if table.missing is None:
        return []
    lost = np.asarray(table.missing.any(axis=0))
    of_points = table.point is not None
    count = int(lost.any(axis=1).sum() if of_points else lost.sum())
    whole = lost.shape[0] if of_points else lost.shape[1]
    gone = np.asarray(table.missing.any(axis=2) if of_points else table.missing[:, 0])
    counts = ", ".join(
        f"view {name} {int(own.sum())}" for name, own in zip(table.view, gone, strict=True)
    )
    text = (
        f"{count} of {whole} {'points' if of_points else 'frequencies'} are {incomplete.done}, as "
        f"not all views have values there (missing: {counts})"
    )
    return [Finding("missing_points", "points", text, Severity.note, size=float(count))]
