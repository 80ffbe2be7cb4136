"""`volume=grid`: a rectangular grid of nodes on a plane or on the panel of a cylinder."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.volume.base import Volume, vector
from sldvexp.volume.surface import Surface


class Diagonals(Enum):
    """How each cell of the grid is cut in two triangles."""

    alternate = "alternate"
    forward = "forward"
    backward = "backward"


@register("volume", "grid")
@dataclass
class Grid(Volume):
    """Evenly spaced nodes in rows along the surface's own x and y; its center stands at `center`.

    Parameters
    ----------
    size : list of 2 float
        Sides along its own x (the arc, if it is curved) and y.
    shape : list of 2 int
        Nodes along the two sides.
    radius : float, optional
        Of a cylinder about the line x = 0, z = -radius; negative where the normals point towards
        that axis. Without it the grid is flat.
    diagonals : Diagonals
        ``forward`` runs with x and y, ``backward`` against one of them; ``alternate`` changes
        from cell to cell, so that no direction is preferred.
    """

    size: list[float] = field(default_factory=lambda: [0.3, 0.25])
    shape: list[int] = field(default_factory=lambda: [9, 7])
    radius: float | None = None
    diagonals: Diagonals = Diagonals.alternate

    def check(self, checks: Checks) -> None:
        """Note what no grid can be."""
        known = len(checks.problems)
        vector(checks, "size", self.size, 2)
        for i, side in enumerate(self.size):
            checks.positive(f"size[{i}]", side)
        vector(checks, "shape", list(self.shape), 2)
        for i, nodes in enumerate(self.shape):
            message = f"must be 2 nodes or more, not {nodes}"
            checks.require(nodes >= 2, f"shape[{i}]", message)
        if self.radius is not None and len(checks.problems) == known:
            least = self.size[0] / (2 * math.pi)
            checks.require(
                math.isfinite(self.radius) and abs(self.radius) > least,
                "radius",
                f"must be finite and beyond +-{least:.6g} {self.unit.name}, where the panel "
                f"closes to a tube, not {self.radius}; null is flat",
            )

    def surface(self) -> Surface:
        """The grid in its own axes."""
        from sldvexp.volume.grid_surface import cylinder, grid

        unit = self.unit.value
        (nx, ny), (a, b) = self.shape, (unit * side for side in self.size)
        flat = grid(nx, ny, a, b, self.diagonals)
        return flat if self.radius is None else cylinder(flat, unit * self.radius)
