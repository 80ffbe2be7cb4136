"""What the stages of a run noted, with the result that it is about where there are several."""

from __future__ import annotations

from collections.abc import Mapping

from sldvexp.lazy import xarray as xr


def notes(tree: Mapping[str, xr.Dataset]) -> list[str]:
    """Every note once; one that is not of all results of a run names those that it is of.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
    """
    results = [n for n in tree if n in ("point", "field") or n.startswith("compare/")]
    found: dict[str, list[str]] = {}
    for name, group in tree.items():
        for note in filter(None, str(group.attrs.get("notes", "")).splitlines()):
            found.setdefault(note, []).append(name)
    told = []
    for note, of in found.items():
        named = set(of) <= set(results) and len(of) < len(results)
        which = ", ".join(name.removeprefix("compare/") for name in of)
        told.append(f"{which}: {note}" if named else note)
    return told
