"""Wishes of a browser, which may say anything."""

from __future__ import annotations

from typing import Any

from sldvexp.errors import UserError
from sldvexp.instrument.person import Steps

Wish = dict[str, Any]

#: Steps that no board has.
BEYOND = 2**20


def pair_of(value: object) -> Steps:
    """Read two whole numbers of a wish."""
    if not (isinstance(value, list) and len(value) == 2 and all(type(v) is int for v in value)):
        raise UserError("a place is two whole numbers, up-down and left-right")
    up_down, left_right = (min(max(v, -BEYOND), BEYOND) for v in value)
    return up_down, left_right


def text_of(wish: Wish, key: str) -> str:
    """Read a text of a wish, empty if it is none."""
    value = wish.get(key)
    return value if isinstance(value, str) else ""
