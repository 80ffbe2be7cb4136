"""What a run must reproduce: an entry of a configuration's `expect`."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from sldvexp.errors import Checks, nearest


@dataclass
class Expectation:
    """Numbers that a run must reproduce, or bounds that it must keep, from one source.

    Every mapping goes from what is compared, ``group/variable``, ``group/variable[dim=label, ...]``
    or ``group@attribute`` of the run's dataset, to the value.

    Parameters
    ----------
    source : str
        Table, figure or section.
    tolerance : float
        Largest accepted absolute difference, of real and imaginary part each.
    published : dict of str to number, text of a complex number, or nested lists of them
        Compared element by element.
    at_most, at_least : dict of str to float
        Bounds.
    correct : dict of str to str
        Where the dataset has the same quantity by the correct formula, when what is compared
        follows the convention of the print.
    """

    source: str = ""
    tolerance: float = 0.0
    published: dict[str, Any] = field(default_factory=dict)
    at_most: dict[str, float] = field(default_factory=dict)
    at_least: dict[str, float] = field(default_factory=dict)
    correct: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        checks = Checks()
        checks.non_negative("tolerance", self.tolerance)
        compared = self.compared
        checks.require(bool(compared), "", "says nothing: give published, at_most or at_least")
        for name in ("at_most", "at_least"):
            for of, bound in getattr(self, name).items():
                number = isinstance(bound, int | float) and bound == bound
                checks.require(number, f"{name}.{of}", f"must be a number, not {bound}")
        for of in self.correct:
            message = f"is compared with nothing; {nearest(of, compared)}"
            checks.require(of in compared, f"correct.{of}", message)
        checks.done()

    @property
    def compared(self) -> list[str]:
        """What it says something of."""
        return [*self.published, *self.at_most, *self.at_least]
