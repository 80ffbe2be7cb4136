"""`model=file`: a finite element model in a file of another program."""

from __future__ import annotations

from dataclasses import dataclass, field

from omegaconf import MISSING

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.models.base import ModelSource
from sldvexp.models.finite_elements import FiniteElementModel
from sldvexp.models.readers import read_model


@register("model", "file")
@dataclass
class ModelFile(ModelSource):
    """A finite element model from a universal file, or a mesh with shapes that meshio reads.

    Parameters
    ----------
    path : str
        Universal file (``.uff``, ``.unv``) with nodes, surface elements and normal modes; or
        ``.vtu``, ``.bdf`` and others, which need meshio.
    shapes : str, optional
        Universal file with the normal modes (data set 55 or 2414), where `path` has none.
    frequencies : list of float, Hz
        Of the shapes, where the file does not say them.
    containing : str
        Text that the lines that identify a mode, or the name of its array, must have.
    """

    path: str = MISSING
    shapes: str | None = None
    frequencies: list[float] = field(default_factory=list)
    containing: str = ""

    def check(self, checks: Checks) -> None:
        """See `ModelSource`."""
        super().check(checks)
        for value in self.frequencies:
            checks.positive("frequencies", value)

    def inputs(self) -> list[str]:
        """See `ModelSource`."""
        return [self.path, *([self.shapes] if self.shapes else [])]

    def read(self) -> FiniteElementModel:
        """See `ModelSource`."""
        shapes = None if self.shapes is None else locate(self.shapes)
        return read_model(
            locate(self.path), self.unit.value, shapes, self.frequencies, self.containing
        )
