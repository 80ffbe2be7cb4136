"""Base of all volumes: layers along a surface's normals, samples, and a place in the world.

Where the vibrating surface is, is known from a mesh or a digitiser to a few millimetres only: so
the given surface is moved along its normals to several depths, and the velocity is expanded in
linear functions on the prisms in between (Section 5.3.1). A strategy gives the surface in its own
axes; everything else is the same for all.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from sldvexp import dataset
from sldvexp.errors import Checks
from sldvexp.geometry import rotation_from_euler
from sldvexp.image import Interpolation
from sldvexp.lazy import xarray as xr
from sldvexp.typing import Array
from sldvexp.units import LengthUnit, beyond_belief
from sldvexp.volume.samples import Prisms, SampleRule, extruded, tensor_rule
from sldvexp.volume.surface import (
    TriangulatedSurface,
    check_prisms,
    check_surface,
    node_frames,
    vertex_normals,
)

#: How many symmetric points inside the triangle there can be; see `sldvexp.volume.samples`.
TRIANGLE_COUNTS = (1, 3, 6, 7, 12)

#: By how much xi1 + xi2 + xi3 may differ from 1.
ROUNDING = 1e-9


@dataclass
class SampleSettings:
    """Places where velocities are sampled in every prism (Section 5.3.4).

    Parameters
    ----------
    triangle : int
        Points across the prism: 1, 3, 6, 7 or 12 symmetric Gauss points of the triangle.
    line : int
        Gauss points through its thickness; every combination is a sample.
    parameters : list of [xi1, xi2, xi3, zeta]
        Instead of both: the samples themselves, in the parameters of Eq 5.19; xi from 0 to 1,
        together 1, and zeta from -1 to 1.
    """

    triangle: int = 3
    line: int = 2
    parameters: list[Any] = field(default_factory=list)  # of lists: OmegaConf knows no nested ones

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what cannot be sampled."""
        counts = ", ".join(map(str, TRIANGLE_COUNTS))
        message = f"must be one of {counts} points, not {self.triangle}"
        checks.require(self.triangle in TRIANGLE_COUNTS, f"{name}.triangle", message)
        message = f"must be 1 point or more, not {self.line}"
        checks.require(self.line >= 1, f"{name}.line", message)
        for i, point in enumerate(self.parameters):
            wrong = _wrong_parameters(point)
            if not wrong and point in self.parameters[:i]:
                wrong = f"is the point {self.parameters.index(point)} again"
            checks.require(not wrong, f"{name}.parameters[{i}]", wrong)

    def rule(self) -> SampleRule:
        """Choose the samples' parameters."""
        if self.parameters:
            return SampleRule(np.array(self.parameters, float))
        return tensor_rule(self.triangle, self.line)


class Coordinates(Enum):
    """Axes of the nodes' velocity components: the world's, or the surface's own at every node."""

    world = "world"
    local = "local"


