"""What is known of one variable of the dataset."""

from __future__ import annotations

from typing import NamedTuple


class Variable(NamedTuple):
    """Dimensions (an optional one in brackets), units and meaning of one variable."""

    dims: str
    units: str
    long_name: str
