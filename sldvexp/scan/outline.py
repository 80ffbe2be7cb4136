"""`scan=outline`: lines across the outline of a part, coarse and then fine.

The part's mesh and a rough pose predict the outline; lines are laid across it evenly, from the part
outwards. The part must move where the lines cross it, and what lies behind it rest, or send no
light back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from sldvexp.config.paths import locate
from sldvexp.config.registry import register
from sldvexp.errors import Checks, UserError
from sldvexp.geometry import KnownPose
from sldvexp.io import read_mesh
from sldvexp.laser import PartOutline, TwoMirror
from sldvexp.scan.base import Sampling, ScanPart, check_rough_pose, check_view_names
from sldvexp.scan.calibration import EdgeMethod, check_line, usual_stride
from sldvexp.typing import Array, IntArray
from sldvexp.units import LengthUnit

#: Extent of a part over its distance, and that distance in m, between which one sees an outline.
SEEN, POSSIBLE = (0.01, 1.5), (0.05, 30.0)
#: Stride of coarse lines over that of fine ones: they reach some centimetres beside the outline.
COARSER = 8


@dataclass
class PartMesh:
    """Mesh of a part, whose axes are those of the world.

    Parameters
    ----------
    path : str
        ``.stl``, ``.obj``, universal file or another mesh of the part's surface; of a thin part
        the face that is seen is enough.
    unit : LengthUnit
        Of the mesh's coordinates.
    """

    path: str = ""
    unit: LengthUnit = LengthUnit.m

    def inputs(self) -> list[str]:
        """Name the mesh file."""
        return [self.path] if self.path else []

    def check_mesh(self, checks: Checks) -> None:
        """Note a mesh that is not given."""
        told = "must name the part's mesh, as part.stl"
        checks.require(bool(self.path), "path", told)

    def outline(self) -> PartOutline:
        """Read the mesh."""
        mesh = read_mesh(locate(self.path), self.unit.value, flip=False)
        return PartOutline.from_mesh(mesh.position, mesh.triangles)

    def require_size(self, part: PartOutline, poses: Sequence[Array]) -> None:
        """Refuse a part that is too large or too small for where instruments roughly stand.

        Parameters
        ----------
        poses : sequence of ndarray, shape (3,), m
            Origins.

        Raises
        ------
        UserError
            That names the unit in which the mesh would be right, if there is one.
        """
        for origin in poses:
            if _is_seen(part.position, origin):
                continue
            distance = float(np.linalg.norm(part.position.mean(axis=0) - origin))
            likely = [
                unit.name
                for unit in LengthUnit
                if _is_seen(part.position / self.unit.value * unit.value, origin)
            ]
            told = f"; is it in {' or '.join(likely)}?" if likely else ""
            raise UserError(
                f"{self.path}: the part is {part.extent:.3g} m large in {self.unit.name} and "
                f"{distance:.3g} m from the instrument, which cannot see such an outline{told}"
            )


def _is_seen(position: Array, origin: Array) -> bool:
    """Tell whether an outline of this size can be scanned from a place."""
    extent = float(np.ptp(position, axis=0).max())
    distance = float(np.linalg.norm(position.mean(axis=0) - origin))
    near = POSSIBLE[0] < distance < POSSIBLE[1]
    return near and SEEN[0] * distance < extent < SEEN[1] * distance


@dataclass
class OutlineLines:
    """Scan lines of one stage across the outline.

    Parameters
    ----------
    pixels : int
        Of each line.
    window : int
        Of the median filter along the line, pixels.
    stride : int, optional
        DAC steps from one pixel to the next. Without it 8 of coarse and 1 of fine lines, and eight
        times as many on a 16-bit board.
    """

    pixels: int
    window: int
    stride: int | None = None

    def check(self, checks: Checks, name: str) -> None:
        """Note under `name` what is wrong."""
        check_line(checks, name, self.pixels, self.window, self.stride)


@dataclass
class OutlineView:
    """One view of a part.

    Parameters
    ----------
    pose : KnownPose, optional
        Where the instrument roughly stands, in the axes of the mesh: to some centimetres and
        degrees, so that the coarse lines reach the outline.
    """

    pose: KnownPose | None = None


@register("scan", "outline")
@dataclass
class OutlineScan(PartMesh, ScanPart):
    """Lines across the outline of a part, for pose=part.

    Parameters
    ----------
    views : dict of str to OutlineView
    lines : int
        Spread evenly along the outline as a rough pose predicts it.
    coarse : OutlineLines
        Across the predicted outline; half their length is how far beside it may be.
    fine : OutlineLines
        Across the edge that a coarse line showed.
    edge : EdgeMethod
        For the fine lines, as in scan=calibration.
    sampling : Sampling
        At its first frequency the part should move all along its outline.
    """

    kind: ClassVar[str] = "outline"

    views: dict[str, OutlineView] = field(default_factory=dict)
    lines: int = 72
    coarse: OutlineLines = field(default_factory=lambda: OutlineLines(101, 5))
    fine: OutlineLines = field(default_factory=lambda: OutlineLines(31, 5))
    edge: EdgeMethod = EdgeMethod.profile
    sampling: Sampling = field(default_factory=Sampling)

    def __post_init__(self) -> None:
        checks = Checks()
        check_view_names(checks, self.views)
        if self.views:
            self.check_mesh(checks)
        for name, view in self.views.items():
            key = f"views.{name}.pose"
            told = "must say where the instrument roughly stands"
            checks.require(view.pose is not None, key, told)
            if view.pose is not None:
                check_rough_pose(checks, key, view.pose)
        checks.require(self.lines >= 12, "lines", f"must be at least 12, not {self.lines}")
        self.coarse.check(checks, "coarse")
        self.fine.check(checks, "fine")
        self.sampling.check(checks, "sampling")
        checks.done()

    def strides(self, laser: TwoMirror) -> tuple[int, int]:
        """Choose the strides of coarse and fine lines, where they are not set.

        Examples
        --------
        >>> OutlineScan().strides(TwoMirror())
        (8, 1)
        """
        fine = usual_stride(laser)
        return self.coarse.stride or COARSER * fine, self.fine.stride or fine

    def known_pixels(self, view: str) -> IntArray:
        """See `ScanPart`; none, since lines that leave the board are left out."""
        return np.zeros((0, 2), np.int64)

    def pixel_count(self, view: str) -> int:
        """See `ScanPart`."""
        return self.lines * (self.coarse.pixels + self.fine.pixels)
