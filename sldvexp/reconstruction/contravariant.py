"""`reconstruction=contravariant`: ``V = sum v_j g^j`` (Eqs 5.13, 5.14 and 5.16)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sldvexp.errors import Checks
from sldvexp.reconstruction.base import Model, Reconstruction
from sldvexp.registry import register

if TYPE_CHECKING:
    from sldvexp.reconstruction.rows import RowChoice


@register("reconstruction", "contravariant")
@dataclass
class Contravariant(Reconstruction):
    """Three rows, views or differences, whose contravariant basis g^j carries the velocity.

    At a point this is the solution of three rows by any method; the basis itself is the result's
    `PointVelocity.basis`. Measured values stand on one side of the equation only, which a velocity
    field makes use of. By default the best conditioned three rows.
    """

    rows: str = "best"

    def _check(self, checks: Checks) -> None:
        super()._check(checks)
        checks.require(
            self.rows != "all", "rows", "must be best or three rows as in 1-5,2,4, not all"
        )
        checks.require(
            self.model is Model.partial,
            "model",
            "must be partial for contravariant: three base vectors leave no intercept",
        )

    def row_choice(self, view_names: Sequence[str]) -> RowChoice:
        """Three of the views and differences of two views."""
        from sldvexp.reconstruction import rows

        candidates = rows.views(view_names) + rows.differences(view_names)
        return rows.RowChoice(candidates=candidates, count=3)
