"""`instrument=scan_export`: tables of points as scanning vibrometers export them as text."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.importers.measured import Measured
from sldvexp.importers.pointwise import Directions, Pointwise

#: What a column may be.
ROLES = ("index", "x", "y", "z", "frequency", "status", "real", "imag", "magnitude", "phase")


@register("instrument", "scan_export")
@dataclass
class ScanExport(Pointwise):
    """Text tables with a line a point: number, coordinates, velocity, perhaps a status.

    Columns are recognised by their units and places, not by their names, which are of any
    language. Of several frequencies each has a row, or columns with the frequency above. What a
    file does not say, and a setting does not either, is asked for.

    Parameters
    ----------
    good_status : list of int
        Values of the status column of points that are to be trusted.
    columns : dict of str to int
        Which column, counted from 1, is what, instead of recognising them: index, x, y, z,
        frequency, status, real, imag, magnitude, phase. Where frequencies stand above columns,
        those of values are of one of them, as real and imaginary part of H1 beside H2, or left out.
    """

    directions: Directions = Directions.view
    good_status: list[int] = field(default_factory=list)
    columns: dict[str, int] = field(default_factory=dict)

    def check(self, checks: Checks) -> None:
        """Note what cannot be."""
        message = "must be view or pose: these tables have no directions"
        checks.require(self.directions is not Directions.dof, "directions", message)
        for role, column in self.columns.items():
            message = f"must be one of {', '.join(ROLES)}"
            checks.require(role in ROLES, f"columns.{role}", message)
            message = f"must be a column's number from 1, not {column}"
            checks.require(column >= 1, f"columns.{role}", message)
        for name, view in self.views.items():
            checks.require(not view.dof, f"views.{name}.dof", "is for universal files only")

    def measured(self) -> Iterator[Measured]:
        """What the views' tables say; see `sldvexp.importers.scan_views.measured`."""
        from sldvexp.importers.scan_views import measured

        return measured(self)
