"""Published numbers and demanded bounds against the numbers of a run."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from sldvexp import dataset
from sldvexp.config.schema import Expectation
from sldvexp.dataset import findings_of, verdict_of
from sldvexp.errors import ConfigError, Problem, UserError, nearest
from sldvexp.lazy import xarray as xr

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
    expect: Mapping[str, Expectation], tree: Mapping[str, xr.Dataset], repaired: bool = False
) -> xr.Dataset | None:
    """Compare a run with everything that its configuration expects.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        Group path to dataset.
    repaired : bool
        A mistake of the data was repaired, so that nothing is compared that expects it.

    Returns
    -------
    xarray.Dataset or None
        The group ``check``, one row a number; None if nothing is expected. Its attribute ``notes``
        says what was not compared.

    Raises
    ------
    UserError
        If an expectation names something that the run does not have, or of another shape.

    Examples
    --------
    >>> pose = dataset.group("pose", {"view": ["front"]}, origin=[[0.1, 0.2, 1.7]])
    >>> near = Expectation(published={"pose/origin[axis=z]": 1.71}, tolerance=0.02)
    >>> evaluate({"distance": near}, {"pose": pose})["passed"].values
    array([1], dtype=int8)
    """
    rows: list[Row] = []
    skipped = [name for name, e in expect.items() if repaired and e.unrepaired]
    for name, expectation in expect.items():
        if name in skipped:
            continue
        try:
            rows += _compare(name, expectation, tree)
            rows += _found(name, expectation, tree)
        except UserError as error:
            raise ConfigError([Problem(f"expect.{name}", str(error))]) from None
    if not rows:
        return None
    columns: dict[str, Any] = {f: np.array([getattr(r, f) for r in rows]) for f in Row._fields}
    numbers = ("published", "computed", "correct")
    if not any(np.iscomplex(columns[n]).any() for n in numbers):
        columns |= {n: columns[n].real for n in numbers}
    group = dataset.group("check", {"quantity": columns.pop("quantity")}, **columns)
    if skipped:
        told = "not compared, as it is of the session before use_repair"
        group.attrs["notes"] = f"expected {' and '.join(skipped)}: {told}"
    return group


def lookup(of: str, tree: Mapping[str, xr.Dataset]) -> tuple[list[str], np.ndarray]:
    """Find the labels and numbers that an expression like ``pose/origin[axis=x]`` stands for.

    Between bars, ``|image/front/velocity|``, it stands for their magnitudes. Dimensions of length
    one are dropped.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> pose = group("pose", {"view": ["front"]}, origin=[[0.1, 0.2, 1.7]])
    >>> lookup("pose/origin[axis=z]", {"pose": pose})
    ([''], array(1.7))
    """
    if size := re.fullmatch(r"\s*\|(.*)\|\s*", of):
        labels, numbers = lookup(size[1], tree)
        return labels, np.abs(numbers)
    match = _OF.fullmatch(of.strip())
    if match is None:
        raise UserError(f"{of!r} is not of the form group/variable[dim=label] or group@attribute")
    if match["group"] not in tree:
        raise UserError(
            f"{of}: the run has no group {match['group']}; {nearest(match['group'], tree)}"
        )
    group = tree[match["group"]]
    if match["attribute"]:
        if match["attribute"] not in group.attrs:
            valid = nearest(match["attribute"], map(str, group.attrs))
            raise UserError(
                f"{of}: {match['group']} has no attribute {match['attribute']}; {valid}"
            )
        values = xr.DataArray(group.attrs[match["attribute"]])
    elif match["variable"] not in group:
        valid = nearest(match["variable"], map(str, group.data_vars))
        raise UserError(f"{of}: {match['group']} has no variable {match['variable']}; {valid}")
    else:
        values = group[match["variable"]]
    if values.dtype.kind not in "biufc":
        raise UserError(f"{of}: is text, not a number")
    values = _select(values, match["at"] or "", of).squeeze(drop=True)
    return list(_labels(values)), np.asarray(values)


def _select(values: xr.DataArray, at: str, of: str) -> xr.DataArray:
    """Apply ``dim=label, dim=label`` to an array; labels are compared as text."""
    for part in filter(None, at.split(",")):
        dim, _, label = (p.strip() for p in part.partition("="))
        if dim not in values.dims:
            raise UserError(
                f"{of}: there is no dimension {dim}; {nearest(dim, map(str, values.dims))}"
            )
        labels = [str(v) for v in values[dim].values]
        if label not in labels:
            raise UserError(f"{of}: {dim} has no label {label}; {nearest(label, labels)}")
        values = values.isel({dim: labels.index(label)})
    return values


def _labels(values: xr.DataArray) -> Iterator[str]:
    """Label each element, in the order of the flattened array."""
    for index in np.ndindex(values.shape):
        parts = [str(values[d].values[i]) for d, i in zip(values.dims, index, strict=True)]
        yield f"[{', '.join(parts)}]" if parts else ""


def _compare(name: str, expectation: Expectation, tree: Mapping[str, xr.Dataset]) -> Iterator[Row]:
    """Make the rows of one expectation."""
    demands = (
        ("=", expectation.published),
        ("<=", expectation.at_most),
        (">=", expectation.at_least),
    )
    for relation, values in demands:
        for of, value in values.items():
            labels, computed = lookup(of, tree)
            if relation == "=":
                published = _numbers(value, of)
                _require_shape(of, "published has", published, computed)
            elif np.iscomplexobj(computed):
                raise UserError(f"{of}: is complex, and has no bound; |{of}| has one")
            else:
                published = np.asarray(value)
            correct = np.array(np.nan)
            if of in expectation.correct:
                correct = lookup(expectation.correct[of], tree)[1]
                _require_shape(of, f"{expectation.correct[of]} has", correct, computed)
            columns = np.broadcast_arrays(published, computed, correct)
            for label, wanted, got, right in zip(labels, *(c.flat for c in columns), strict=True):
                passed = _passes(got, relation, wanted, expectation.tolerance)
                numbers = (f"{name}: {of}{label}", wanted, got, right, expectation.tolerance)
                yield Row(*numbers, relation, passed, expectation.source)


def _found(name: str, expectation: Expectation, tree: Mapping[str, xr.Dataset]) -> Iterator[Row]:
    """Make the rows of what the verdict must be and must have found."""
    findings = findings_of(tree)
    demanded = {text: text for text in expectation.finds}
    of_findings = {f"{f.kind} of {f.subject}" for f in findings}
    if expectation.verdict:
        demanded["verdict"] = f"verdict {expectation.verdict}"
        of_findings.add(f"verdict {verdict_of(findings)}")
    for text in demanded.values():
        met = text in of_findings
        yield Row(f"{name}: {text}", 1.0, float(met), np.nan, 0.0, "=", met, expectation.source)


def _require_shape(of: str, what: str, given: np.ndarray, computed: np.ndarray) -> None:
    """Refuse numbers that cannot stand beside those of the run."""
    if given.shape != computed.shape:
        sizes = [" x ".join(map(str, a.shape)) or "1" for a in (given, computed)]
        plural = "" if sizes[0] == "1" else "s"
        raise UserError(f"{of}: {what} {sizes[0]} number{plural}, but the run has {sizes[1]}")


def _passes(got: complex, relation: str, wanted: complex, tolerance: float) -> bool:
    """Tell whether a number stands to the published one as demanded; NaN never does."""
    if relation == "=":
        parts = (got.real - wanted.real, got.imag - wanted.imag)
        return all(abs(p) <= tolerance * (1 + 1e-12) for p in parts)
    difference = got.real - wanted.real
    return bool(difference <= tolerance if relation == "<=" else difference >= -tolerance)


def _numbers(value: Any, of: str) -> np.ndarray:
    """Read published numbers, complex ones written as text, as an array."""
    if isinstance(value, list | tuple):
        rows = [_numbers(v, of) for v in value]
        if len({row.shape for row in rows}) > 1:
            raise UserError(f"{of}: published must have equally long rows")
        return np.array(rows)
    try:
        number = complex(str(value).replace(" ", "").replace("i", "j"))
    except ValueError:
        number = complex("nan")
    if np.isnan(number):
        raise UserError(f"{of}: published must be numbers, not {value!r}")
    return np.asarray(number)
