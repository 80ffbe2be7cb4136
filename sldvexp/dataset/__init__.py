"""A run's groups, variables, dimensions and units, and how they are stored."""

from sldvexp.dataset.store import (
    AXES,
    CONVENTIONS,
    UNREADABLE,
    VARIABLES,
    group,
    load,
    load_some,
    save,
    save_table,
)

__all__ = [
    "AXES",
    "CONVENTIONS",
    "UNREADABLE",
    "VARIABLES",
    "group",
    "load",
    "load_some",
    "save",
    "save_table",
]
