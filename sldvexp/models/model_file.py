"""`model=file`: a finite element model in a file of another program."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

from omegaconf import MISSING

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.models.base import ModelSource
from sldvexp.models.finite_elements import FiniteElementModel
from sldvexp.models.other_files import mesh_error, sensitivity_of
from sldvexp.models.readers import read_model
from sldvexp.typing import Array


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
    coarser : str, optional
        File of the same structure with larger elements and as many modes, alike else: tells the
        error of the frequencies in place of `discretisation`.
    order : float
        Power of the elements' size with which frequencies converge: 2 of linear and quadratic
        shells and solids, 4 of cubic plates. A smaller one makes the error larger.
    """

    path: str = MISSING
    shapes: str | None = None
    frequencies: list[float] = field(default_factory=list)
    containing: str = ""
    coarser: str | None = None
    order: float = 2.0

    def check(self, checks: Checks) -> None:
        """See `ModelSource`."""
        super().check(checks)
        for value in self.frequencies:
            checks.positive("frequencies", value)
        checks.positive("order", self.order)
        both = self.coarser is not None and bool(self.discretisation)
        checks.require(not both, "discretisation", "is told by coarser; give one of them")

    def inputs(self) -> list[str]:
        """See `ModelSource`."""
        varied = [p.varied.path for p in self.parameters.values() if p.varied.path]
        return [self.path, *filter(None, (self.shapes, self.coarser)), *varied]

    def read(self) -> FiniteElementModel:
        """See `ModelSource`."""
        return self._own

    @cached_property
    def _own(self) -> FiniteElementModel:
        """Model of the file, which is read once for the check before measuring and for its test."""
        shapes = None if self.shapes is None else locate(self.shapes)
        return read_model(
            locate(self.path), self.unit.value, shapes, self.frequencies, self.containing
        )

    def check_further(self, model: FiniteElementModel) -> None:
        """See `ModelSource`: its further files are read, and lists counted."""
        self.sensitivities(model)
        self.discretisation_of(model)

    def sensitivities(self, model: FiniteElementModel) -> dict[str, Array]:
        """See `ModelSource`; of parameters with a file of another value, from that."""
        return {
            n: self._varied[n] if p.varied.path else self.given_sensitivity(n, p, model)
            for n, p in self.parameters.items()
        }

    @cached_property
    def _varied(self) -> dict[str, Array]:
        """Sensitivities of the parameters that have a file of another value."""
        return {
            n: sensitivity_of(self._own, self._other(p.varied.path), p.varied.value / p.value)
            for n, p in self.parameters.items()
            if p.varied.path
        }

    def discretisation_of(self, model: FiniteElementModel) -> Array:
        """See `ModelSource`; from a coarser mesh if there is one."""
        if self.coarser is None:
            return super().discretisation_of(model)
        return self._mesh_error

    @cached_property
    def _mesh_error(self) -> Array:
        """Relative error of the frequencies, as the coarser mesh tells it."""
        assert self.coarser is not None
        return mesh_error(self._own, self._other(self.coarser), self.order)

    def _other(self, path: str) -> FiniteElementModel:
        """Read another file of the structure, with its own frequencies."""
        return read_model(locate(path), self.unit.value, None, [], self.containing)
