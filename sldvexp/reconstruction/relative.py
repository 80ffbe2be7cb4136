"""`reconstruction=relative`: differences of views (Eqs 5.7 and 5.8)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.reconstruction import rows
from sldvexp.reconstruction.base import Reconstruction
from sldvexp.reconstruction.rows import RowChoice
from sldvexp.reconstruction.system import Model


@register("reconstruction", "relative")
@dataclass
class Relative(Reconstruction):
    """Rows are differences of two views, as in ``2-1,3-1,4-1``; by default all minus the first.

    An intercept cancels in differences, so that the model is always partial.

    Examples
    --------
    >>> import numpy as np
    >>> from sldvexp.reconstruction import Relative
    >>> str(Relative().row_set(np.eye(3)[:, None], ["left", "right", "top"]))
    'right-left,top-left'
    """

    def _check(self, checks: Checks) -> None:
        super()._check(checks)
        checks.require(
            self.model is Model.partial,
            "model",
            "must be partial for relative: an intercept cancels in every difference",
        )

    def row_choice(self, view_names: Sequence[str]) -> RowChoice:
        """Take every difference of two views; ``all`` subtracts the first view from the others."""
        return rows.RowChoice(
            candidates=rows.differences(view_names), every=rows.differences_from_first(view_names)
        )
