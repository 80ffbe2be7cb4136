"""`check=kreis`: Kreis's criterion for the velocity of a point, a condition number above 0.1.

Errors of the data and of the directions grow by up to the condition number of the matrix that is
solved; Kreis asks for a Hadamard number above 0.1 (Sections 2.1 and 5.2.1). Section 5.2.6 applies
his limit to the reciprocal condition number instead. The two differ: ``|det| / product of the rows'
lengths`` does not see that differences of views are short, which is why their errors are large.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sldvexp import dataset
from sldvexp.check.base import Check, Examination
from sldvexp.check.single_point import point_methods
from sldvexp.config.registry import register
from sldvexp.errors import Checks
from sldvexp.lazy import xarray as xr


@register("check", "kreis")
@dataclass
class Kreis(Check):
    """Condition numbers of all reconstructions of points against Kreis's limit.

    The criterion is about as many rows as unknowns. Least squares solves ``D^T D``, whose number is
    about the square of that of D; it is given, and not judged.

    Parameters
    ----------
    limit : float
        Above which a condition number is good.
    """

    limit: float = 0.1

    def __post_init__(self) -> None:
        checks = Checks()
        checks.probability("limit", self.limit)
        checks.done()

    def examine(self, run: Examination) -> xr.Dataset:
        """Find both numbers of every method, and which of them keep the limit.

        Raises
        ------
        UserError
            If no point was reconstructed.
        """
        methods = point_methods(run, "kreis")
        attributes = [group.attrs for group in methods.values()]
        unknowns = [4 if a["model"] == "full" else 3 for a in attributes]
        rows = [group.sizes["row"] for group in methods.values()]
        rcond, hadamard = (np.array([a[n] for a in attributes]) for n in ("rcond", "hadamard"))
        exact = np.array(rows) == unknowns
        by_rcond, by_hadamard = (exact & (n > self.limit) for n in (rcond, hadamard))
        found = dataset.group(
            "examined/kreis",
            {"method": list(methods)},
            rcond=rcond,
            hadamard=hadamard,
            judged=exact,
            meets_by_rcond=by_rcond,
            meets_by_hadamard=by_hadamard,
        )
        found.attrs["notes"] = self._note(list(methods), exact, by_rcond, by_hadamard)
        return found

    def _note(
        self,
        methods: list[str],
        exact: np.ndarray,
        by_rcond: np.ndarray,
        by_hadamard: np.ndarray,
    ) -> str:
        """Say which methods keep the limit; nothing if all do, by both numbers."""
        if (by_rcond & by_hadamard)[exact].all():
            return ""

        def named(which: np.ndarray) -> str:
            return ", ".join(m for m, w in zip(methods, which, strict=True) if w) or "no method"

        by_one = by_hadamard & ~by_rcond
        more = f"; by the Hadamard number also {named(by_one)}" if by_one.any() else ""
        return (
            f"Kreis's criterion, a reciprocal condition number above {self.limit:g}, is met by "
            f"{named(by_rcond)} and not by {named(exact & ~by_rcond)}: the views' errors grow more "
            f"there{more}"
        )
