"""Velocity fields for the terminal: Tables 5.7 and 5.8, and what the checks of a field found."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import xarray as xr
from rich.markup import escape
from rich.table import Table

from sldvexp.report.numbers import number


def field_tables(tree: Mapping[str, xr.Dataset]) -> Iterator[Table]:
    """One table of all methods, one of the components by frequency, one of the checks.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
    """
    fields = {
        name.removeprefix("compare/"): group
        for name, group in tree.items()
        if name == "field" or (name.startswith("compare/") and "element" in group.coords)
    }
    if not fields:
        return
    yield _methods(fields)
    yield _components(fields)
    if "examined/truth" in tree:
        yield truth_table(tree["examined/truth"])


def _methods(fields: Mapping[str, xr.Dataset]) -> Table:
    """Size, residuals and condition of every method's system."""
    names = ("unknowns", "rows", "residual std", "SSE", "cond", "bounds")
    table = Table("field", *names, title="Fields (as Table 5.7)", title_justify="left")
    for name, field in fields.items():
        a = field.attrs
        std = f"{number(1000 * a['residual_std'], 3)} mm/s"
        cells = [name, str(a["dof"]), str(a["samples"]), std, number(a["sse"], 4)]
        cells += [number(a["cond"], 4), f"{a['confidence_level']:.0%}"]
        table.add_row(*map(escape, cells))
    return table


def _components(fields: Mapping[str, xr.Dataset]) -> Table:
    """Size of every component with its bounds, at each frequency."""
    columns = ("component", "Hz", "largest", "r.m.s.", "std: noise", "poses", "bound", "elements")
    table = Table("field", *columns, title="Velocity, mm/s", title_justify="left")
    for name, field in fields.items():
        for component in field["component"].values:
            for i, hertz in enumerate(_frequencies(field)):
                one = field.sel(component=component)
                one = one.isel(frequency=i) if "frequency" in field.dims else one
                size = np.abs(one["velocity"].values)
                cells = [name, str(component), "" if np.isnan(hertz) else f"{hertz:g}"]
                cells += [_mm(np.nanmax(size)), _mm(_rms(size))]
                bounds = ("velocity_std_noise", "velocity_std_pose", "confidence")
                cells += [_mm(_rms(one[b].values)) if b in one else "" for b in bounds]
                cells.append(_mm(_rms(np.abs(one["element_error"].values))))
                table.add_row(*map(escape, cells))
    return table


def truth_table(truth: xr.Dataset) -> Table:
    """The field against the virtual lab's truth."""
    columns = ("component", "Hz", "relative error", "r.m.s. error, mm/s", "bound, mm/s", "covered")
    table = Table(*columns, title="On the true surface", title_justify="left")
    for component in truth["component"].values:
        for i, hertz in enumerate(_frequencies(truth)):
            one = truth.sel(component=component)
            one = one.isel(frequency=i) if "frequency" in truth.dims else one
            cells = [str(component), "" if np.isnan(hertz) else f"{hertz:g}"]
            cells += [f"{float(one['relative_error']):.2%}", _mm(float(one["rms_error"]))]
            cells += [_mm(float(one["rms_bound"])), f"{float(one['covered']):.0%}"]
            table.add_row(*map(escape, cells))
    return table


def _frequencies(group: xr.Dataset) -> np.ndarray:
    """The first frequencies of a group, or NaN if it has none."""
    some = 4
    return group["frequency"].values[:some] if "frequency" in group.coords else np.array([np.nan])


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))


def _mm(value: float) -> str:
    return number(1000 * value, 3)
