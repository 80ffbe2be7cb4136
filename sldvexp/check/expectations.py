"""Published numbers and demanded bounds against the numbers of a run."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from sldvexp import dataset
from sldvexp.errors import UserError, nearest

if TYPE_CHECKING:
    from sldvexp.config import Expectation

_OF = re.compile(
    r"(?P<group>[\w./-]+)(?:/(?P<variable>\w+)|@(?P<attribute>\w+))(?:\[(?P<at>[^]]*)\])?"
)


class Row(NamedTuple):
    """One compared number."""

    quantity: str
    published: complex
    computed: complex
    correct: complex
    tolerance: float
    relation: str
    passed: bool
    source: str


def evaluate(
    expect: Mapping[str, Expectation], tree: Mapping[str, xr.Dataset]
) -> xr.Dataset | None:
    """Compare a run with everything that its configuration expects.

    Parameters
    ----------
    expect : mapping of str to Expectation
    tree : mapping of str to xarray.Dataset
        Group path to dataset.

    Returns
    -------
    xarray.Dataset or None
        The group ``check``, one row a number; None if nothing is expected.

    Raises
    ------
    UserError
        If an expectation names something that the run does not have, or of another shape.
    """
    rows = [row for name, e in expect.items() for row in _compare(name, e, tree)]
    if not rows:
        return None
    columns: dict[str, Any] = {f: np.array([getattr(r, f) for r in rows]) for f in Row._fields}
    numbers = ("published", "computed", "correct")
    if not any(np.iscomplex(columns[n]).any() for n in numbers):
        columns |= {n: columns[n].real for n in numbers}
    return dataset.group("check", {"quantity": columns.pop("quantity")}, **columns)


def lookup(of: str, tree: Mapping[str, xr.Dataset], where: str) -> tuple[list[str], np.ndarray]:
    """The labels and numbers that an expression such as ``pose/origin[axis=x]`` stands for.

    Dimensions of length one are dropped. `where` names the expression in an error's sentence.
    """
    match = _OF.fullmatch(of.strip())
    if match is None:
        raise UserError(
            f"{where}: {of!r} is not of the form group/variable[dim=label] or group@attribute"
        )
    if match["group"] not in tree:
        raise UserError(f"{where}: the run has no group {match['group']}; {nearest(match['group'], tree)}")
    group = tree[match["group"]]
    if match["attribute"]:
        if match["attribute"] not in group.attrs:
            valid = nearest(match["attribute"], map(str, group.attrs))
            raise UserError(f"{where}: {match['group']} has no attribute {match['attribute']}; {valid}")
        values = xr.DataArray(group.attrs[match["attribute"]])
    elif match["variable"] not in group:
        valid = nearest(match["variable"], map(str, group.data_vars))
        raise UserError(f"{where}: {match['group']} has no variable {match['variable']}; {valid}")
    else:
        values = group[match["variable"]]
    values = _select(values, match["at"] or "", where).squeeze(drop=True)
    return list(_labels(values)), np.asarray(values)


def _select(values: xr.DataArray, at: str, where: str) -> xr.DataArray:
    """``dim=label, dim=label`` applied to an array; labels are compared as text."""
    for part in filter(None, at.split(",")):
        dim, _, label = (p.strip() for p in part.partition("="))
        if dim not in values.dims:
            raise UserError(
                f"{where}: there is no dimension {dim}; {nearest(dim, map(str, values.dims))}"
            )
        labels = [str(v) for v in values[dim].values]
        if label not in labels:
            raise UserError(f"{where}: {dim} has no label {label}; {nearest(label, labels)}")
        values = values.isel({dim: labels.index(label)})
    return values


def _labels(values: xr.DataArray) -> Iterator[str]:
    """A label for each element, in the order of the flattened array."""
    for index in np.ndindex(values.shape):
        parts = [str(values[d].values[i]) for d, i in zip(values.dims, index, strict=True)]
        yield f"[{', '.join(parts)}]" if parts else ""


def _compare(
    name: str, expectation: Expectation, tree: Mapping[str, xr.Dataset]
) -> Iterator[Row]:
    """The rows of one expectation."""
    demands = (
        ("=", expectation.published),
        ("<=", expectation.at_most),
        (">=", expectation.at_least),
    )
    for relation, values in demands:
        for of, value in values.items():
            where = f"expect.{name}: {of}"
            labels, computed = lookup(of, tree, where)
            published = _numbers(value, where)
            if relation == "=" and published.shape != computed.shape:
                raise UserError(
                    f"{where}: published has the shape {published.shape}, "
                    f"the run has {computed.shape}"
                )
            correct = np.array(np.nan)
            if of in expectation.correct:
                correct = lookup(expectation.correct[of], tree, where)[1]
            columns = np.broadcast_arrays(published, computed, correct)
            for label, wanted, got, right in zip(labels, *(c.flat for c in columns), strict=True):
                passed = _passes(got, relation, wanted, expectation.tolerance)
                numbers = (f"{name}: {of}{label}", wanted, got, right, expectation.tolerance)
                yield Row(*numbers, relation, passed, expectation.source)


def _passes(got: complex, relation: str, wanted: complex, tolerance: float) -> bool:
    """Whether a number stands to the published one as demanded; NaN never does."""
    if relation == "=":
        parts = (got.real - wanted.real, got.imag - wanted.imag)
        return all(abs(p) <= tolerance * (1 + 1e-12) for p in parts)
    difference = got.real - wanted.real
    return bool(difference <= tolerance if relation == "<=" else difference >= -tolerance)


def _numbers(value: Any, where: str) -> np.ndarray:
    """Published numbers, complex ones written as text, as an array."""
    if isinstance(value, list | tuple):
        return np.array([_numbers(v, where) for v in value])
    try:
        return np.asarray(complex(str(value).replace(" ", "").replace("i", "j")))
    except ValueError:
        raise UserError(f"{where}: published must be numbers, not {value!r}") from None
