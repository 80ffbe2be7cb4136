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
        They stay, as NaN with a flag.
    """

    refuse = "false"
    drop = "drop"
    mark = "mark"


#: The setting's values and their meaning.
VALUES = {"false": Incomplete.refuse, "true": Incomplete.drop}
VALUES |= {"drop": Incomplete.drop, "mark": Incomplete.mark}


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
