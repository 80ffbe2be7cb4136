"""Setting for values that not all views have: refuse, leave points out, or keep them marked."""

from __future__ import annotations

from enum import Enum

from sldvexp.errors import Checks


class Incomplete(Enum):
    """Treatment of points that a view has not measured.

    Attributes
    ----------
    refuse
        The import ends; the setting is `false`.
    drop
        They are left out of all views, and counted; `true` is the same.
    mark
        They stay, as NaN with a flag where a view lacks them, and are determined from the other
        views if these are three or more.
    """

    refuse = "false"
    drop = "drop"
    mark = "mark"

    @property
    def done(self) -> str:
        """Words of a finding for what became of the points."""
        return "left out" if self is Incomplete.drop else "kept with the views that are there"


#: The setting's values and their meaning.
VALUES = {one.value: one for one in Incomplete} | {"true": Incomplete.drop}
#: Ways on for somebody whose points were refused.
REMEDY = (
    "leave such points out with instrument.incomplete=drop, or keep them marked with "
    "instrument.incomplete=mark"
)


def check_incomplete(checks: Checks, value: bool | str) -> None:
    """Note a value of the setting that there is not."""
    message = f"must be false, drop or mark, not {value}"
    checks.require(str(value).lower() in VALUES, "incomplete", message)


def incomplete_by(value: bool | str) -> Incomplete:
    """Find the meaning of the setting's value.

    Examples
    --------
    >>> incomplete_by(True), incomplete_by("mark")
    (<Incomplete.drop: 'drop'>, <Incomplete.mark: 'mark'>)
    """
    return VALUES[str(value).lower()]


def then(value: bool | str) -> str:
    """Say what an answer needs besides that makes points ones that were not measured."""
    refused = incomplete_by(value) is Incomplete.refuse
    return " with instrument.incomplete=drop or mark" if refused else ""
