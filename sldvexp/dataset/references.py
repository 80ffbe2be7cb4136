"""Images of one structure with several places of excitation.

Those of the first are the groups ``image/<view>``, of which fields are made; those of the others
are ``reference/<name>/<view>``, of the same pixels and lines.
"""

from __future__ import annotations

from collections.abc import Mapping

from sldvexp.lazy import xarray as xr

#: Names of the groups of further references begin so, as ``reference/2+Z/front``.
FURTHER = "reference/"
#: Attribute of the images of the first reference: its name; and the name where it has none.
REFERENCE, FIRST = "reference_dof", "first"


def further_references(groups: Mapping[str, xr.Dataset]) -> dict[str, dict[str, xr.Dataset]]:
    """Sort the images of further references by the reference and the view.

    Examples
    --------
    >>> from sldvexp.lazy import xarray as xr
    >>> further_references({"image/a": xr.Dataset(), "reference/2+Z/a": xr.Dataset()}).keys()
    dict_keys(['2+Z'])
    """
    found: dict[str, dict[str, xr.Dataset]] = {}
    for name, group in groups.items():
        if name.startswith(FURTHER):
            reference, view = name.removeprefix(FURTHER).split("/")
            found.setdefault(reference, {})[view] = group
    return found
