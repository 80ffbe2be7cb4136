"""Velocity fields for the terminal: Tables 5.7 and 5.8, and what the checks of a field found.

Velocity images as text: one paragraph for all views.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from rich.markup import escape
from rich.table import Table

from sldvexp.lazy import xarray as xr
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
        yield truth_table(tree["examined/truth"], strongest(next(iter(fields.values()))))


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
    """Size of every component with its bounds, at the strongest frequencies."""
    columns = ("component", "Hz", "largest", "r.m.s.", "std: noise", "poses", "bound", "elements")
    title = f"Velocity, mm/s{_some(fields.values())}"
    table = Table("field", *columns, title=title, title_justify="left")
    for name, field in fields.items():
        for component in field["component"].values:
            for hertz in strongest(field):
                one = _at(field.sel(component=component), hertz)
                size = np.abs(one["velocity"].values)
                cells = [name, str(component), "" if np.isnan(hertz) else f"{hertz:g}"]
                cells += [_mm(np.nanmax(size)), _mm(_rms(size))]
                bounds = ("velocity_std_noise", "velocity_std_pose", "confidence")
                cells += [_mm(_rms(one[b].values)) if b in one else "" for b in bounds]
                cells.append(_mm(_rms(np.abs(one["element_error"].values))))
                table.add_row(*map(escape, cells))
    return table


def truth_table(truth: xr.Dataset, frequencies: Sequence[float]) -> Table:
    """The field against the virtual lab's truth at some frequencies."""
    columns = ("component", "Hz", "relative error", "r.m.s. error, mm/s", "bound, mm/s", "covered")
    title = f"On the true surface{_some([truth])}"
    table = Table(*columns, title=title, title_justify="left")
    for component in truth["component"].values:
        for hertz in frequencies:
            one = _at(truth.sel(component=component), hertz)
            cells = [str(component), "" if np.isnan(hertz) else f"{hertz:g}"]
            cells += [f"{float(one['relative_error']):.2%}", _mm(float(one["rms_error"]))]
            cells += [_mm(float(one["rms_bound"])), f"{float(one['covered']):.0%}"]
            table.add_row(*map(escape, cells))
    return table


def strongest(field: xr.Dataset) -> list[float]:
    """The frequencies of the largest velocities in their order, or NaN if there are none."""
    if "frequency" not in field.coords:
        return [np.nan]
    hertz = np.atleast_1d(field["frequency"].values)
    others = [d for d in field["velocity"].dims if d != "frequency"]
    size = np.atleast_1d((abs(field["velocity"]) ** 2).sum(others).values)
    return [float(hertz[i]) for i in np.sort(np.argsort(-size, kind="stable")[:MOST_FREQUENCIES])]


def _at(group: xr.Dataset, hertz: float) -> xr.Dataset:
    """A group at one of its frequencies, if it has any."""
    return group.sel(frequency=hertz) if "frequency" in group.dims else group


def _some(groups: Iterable[xr.Dataset]) -> str:
    """That a table does not tell of all frequencies, if so."""
    count = max(g.sizes.get("frequency", 1) for g in groups)
    few = count > MOST_FREQUENCIES
    return f", the {MOST_FREQUENCIES} strongest of {count} frequencies" if few else ""


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(np.square(values))))


def _mm(value: float) -> str:
    return number(1000 * value, 3)


#: Frequencies that a line tells of, those of the largest amplitudes.
MOST_FREQUENCIES = 4


def image_text(tree: Mapping[str, xr.Dataset]) -> str:
    """What the images of a run hold, a line for each view; empty if there are none.

    Parameters
    ----------
    tree : mapping of str to xarray.Dataset
        Groups ``image/<view>``.

    Returns
    -------
    str
        Pixels, flagged ones by kind, and for the strongest frequencies the largest amplitude and
        the median standard error.
    """
    images = {k.removeprefix("image/"): g for k, g in tree.items() if k.startswith("image/")}
    return "\n".join(_view_text(view, image) for view, image in images.items())


def _view_text(view: str, image: xr.Dataset) -> str:
    """One view's line."""
    grid = " x ".join(map(str, np.atleast_1d(image.attrs.get("shape", []))))
    name = f"Image of the view {view}" + (f" ({grid})" if grid else "")
    good = image.isel(pixel=image["flags"].values == 0)
    largest = abs(good["velocity"]).max("pixel").values
    hertz = image["frequency"].values
    shown = np.sort(np.argsort(-largest, kind="stable")[:MOST_FREQUENCIES])
    found = "; ".join(
        f"{hertz[i]:g} Hz: at most {1000 * largest[i]:.4g} mm/s, "
        f"median std {1000 * _std(good, i):.2g} mm/s"
        for i in shown
    )
    rest = f"; {len(hertz) - len(shown)} more frequencies" if len(shown) < len(hertz) else ""
    return f"{name}: {image.attrs['summary']}; {found}{rest}"


def _std(image: xr.Dataset, frequency: int) -> float:
    """The median standard error at a frequency; pixels may have one for all."""
    at = image["velocity_std"].isel(frequency=frequency, missing_dims="ignore")
    return float(np.median(at.values))
