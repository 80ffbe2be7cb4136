"""`reconstruction=neighbours`: differences of views that were measured one after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sldvexp.errors import Checks, UserError
from sldvexp.reconstruction import Reconstruction
from sldvexp.registry import register

if TYPE_CHECKING:
    from sldvexp.reconstruction import RowChoice


@register("reconstruction", "neighbours")
@dataclass
class Neighbours(Reconstruction):
    """Rows are differences of neighbouring views, as in ``2-1,3-2,4-3``.

    Parameters
    ----------
    apart : int
        How many places two neighbours stand apart in the order of the views.
    """

    apart: int = 1

    def _check(self, checks: Checks) -> None:
        super()._check(checks)
        checks.require(self.apart >= 1, "apart", f"must be at least 1, not {self.apart}")

    def row_choice(self, view_names: Sequence[str]) -> RowChoice:
        """Every difference of two views; ``all`` are those of neighbours."""
        from sldvexp.reconstruction import rows

        later = range(self.apart, len(view_names))
        pairs = [f"{view_names[i]}-{view_names[i - self.apart]}" for i in later]
        if not pairs:
            raise UserError(f"of {len(view_names)} views no two are {self.apart} places apart")
        return rows.RowChoice(
            candidates=rows.differences(view_names),
            every=rows.parse(",".join(pairs), view_names),
        )
