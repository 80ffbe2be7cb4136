"""`export=uff`: universal files for modal analysis."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np

from sldvexp.config.registry import register
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import UserError
from sldvexp.export.base import VelocitiesOf, VelocityExport
from sldvexp.export.strains import beside, strain_of, symmetric_tensor
from sldvexp.export.velocities import (
    PrismMesh,
    bounds_of,
    describe,
    frequencies_of,
    is_field,
    is_local,
    mesh_of,
    velocities_of,
)
from sldvexp.io.uff import writer as uf
from sldvexp.io.uff.seal import SealedWriter
from sldvexp.io.uff.writer import qualifiers, units
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array, ComplexArray
from sldvexp.writing import whole_or_nothing


class GeometryDataSets(Enum):
    """Data sets that hold nodes, elements and coordinate systems.

    Attributes
    ----------
    current
        2411, 2412 and 2420: prisms, and the triangles of the surface.
    legacy
        15, 82 and 18, six digits: outlines of the surface's triangles.
    """

    current = "current"
    legacy = "legacy"


class ShapeNames(Enum):
    """Names of the shapes of data sets 55.

    Attributes
    ----------
    response
        A frequency response, which they are: operating deflection shapes.
    mode
        Undamped complex modes, for programs that animate nothing else.
    normal
        Real shapes with frequency and damping, turned in phase to be as real as can be; of mode
        shapes alone, which are complex modes otherwise.
    """

    response = "response"
    mode = "mode"
    normal = "normal"


class ModeDataSets(Enum):
    """Data sets that mode shapes are written in.

    Attributes
    ----------
    nodal
        55, which every program reads.
    analysis
        2414, its successor.
    """

    nodal = "nodal"
    analysis = "analysis"


#: At the end of the name of the file that holds the bounds of modes.
BOUNDS = "_bounds"
#: What shapes of strain are, in their order.
STRAINS = {
    "strain": "Strain of the face",
    "strain_std": "Standard error of real and imaginary part of the strain each",
    "confidence": "Half-width of the interval of real and imaginary part of the strain each",
}


@register("export", "uff")
@dataclass
class UffExport(VelocityExport):
    """Geometry, shapes at every frequency and spectra of every node and direction, SI units.

    A checksum of all lines comes first (151), by which this program sees later damage. Shapes
    (55, six digits) come with their standard error and confidence as real shapes after them.
    Spectra (58, thirteen digits) are labelled with node and direction; of local
    components the directions 1, 2, 3 are t1, t2, n, and every node refers to a coordinate system
    (2420) that tells what these are in the world, so that bounds stay what they are. Nodes count
    from 1. What is not determined is left out: a direction's spectrum, a node of the shapes. A run
    of points has geometry if their positions are known. Strains of the face have a file of their
    own, ``<name>_strain.uff``: the surface's nodes and triangles, and at every frequency a shape
    (55) of symmetric tensors along the axes of each node, complex, with its standard error and
    confidence after it; xx, xy and yy are those of the surface, the others zero.

    Mode shapes (``of=modes``) come with their poles, as complex modes or normal ones, and without
    spectra. Their modal mass is written as 0, for it is not known; they are peak velocities at
    resonance. Their standard errors and confidence, which programs for modes do not know, are in
    ``<name>_bounds.uff``.

    Parameters
    ----------
    geometry : GeometryDataSets
        Data sets for nodes, elements and coordinate systems.
    shapes : ShapeNames
        What a shape is called.
    modes : ModeDataSets
        Data sets for mode shapes.
    """

    geometry: GeometryDataSets = GeometryDataSets.current
    shapes: ShapeNames = ShapeNames.response
    modes: ModeDataSets = ModeDataSets.nodal

    suffix = ".uff"

    def write(self, run: RunData, path: Path) -> None:
        """Write all data sets.

        Raises
        ------
        UserError
            If the frequencies of the run are not known.
        """
        if self.shapes is ShapeNames.normal and not self._of_modes:
            raise UserError("export=uff: shapes=normal is for mode shapes; add of=modes")
        found = velocities_of(run)
        if (frequency := frequencies_of(found)) is None:
            raise UserError(
                "export=uff: the run's velocities have no frequency, and a universal file needs "
                "one; give it with the velocities, as in a column frequency"
            )
        if (strain := strain_of(run)) is not None:
            with _sealed(beside(path)) as file:
                file.writelines(self._strains(run, strain))
        if self._of_modes:
            # Programs that take modes take no other shapes in the file.
            with _sealed(path.with_name(f"{path.stem}{BOUNDS}{path.suffix}")) as file:
                file.write(units())
                for i, f in enumerate(frequency):
                    file.writelines(_bounds(run, found, f, i))
        with _sealed(path) as file:
            file.write(units())
            if is_field(run) or run.has("line_of_sight", "position"):
                file.writelines(self._geometry(mesh_of(run, "uff"), is_local(found)))
            if self._of_modes:
                file.writelines(self._modes(run, found, frequency))
                return
            file.writelines(self._shapes(run, found, frequency))
            file.write(qualifiers())
            file.writelines(_functions(run, found, frequency))

    @property
    def _of_modes(self) -> bool:
        """Tell whether shapes are those of modes."""
        return self.of is VelocitiesOf.modes

    def _geometry(self, mesh: PrismMesh, local: bool) -> Iterator[str]:
        """Write coordinate systems, nodes and elements."""
        count = mesh.surface_nodes
        frames = mesh.frame[:count] if local else mesh.frame[:0]
        system = np.full(len(mesh.position), uf.WORLD_SYSTEM)
        if local:
            system += 1 + np.arange(len(system)) % count
        if self.geometry is GeometryDataSets.current:
            yield uf.systems(frames)
            yield uf.nodes(mesh.position, system)
            if len(mesh.prisms) or len(mesh.triangles):
                yield uf.elements(mesh.prisms, mesh.surface_triangles)
            if len(mesh.lines):
                yield uf.trace_lines(mesh.lines, "lines")
        else:
            yield uf.systems_18(frames)
            yield uf.nodes_15(mesh.position, system)
            for joined in (mesh.surface_triangles, mesh.lines):
                if len(joined):
                    yield uf.trace_lines(joined, "surface")

    def _strains(self, run: RunData, strain: xr.Dataset) -> Iterator[str]:
        """Write the surface, and tensors with their bounds at each frequency."""
        yield units()
        position, frame = strain["position"].values, strain["frame"].values
        triangles = strain["triangle"].values
        # As those of a field that is one layer: every node has axes of its own.
        one = PrismMesh(position, np.empty((0, 6), int), triangles, np.zeros(1), frame)
        yield from self._geometry(one, True)
        about = describe(run)
        level = f"confidence level {strain.attrs['confidence_level']}"
        for i, f in enumerate(strain["frequency"].values.tolist()):
            at = strain.isel(frequency=i)
            where = f"symmetric tensor along t1, t2 at {f!s} Hz"
            for name, what in STRAINS.items():
                text = _text(about, what, where, "")
                if name != "strain":
                    text = [*text[:4], level]
                values = symmetric_tensor(at[name].values)
                yield uf.shape(text, values, f, i + 1, uf.RESPONSE, uf.STRAIN)

    def _shapes(self, run: RunData, found: xr.Dataset, frequency: Array) -> Iterator[str]:
        """Write a shape and its bounds at each frequency."""
        kind = uf.COMPLEX_MODE if self.shapes is ShapeNames.mode else uf.RESPONSE
        about = describe(run)
        for i, f in enumerate(frequency):
            values = found["velocity"].values[..., i]
            yield uf.shape(_text(about, "Velocity", _where(found, f)), values, f, i + 1, kind)
            yield from _bounds(run, found, f, i)

    def _modes(self, run: RunData, found: xr.Dataset, frequency: Array) -> Iterator[str]:
        """Write mode shapes with their poles."""
        write = uf.mode_55 if self.modes is ModeDataSets.nodal else uf.mode_2414
        about = describe(run)
        for i, (f, pole) in enumerate(zip(frequency, _poles(run, frequency), strict=True)):
            values = found["velocity"].values[..., i]
            shape = _turned_real(values) if self.shapes is ShapeNames.normal else values
            yield write(_text(about, "Mode shape", _where(found, f)), shape, pole, i + 1)


def _where(found: xr.Dataset, hertz: float) -> str:
    """Say along what, and at which frequency."""
    return f"components {', '.join(found['component'].values)} at {hertz!s} Hz"


def _bounds(run: RunData, found: xr.Dataset, hertz: float, i: int) -> Iterator[str]:
    """Write the bounds of the shape at a frequency, as real shapes."""
    names = {"velocity_std": "Standard error", "confidence": "Half-width of the interval"}
    about = describe(run)
    level = f"confidence level {about['confidence_level']}"
    for name, bound in bounds_of(found).items():
        what = f"{names[name]} of real and imaginary part of the velocity each"
        text = [*_text(about, what, _where(found, hertz))[:4], level]
        yield uf.shape(text, bound[..., i], hertz, i + 1, uf.RESPONSE)


def _poles(run: RunData, frequency: Array) -> ComplexArray:
    """Give the poles of the modes at these natural frequencies, rad/s."""
    modes = run.groups["modes"]
    known = modes["natural_frequency"].values
    own = np.abs(known[:, None] - frequency).argmin(axis=0)
    damping = modes["damping_ratio"].values[own]
    natural = 2 * np.pi * frequency
    poles: ComplexArray = natural * (-damping + 1j * np.sqrt(1 - damping**2))
    return poles


def _turned_real(values: ComplexArray) -> Array:
    """Turn a shape in phase so that the real part has most of it, and take that."""
    turn = 0.5 * np.angle(np.nansum(values**2))
    real: Array = (values * np.exp(-1j * turn)).real
    return real


@contextmanager
def _sealed(path: Path) -> Iterator[SealedWriter]:
    """Open a file that is whole or not there, with the checksum of its lines first."""
    with (
        whole_or_nothing(path) as whole,
        whole.open("w", encoding="ascii") as plain,
        SealedWriter(plain) as file,
    ):
        yield file


def _functions(run: RunData, found: xr.Dataset, frequency: Array) -> Iterator[str]:
    """Write a spectrum of each node and direction, of the frequencies where it is determined."""
    about = describe(run)
    place = "node" if is_field(run) else "point"
    names, components = found["place"].values, found["component"].values
    velocity = found["velocity"].values
    known = np.isfinite(velocity)
    for number, (node, i) in enumerate(np.argwhere(known.any(axis=2)), start=1):
        text = _text(about, "Velocity", f"{place} {names[node]}, along {components[i]}")
        at = known[node, i]
        values = velocity[node, i, at]
        yield uf.function(text, number, node + 1, i + 1, frequency[at], values)


def _text(about: dict[str, str], what: str, where: str, unit: str = ", m/s") -> list[str]:
    """Write the five lines that identify a data set."""
    convention = f"{about['amplitude_convention']} amplitude, {about['time_convention']}"
    return [
        f"{what}{unit}",
        f"{convention}, phase against the {about['phase_reference']}",
        about.get("end_time", ""),
        where,
        about.get("title", ""),
    ]
