"""`reconstruction=combined`: views and differences of views together (Eq 5.9)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.reconstruction import rows
from sldvexp.reconstruction.base import Reconstruction
from sldvexp.reconstruction.rows import RowChoice


@register("reconstruction", "combined")
@dataclass
class Combined(Reconstruction):
    """Rows are any mixture, as in ``1-5,2,4``; by default the best conditioned set.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.reconstruction import Combined
    >>> str(Combined(rows="2-1,3").row_set(np.eye(3)[:, None], ["left", "right", "top"]))
    'right-left,top'
    """

    rows: str = "best"

    def _check(self, checks: Checks) -> None:
        super()._check(checks)
        checks.require(
            self.rows != "all", "rows", "must be best or rows as in 1-5,2,4: all is no mixture"
        )

    def row_choice(self, view_names: Sequence[str]) -> RowChoice:
        """Take every view and every difference of two views."""
        return rows.RowChoice(candidates=rows.views(view_names) + rows.differences(view_names))
