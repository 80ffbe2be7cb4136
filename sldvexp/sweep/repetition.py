"""How far two runs' datasets agree, quantity by quantity."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from sldvexp.lazy import xarray as xr

#: Largest difference that another order of operations makes, of a variable's largest entry.
ROUNDING = 1e-10


class AgreementLevel(StrEnum):
    """How far a quantity agrees."""

    identical = "bit-identical"
    rounding = "equal within rounding"
    different = "different"


@dataclass(frozen=True)
class Difference:
    """How far one quantity agrees.

    Parameters
    ----------
    name : str
        ``group/variable`` or ``group@attribute``.
    kind : AgreementLevel
    how : str
        The rest of the sentence about it.
    """

    name: str
    kind: AgreementLevel
    how: str = ""


def compare(before: xr.DataTree, after: xr.DataTree) -> list[Difference]:
    """Compare all quantities of two runs, the attributes of the root left out.

    Parameters
    ----------
    before, after : xarray.DataTree
        In memory, as `sldvexp.dataset.load` gives them.
    """
    first, second = dict(_quantities(before)), dict(_quantities(after))
    found = []
    for name in dict.fromkeys([*first, *second]):
        if name not in second:
            found.append(Difference(name, AgreementLevel.different, ": it is missing now"))
        elif name not in first:
            found.append(Difference(name, AgreementLevel.different, ": it is new"))
        else:
            found.append(Difference(name, *_agreement(first[name], second[name])))
    return found


def _quantities(tree: xr.DataTree) -> Iterator[tuple[str, NDArray]]:
    for node in tree.subtree:
        group = node.path.strip("/")
        if not group:
            continue
        own = node.to_dataset(inherit=False)
        yield from ((f"{group}/{name}", v.values) for name, v in own.variables.items())
        yield from ((f"{group}@{name}", np.asarray(v)) for name, v in own.attrs.items())


def _agreement(a: NDArray, b: NDArray) -> tuple[AgreementLevel, str]:
    if a.shape != b.shape:
        return AgreementLevel.different, f": its shape was {a.shape} and is {b.shape}"
    numbers = a.dtype.kind in "biufc" and b.dtype.kind in "biufc"
    if not numbers:
        same = a.tolist() == b.tolist()
        return (AgreementLevel.identical, "") if same else (AgreementLevel.different, "")
    if a.dtype == b.dtype and a.tobytes() == b.tobytes():
        return AgreementLevel.identical, ""
    unlike = np.isfinite(a) != np.isfinite(b)
    both = np.isfinite(a) & np.isfinite(b)
    difference = np.abs(np.subtract(b[both], a[both], dtype=np.result_type(a, b, float)))
    largest = np.abs(a[both]).max(initial=0.0)
    relative = difference.max(initial=0.0) / (largest or 1.0)
    how = f", by {relative:.2g} of its largest entry"
    if unlike.any():
        return (
            AgreementLevel.different,
            f"{how}; {unlike.sum()} entries are finite in one of them only",
        )
    return (AgreementLevel.rounding if relative <= ROUNDING else AgreementLevel.different), how
