"""`model=plate`: a rectangular plate of finite elements, made with scikit-fem.

Kirchhoff's plate on rectangles of the C1 element of Bogner, Fox and Schmit: natural frequencies
converge with the fourth power of the elements' size, so that those of a mesh half as fine tell the
error of the finer (Richardson): ``(f_h - f_2h) / 15``. Sensitivities are differences of models
with one parameter a little changed.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.lazy import scipy
from sldvexp.models.base import ModelSource
from sldvexp.models.finite_elements import FiniteElementModel
from sldvexp.typing import Array

#: Relative change of a parameter of which sensitivities are differences.
STEP = 1e-3
#: Error of a mesh over its difference from one half as fine: 2^4 - 1.
RICHARDSON = 15.0


class EdgeSide(Enum):
    """Edges of a plate, by where they are along its own axes."""

    left = "left"
    right = "right"
    bottom = "bottom"
    top = "top"


@dataclass
class PlateMass:
    """A point mass on a plate.

    Parameters
    ----------
    place : list of 2 float, the model's unit
        From the middle.
    mass : float, kg
    """

    place: list[float] = field(default_factory=lambda: [0.0, 0.0])
    mass: float = 0.0


@dataclass
class PlateTolerance:
    """Standard uncertainties of a plate's properties, in their own units.

    Parameters
    ----------
    E : float, Pa
    nu : float
    rho : float, kg/m^3
    thickness, length, width : float, the model's unit
    """

    E: float = 0.0
    nu: float = 0.0
    rho: float = 0.0
    thickness: float = 0.0
    length: float = 0.0
    width: float = 0.0


@register("model", "plate")
@dataclass
class PlateModel(ModelSource):
    """A rectangular thin plate, its edges supported or clamped, made with scikit-fem.

    Its own axes stand at the middle, x along the length, z along the normal.

    Parameters
    ----------
    size : list of 2 float, the model's unit
        Length and width.
    E : float, Pa
        Young's modulus.
    nu : float
        Poisson's ratio.
    rho : float, kg/m^3
        Density.
    elements : list of 2 int
        Along each side, even numbers.
    modes : int
        How many are computed.
    clamped : list of EdgeSide
        Edges that cannot turn; all others are supported.
    masses : dict of str to PlateMass
    tolerance : PlateTolerance
    """

    size: list[float] = field(default_factory=lambda: [0.3, 0.25])
    E: float = 70.0e9
    nu: float = 0.33
    rho: float = 2700.0
    elements: list[int] = field(default_factory=lambda: [16, 14])
    modes: int = 6
    clamped: list[EdgeSide] = field(default_factory=list)
    masses: dict[str, PlateMass] = field(default_factory=dict)
    tolerance: PlateTolerance = field(default_factory=PlateTolerance)

    def check(self, checks: Checks) -> None:
        """See `ModelSource`."""
        super().check(checks)
        checks.require(len(self.size) == 2, "size", f"must be 2 numbers, not {len(self.size)}")
        for value in self.size:
            checks.positive("size", value)
        for name in ("E", "rho", "thickness"):
            checks.positive(name, getattr(self, name))
        checks.require(-1 < self.nu < 0.5, "nu", f"must lie between -1 and 0.5, not {self.nu}")
        even = len(self.elements) == 2 and all(n >= 4 and n % 2 == 0 for n in self.elements)
        checks.require(even, "elements", "must be two even numbers of 4 or more")
        checks.require(self.modes >= 1, "modes", f"must be 1 or more, not {self.modes}")
        checks.require(not self.parameters, "parameters", "a plate's are E, nu, rho and its sizes")
        for name in self.known_parameters:
            checks.non_negative(f"tolerance.{name}", getattr(self.tolerance, name))

    @property
    def known_parameters(self) -> list[str]:
        """See `ModelSource`."""
        return ["E", "nu", "rho", "thickness", "length", "width"]

    def inputs(self) -> list[str]:
        """See `ModelSource`: none."""
        return []

    def values(self) -> dict[str, float]:
        """See `ModelSource`."""
        sides = dict(zip(("length", "width"), self.size, strict=True))
        return {n: getattr(self, n) for n in ("E", "nu", "rho", "thickness")} | sides

    def tolerances(self) -> dict[str, float]:
        """See `ModelSource`."""
        return {name: getattr(self.tolerance, name) / v for name, v in self.values().items()}

    def read(self) -> FiniteElementModel:
        """See `ModelSource`."""
        return self._solved(self.values(), self.elements)

    def sensitivities(self, model: FiniteElementModel) -> dict[str, Array]:
        """See `ModelSource`; differences of models that are changed to both sides."""
        found = {}
        for name, value in self.values().items():
            more, less = (
                self._solved(self.values() | {name: value * (1 + s * STEP)}, self.elements)
                for s in (1, -1)
            )
            found[name] = np.log(more.frequency / less.frequency) / (2 * STEP)
        return found

    def discretisation_of(self, model: FiniteElementModel) -> Array:
        """See `ModelSource`; without settings that of a mesh half as fine."""
        if self.discretisation:
            return super().discretisation_of(model)
        coarse = self._solved(self.values(), [n // 2 for n in self.elements])
        return np.abs(coarse.frequency / model.frequency - 1) / RICHARDSON

    def _solved(self, values: Mapping[str, float], elements: list[int]) -> FiniteElementModel:
        """Solve for the modes of a plate of some properties."""
        fem = _scikit_fem()
        unit = self.unit.value
        sides = [unit * values["length"], unit * values["width"]]
        h = unit * values["thickness"]
        x, y = (np.linspace(-s / 2, s / 2, n + 1) for s, n in zip(sides, elements, strict=True))
        mesh = fem.MeshQuad.init_tensor(x, y)
        basis = fem.Basis(mesh, fem.ElementQuadBFS(), intorder=6)
        stiffness, mass = _matrices(fem, basis, values, h)
        for one in self.masses.values():
            probe = basis.probes(unit * np.array(one.place, float)[:, None])
            mass = mass + one.mass * (probe.T @ probe)
        free = self._free(mesh, basis, sides)
        square, shape = scipy.sparse.linalg.eigsh(
            stiffness[free][:, free].tocsc(), self.modes, mass[free][:, free].tocsc(), sigma=0
        )
        order = np.argsort(square)
        whole = np.zeros((basis.N, self.modes))
        whole[free] = shape[:, order]
        w, w_x, w_y = (whole[basis.nodal_dofs[k]] for k in range(3))
        zero = np.zeros_like(w)
        return FiniteElementModel(
            np.column_stack([mesh.p.T, np.zeros(mesh.p.shape[1])]),
            np.empty((0, 3), np.int64),
            mesh.t.T.astype(np.int64),
            np.sqrt(square[order]) / (2 * np.pi),
            np.stack([zero, zero, w], axis=1),
            np.stack([w_y, -w_x, zero], axis=1),
            source="model=plate",
        )

    def _free(self, mesh: Any, basis: Any, sides: list[float]) -> Array:
        """List the unknowns that the edges leave free: w and its slope along a held edge are 0."""
        held, nodal = [], basis.nodal_dofs  # w, w_x, w_y, w_xy a node
        names = itertools.product((0, 1), (-1, 1))
        edges = (EdgeSide.left, EdgeSide.right, EdgeSide.bottom, EdgeSide.top)
        for (axis, end), side in zip(names, edges, strict=True):
            on = np.isclose(mesh.p[axis], end * sides[axis] / 2, atol=1e-9 * sides[axis])
            held += [nodal[0][on], nodal[2 - axis][on]]
            if side in self.clamped:
                held.append(nodal[1 + axis][on])
        return np.setdiff1d(np.arange(basis.N), np.concatenate(held))


def _matrices(fem: Any, basis: Any, values: Mapping[str, float], h: float) -> tuple[Any, Any]:
    """Assemble stiffness and mass of Kirchhoff's plate."""
    nu = values["nu"]
    stiff, heavy = values["E"] * h**3 / (12 * (1 - nu**2)), values["rho"] * h
    helpers = fem.helpers

    def bending(u: Any, v: Any, _: Any) -> Any:
        curved, other = helpers.dd(u), helpers.dd(v)
        both = helpers.trace(curved) * helpers.trace(other)
        return stiff * ((1 - nu) * helpers.ddot(curved, other) + nu * both)

    def inertia(u: Any, v: Any, _: Any) -> Any:
        return heavy * u * v

    return tuple(fem.BilinearForm(f).assemble(basis) for f in (bending, inertia))


def _scikit_fem() -> Any:
    """Import scikit-fem, which is an extra."""
    try:
        import skfem
        import skfem.helpers
    except ImportError:
        raise UserError(
            "model=plate needs the package scikit-fem; install it with: pip install 'sldvexp[fe]'"
        ) from None
    return skfem