@dataclass
class VisibilitySettings:
    """Settings of how the samples are found in the views' images (Section 5.3.5).

    Parameters
    ----------
    interpolation : Interpolation
        Between the pixels of an image: linear; cubic, of higher order and slower; or auto, which
        takes cubic if that surely predicts pixels better from their neighbours.
    grazing : float, deg
        Samples whose surface is seen at a larger angle from its normal are left out.
    both_sides : bool
        Views see the surface from behind as well; otherwise only the side of its normals. Of a
        thin shell the back is then half a thickness below the middle surface, as the face is above
        it, and the place of a view's instrument tells which of them it looks at.
    occlusion : bool
        Leave out what the surface itself hides from a view, which only curved ones do.
    background : bool
        Use pixels beside the structure that are at rest as if they were on it, as Chapter 5 does;
        otherwise fields of elements have no part of them.
    """

    interpolation: Interpolation = Interpolation.auto
    grazing: float = 75.0
    both_sides: bool = False
    occlusion: bool = False
    background: bool = False

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what is wrong."""
        message = f"must lie between 0 and 90 deg, not {self.grazing}"
        checks.require(0 < self.grazing < 90, f"{name}.grazing", message)


@dataclass
class Volume(ABC):
    """A family of surfaces around the real one. A strategy implements the one hook `surface`.

    Parameters
    ----------
    unit : LengthUnit
        Of all lengths below.
    center : list of 3 float
        Where the zero of the surface's own axes stands in the world.
    euler : list of 3 float, rad
        phi1, phi2, phi3 in the x-convention, world to the surface's own axes.
    layers : int
        How many surfaces there are.
    thickness : float
        From the lowest to the highest of them, along the normals.
    offset : float
        Depth of the middle of them; 0 is the given surface.
    depth : list of float
        Instead of the three above: the depth of every layer, ascending.
    margin : float
        How far the structure goes on beyond the surface. Splines on the surface take pixels there
        too, which makes them surer at its edges.
    tangent : list of 3 float
        In the surface's own axes: its projection on the surface is the first tangent t1.
    samples : SampleSettings
    sight : VisibilitySettings
    coordinates : Coordinates
        Axes of the nodes' velocity components.
    """

    unit: LengthUnit = LengthUnit.m
    center: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    euler: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    layers: int = 7
    thickness: float = 0.03
    offset: float = 0.0
    depth: list[float] = field(default_factory=list)
    margin: float = 0.0
    tangent: list[float] = field(default_factory=lambda: [1.0, 0.0, 0.0])
    samples: SampleSettings = field(default_factory=SampleSettings)
    sight: VisibilitySettings = field(default_factory=VisibilitySettings)
    coordinates: Coordinates = Coordinates.world

    def __post_init__(self) -> None:
        checks = Checks()
        for name in ("center", "euler"):
            vector(checks, name, getattr(self, name))
        told = beyond_belief(self.unit, *self.center)
        checks.require(not told, "center", told)
        self._check_tangent(checks)
        message = f"must be 2 or more, with prisms between them, not {self.layers}"
        checks.require(self.layers >= 2, "layers", message)
        checks.positive("thickness", self.thickness)
        checks.finite("offset", self.offset)
        checks.non_negative("margin", self.margin)
        self._check_depth(checks)
        self.samples.check(checks, "samples")
        self.sight.check(checks, "sight")
        self.check(checks)
        checks.done()

    def check(self, checks: Checks) -> None:  # noqa: B027  most have more to check, not all
        """Note what is wrong with the strategy's own settings."""

    @abstractmethod
    def surface(self) -> TriangulatedSurface:
        """Make the given surface in its own axes, m."""

    def inputs(self) -> list[str]:
        """List files that the volume is made from, as the configuration names them."""
        return []

    def prisms(self) -> Prisms:
        """Make the volume in the world.

        Raises
        ------
        UserError
            If the surface is unsound, or the layers fold.
        """
        return self._prisms(self.surface())

    def _prisms(self, own: TriangulatedSurface) -> Prisms:
        """Extrude the surface and put it into the world."""
        check_surface(own)
        normal = vertex_normals(own) if own.normal is None else own.normal
        check_prisms(own, normal, self.depths())
        first = np.array(self.tangent, float) if self.tangent else own.tangent
        assert first is not None
        frame = node_frames(own, normal, first)
        to_world = rotation_from_euler(self.euler)
        position = own.position @ to_world + self.unit.value * np.array(self.center)
        return extruded(position, own.triangles, frame @ to_world, self.depths())

    def rule(self) -> SampleRule:
        """Choose where the samples lie in every prism."""
        return self.samples.rule()

    def depths(self) -> Array:
        """Compute the depth of every layer, ascending, m."""
        if self.depth:
            return self.unit.value * np.array(self.depth, float)
        half = self.thickness / 2
        return self.unit.value * np.linspace(self.offset - half, self.offset + half, self.layers)

    def group(self) -> xr.Dataset:
        """Make the group ``volume`` of a run, with what was merged as its attribute."""
        own = self.surface()
        group = volume_to_dataset(self._prisms(own), self.rule())
        return group.assign_attrs(merged=own.told) if own.told else group

    def _check_tangent(self, checks: Checks) -> None:
        vector(checks, "tangent", self.tangent)
        length = math.hypot(*self.tangent)
        checks.require(length > 0, "tangent", "must be a direction, not zero")

    def _check_depth(self, checks: Checks) -> None:
        if not self.depth:
            return
        checks.finite("depth", *self.depth)
        message = f"must be 2 depths or more, with prisms between them, not {len(self.depth)}"
        checks.require(len(self.depth) >= 2, "depth", message)
        for i, (low, high) in enumerate(zip(self.depth[:-1], self.depth[1:], strict=True)):
            message = (
                f"must be above {low:g}, or the prisms in between have no volume, not {high:g}"
            )
            checks.require(not high <= low, f"depth[{i + 1}]", message)


