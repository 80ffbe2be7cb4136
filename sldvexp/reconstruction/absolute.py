"""`reconstruction=absolute`: the views themselves (Eqs 5.3 to 5.5, and 5.12 with an intercept)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sldvexp.config.registry import register
from sldvexp.reconstruction import rows
from sldvexp.reconstruction.base import Reconstruction
from sldvexp.reconstruction.rows import RowChoice


@register("reconstruction", "absolute")
@dataclass
class Absolute(Reconstruction):
    """Rows are single views, as in ``1,2,3``; by default all of them.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.reconstruction import Absolute
    >>> result = Absolute().reconstruct(np.eye(3), [1e-3, 0, 2e-3])
    >>> result.velocity[0, :, 0].tolist()
    [0.001, 0.0, 0.002]
    """

    def row_choice(self, view_names: Sequence[str]) -> RowChoice:
        """Take every view by itself."""
        views = rows.views(view_names)
        return rows.RowChoice(candidates=views, every=views)
