"""What a figure cannot do without, said in one sentence."""

from __future__ import annotations

from sldvexp.errors import UserError


def require(figure: str, missing: str) -> None:
    """Refuse a figure whose data is missing.

    Parameters
    ----------
    figure : str
    missing : str
        What is missing; empty if nothing is.

    Raises
    ------
    UserError
        If anything is missing.
    """
    if missing:
        raise UserError(f"plot: {figure}: {missing}")
