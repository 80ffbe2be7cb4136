"""`reconstruction=contravariant`: ``V = sum v_j g^j`` (Eqs 5.13, 5.14 and 5.16)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from sldvexp.config.registry import register
from sldvexp.reconstruction import rows
from sldvexp.reconstruction.base import Reconstruction
from sldvexp.reconstruction.rows import RowChoice
from sldvexp.reconstruction.system import Model


@register("reconstruction", "contravariant")
@dataclass
class Contravariant(Reconstruction):
    """Three rows, views or differences, whose contravariant basis g^j carries the velocity.

    At a point this is the solution of three rows by any method; the basis itself is the result's
    `PointVelocity.basis`. Measured values stand on one side of the equation only, which a velocity
    field makes use of. By default the best conditioned three rows, four for an intercept. With
    ``all`` it is the least squares of all views, whose solution at a point is the same as that of
    `absolute`.

    A field takes the velocity at every sample by itself. With ``weights=noise`` samples count by
    the inverse of its variance, those that few or nearly parallel views see for less, and where a
    view of the best three does not see a sample all that do stand in. With ``weights=equal``, the
    dissertation's, all samples count alike.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.reconstruction import Contravariant
    >>> result = Contravariant("1,2,3").reconstruct(np.eye(3), [1e-3, 0, 2e-3])
    >>> result.basis[0].round(3).tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """

    rows: str = "best"

    sample_by_sample: ClassVar[bool] = True

    def row_choice(self, view_names: Sequence[str]) -> RowChoice:
        """Take as many views and differences of two as there are unknowns, or every view."""
        views = rows.views(view_names)
        candidates = views + rows.differences(view_names)
        if self.rows.strip() == "all":
            return rows.RowChoice(candidates=candidates, every=views)
        return rows.RowChoice(candidates=candidates, count=4 if self.model is Model.full else 3)
