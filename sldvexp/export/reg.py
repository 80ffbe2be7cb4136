"""`export=reg`: registration data as the ``.reg`` file of Figure 4.28."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import ClassVar

from sldvexp.config.registry import register
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import UserError
from sldvexp.export.base import Export, one_view
from sldvexp.io.registration import from_dataset, write
from sldvexp.units import LengthUnit


@register("export", "reg")
@dataclass
class Reg(Export):
    """Points of one view on the object and the mirror angles through them, in degrees.

    They are those that the pose was solved from, so that `pose=registration` finds it again from
    the file; mirrors that were ``inverted`` are so no longer. Standard deviations of the points
    have no place in the file.

    Parameters
    ----------
    view : str
        Which is written, if the run has several.
    unit : LengthUnit
        Of the points in the file.
    """

    suffix = ".reg"
    called: ClassVar[str] = "registration"
    groups: ClassVar[tuple[str, ...]] = ("registration",)

    view: str = ""
    unit: LengthUnit = LengthUnit.m

    def write(self, run: RunData, path: Path) -> None:
        """Write the file; points that the view lacks are left out."""
        if not run.has("registration"):
            raise UserError(
                "export=reg needs registration data: choose pose=bitangent, pose=manual or "
                "pose=registration"
            )
        tables = {t.name: t for t in from_dataset(run.groups["registration"], "registration")}
        table = tables[one_view("reg", self.view, tables)]
        write(path, [replace(table, unit=self.unit)])