def vector(checks: Checks, name: str, values: list[float], count: int = 3) -> None:
    """Note under `name` what are not so many finite numbers."""
    message = f"must be {count} numbers, not {len(values)}"
    checks.require(len(values) == count, name, message)
    checks.finite(name, *values)


def _wrong_parameters(point: Any) -> str:
    """Say what is wrong with xi1, xi2, xi3, zeta; empty if nothing is."""
    numbers = isinstance(point, list) and all(
        isinstance(v, int | float) and math.isfinite(v) for v in point
    )
    if not numbers or len(point) != 4:
        return f"must be the four numbers [xi1, xi2, xi3, zeta], not {point}"
    *xi, zeta = point
    if abs(sum(xi) - 1.0) > ROUNDING:
        return (
            f"has xi1 + xi2 + xi3 = {sum(xi):.10g}, which must be 1; a third may be written as "
            "0.3333, 0.3333, 0.3334"
        )
    if min(xi) < 0 or abs(zeta) > 1:
        return "lies outside of the prism: xi must be from 0 to 1 and zeta from -1 to 1"
    return ""


#: UGRID's numbers of the shapes that a volume can have.
SHAPES = ("tetrahedron", "pyramid", "wedge", "hexahedron")

LOCAL_AXES = ("t1", "t2", "n")


def volume_to_dataset(prisms: Prisms, rule: SampleRule) -> xr.Dataset:
    """Make the group ``volume``: nodes, prisms, frames, and the samples' parameters.

    Returns
    -------
    xarray.Dataset
        A fully three-dimensional mesh topology of UGRID 1.0, indices from 0; attributes say how
        many nodes, prisms and samples there are.
    """
    element = prisms.element.astype(np.int32)
    x, y, z = prisms.position.T
    group = dataset.group(
        "volume",
        {"parameter": ["xi1", "xi2", "xi3", "zeta"], "local_axis": list(LOCAL_AXES)},
        mesh=np.int32(0),
        position=prisms.position,
        node_x=x,
        node_y=y,
        node_z=z,
        node_layer=prisms.layer.astype(np.int32),
        element=element,
        element_shape=np.full(len(element), SHAPES.index("wedge"), np.int8),
        depth=prisms.depth,
        frame=prisms.frame,
        sample_parameter=rule.parameter,
    )
    group["mesh"].attrs |= {
        "cf_role": "mesh_topology",
        "topology_dimension": 3,
        "node_coordinates": "node_x node_y node_z",
        "volume_node_connectivity": "element",
        "volume_dimension": "element",
        "volume_shape_type": "element_shape",
    }
    group["element"].attrs |= {"cf_role": "volume_node_connectivity", "start_index": 0}
    group["element_shape"].attrs |= {
        "cf_role": "volume_shape_type",
        "flag_values": np.arange(len(SHAPES), dtype=np.int8),
        "flag_meanings": " ".join(SHAPES),
    }
    for name in ("position", "node_layer"):
        group[name].attrs |= {"mesh": "mesh", "location": "node"}
    group.attrs |= {
        "Conventions": "CF-1.11 UGRID-1.0",
        "nodes": prisms.nodes,
        "surface_nodes": prisms.surface_nodes,
        "triangles": len(prisms.triangles),
        "elements": len(element),
        "samples": len(element) * rule.points,
    }
    return group
