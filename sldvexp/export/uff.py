"""`export=uff`: universal files for modal analysis."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np

from sldvexp.config.registry import register
from sldvexp.errors import UserError
from sldvexp.export.base import Export
from sldvexp.export.results import Results
from sldvexp.files import whole_or_nothing
from sldvexp.io.uff import writer as uf
from sldvexp.io.uff.writer import qualifiers, units
from sldvexp.typing import Array


class GeometryDataSets(Enum):
    """Which data sets hold nodes, elements and coordinate systems.

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
    """What the shapes of data sets 55 are called.

    Attributes
    ----------
    response
        A frequency response, which they are: operating deflection shapes.
    mode
        Undamped complex modes, for programs that animate nothing else.
    """

    response = "response"
    mode = "mode"


@dataclass(frozen=True)
class _Text:
    """The lines that identify a data set."""

    results: Results

    def lines(self, what: str, where: str) -> list[str]:
        about = self.results.about
        convention = f"{about['amplitude_convention']} amplitude, {about['time_convention']}"
        return [
            f"{what}, m/s",
            f"{convention}, phase against the {about['phase_reference']}",
            about.get("end_time", ""),
            where,
            about.get("title", ""),
        ]


@register("export", "uff")
@dataclass
class UffExport(Export):
    """Geometry, shapes at every frequency and spectra of every node and direction, SI units.

    Shapes (data set 55, six digits) come with their standard error and confidence as real shapes
    after them. Spectra (58, thirteen digits) are labelled with node and direction; of local
    components the directions 1, 2, 3 are t1, t2, n, and every node refers to a coordinate system
    (2420) that tells what these are in the world, so that bounds stay what they are. Nodes count
    from 1. What is not determined is left out: a direction's spectrum, a node of the shapes. A run
    of points has shapes and spectra only.

    Parameters
    ----------
    geometry : GeometryDataSets
        Data sets for nodes, elements and coordinate systems.
    shapes : ShapeNames
        What a shape is called.
    """

    geometry: GeometryDataSets = GeometryDataSets.current
    shapes: ShapeNames = ShapeNames.response

    suffix = ".uff"

    def write(self, results: Results, path: Path) -> None:
        """Write all data sets.

        Raises
        ------
        UserError
            If the frequencies of the run are not known.
        """
        if results.frequency is None:
            raise UserError(
                "export=uff: the run's velocities have no frequency, and a universal file needs "
                "one; give it with the velocities, as in a column frequency"
            )
        with whole_or_nothing(path) as beside, beside.open("w", encoding="ascii") as file:
            file.write(units())
            file.writelines(self._geometry(results))
            file.writelines(self._shapes(results, results.frequency))
            file.write(qualifiers())
            file.writelines(_functions(results, results.frequency))

    def _geometry(self, results: Results) -> Iterator[str]:
        if (mesh := results.mesh) is None:
            return
        count = mesh.surface_nodes
        frames = mesh.frame[:count] if results.local else mesh.frame[:0]
        system = np.full(len(mesh.position), uf.WORLD_SYSTEM)
        if results.local:
            system += 1 + np.arange(len(system)) % count
        if self.geometry is GeometryDataSets.current:
            yield uf.systems(frames)
            yield uf.nodes(mesh.position, system)
            yield uf.elements(mesh.prisms, mesh.surface_triangles)
        else:
            yield uf.systems_18(frames)
            yield uf.nodes_15(mesh.position, system)
            yield uf.trace_lines(mesh.surface_triangles, "surface")

    def _shapes(self, results: Results, frequency: Array) -> Iterator[str]:
        kind = uf.COMPLEX_MODE if self.shapes is ShapeNames.mode else uf.RESPONSE
        bounds = {"velocity_std": "Standard error", "confidence": "Half-width of the interval"}
        text = _Text(results)
        level = f"confidence level {results.about['confidence_level']}"
        for i, f in enumerate(frequency):
            where = f"components {', '.join(results.components)} at {f!s} Hz"
            yield uf.shape(text.lines("Velocity", where), results.velocity[..., i], f, i + 1, kind)
            for name, bound in results.bounds.items():
                told = f"{bounds[name]} of real and imaginary part of the velocity each"
                about = text.lines(told, where)
                about[4] = level
                yield uf.shape(about, bound[..., i], f, i + 1, uf.RESPONSE)


def _functions(results: Results, frequency: Array) -> Iterator[str]:
    """A spectrum of each node and direction, of the frequencies where it is determined."""
    text = _Text(results)
    place = "node" if results.mesh else "point"
    known = np.isfinite(results.velocity)
    for number, (node, i) in enumerate(np.argwhere(known.any(axis=2)), start=1):
        where = f"{place} {results.names[node]}, along {results.components[i]}"
        about = text.lines("Velocity", where)
        at = known[node, i]
        values = results.velocity[node, i, at]
        yield uf.function(about, number, node + 1, i + 1, frequency[at], values)
