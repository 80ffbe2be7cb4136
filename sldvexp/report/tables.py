"""Poses, images and fields of a run as text for the terminal and the page.

Poses come in the layout of Figure 4.29 and Table 4.3, images in a line for each view, fields as in
Tables 5.7 and 5.8. Units of headings are those that `sldvexp.dataset.VARIABLES` shows.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
from rich.markup import escape
from rich.table import Table

from sldvexp import plot
from sldvexp.dataset import FREQUENCY, VARIABLES, RunData, is_void
from sldvexp.field.bounds.budget import SOURCES
from sldvexp.lazy import xarray as xr
from sldvexp.report.key_numbers import FACE, MIDDLE, on_face, on_surface, surface_name
from sldvexp.report.numbers import angle_text, bounds_of, number, place_text, shown, with_bound

POSE = VARIABLES["pose"]
VELOCITY = VARIABLES["field"]["velocity"]
#: Frequencies that a line tells of, those of the largest amplitudes.
MOST_FREQUENCIES = 4
#: Parts of the strain of the face.
PARTS = {"middle_strain": "the membrane", "bending_strain": "bending"}
#: Interval of a direction, deg to both sides, that tells nothing.
UNKNOWN = 45.0


def pose_text(pose: xr.Dataset) -> str:
    """Write every view's parameters with their bounds.

    Parameters
    ----------
    pose : xarray.Dataset
        The group ``pose``.

    Returns
    -------
    str
        For each view: source, SSE in deg^2, s^2 and s in degrees and DAC steps, then Euler angles
        (rad) and origin (m), each ``+-`` the half-width of its confidence interval.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> pose = group("pose", {"view": ["front"]}, euler=[[0.1, 2.9, 0.3]], origin=[[0, 0, 1.7]])
    >>> pose_text(pose).splitlines()[2]
    '  phi1 =  0.100 (no bound)'
    """
    return "\n".join(_pose_view_text(pose.sel(view=v), str(v)) for v in pose["view"].values)


def _pose_view_text(view: xr.Dataset, name: str) -> str:
    """Write one view's block."""
    lines = [f"View: {name}"]
    if source := view.attrs.get("source"):
        lines.append(f"Registration data file name: {source}")
    if "sse" in view:
        s_deg, steps = float(view["s_deg"]), float(view["s"])
        lines.append(
            f"SSE {_fixed(float(view['sse']), 5)}, s^2 {s_deg**2:.4e}, "
            f"s (deg) {_fixed(s_deg, 4)}, "
            f"s ({POSE['s'].shown_unit}) {steps:.4f}"
        )
    lines.append("Parameters - radians and meters")
    for variable, prefix in (("euler", ""), ("origin", "x0_")):
        index = "angle_index" if variable == "euler" else "axis"
        bounds = bounds_of(view, variable)
        for label in view[index].values:
            value, bound = (
                float(view[variable].sel({index: label})),
                float(bounds.sel({index: label})),
            )
            places = _places(bound)
            known = f"+- {bound:.{places}f}" if np.isfinite(bound) else "(no bound)"
            lines.append(f"  {prefix}{label} = {value:{places + 3}.{places}f} {known}")
    if "intrinsic" in view:
        for label in view["adjusted"].values:
            value = float(view["intrinsic"].sel(adjusted=label))
            bound = float(view["intrinsic_confidence"].sel(adjusted=label))
            lines.append(f"  {label} = {value:.5f} +- {bound:.5f}")
    return "\n".join(lines) + "\n"


def _places(bound: float) -> int:
    """Count decimals of a value: three as in Figure 4.29, more if its bound is known to more."""
    if not np.isfinite(bound) or bound <= 0:
        return 3
    return max(3, 1 - int(np.floor(np.log10(bound))))


def _fixed(value: float, places: int) -> str:
    """Write so many decimals, or powers of ten where these would show nothing."""
    return f"{value:.{places}f}" if value >= 10.0 ** (1 - places) or value == 0 else f"{value:.2e}"


def pose_methods(found: xr.Dataset) -> Table:
    """Make one row a method.

    Parameters
    ----------
    found : xarray.Dataset
        As ``check=pose_methods`` makes it.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> found = group("examined/pose_methods", {"pose_method": ["edge"]}, views=[2], s_mean=[0.2],
    ...               s_std=[0.01])
    >>> [column.header for column in pose_methods(found).columns]
    ['method', 'views', 's, DAC steps', 'std']
    """
    table = Table(title="Pose methods", title_justify="left")
    known = VARIABLES["examined/pose_methods"]
    columns = [n for n in ("s_mean", "s_std", "origin_error", "rotation_error") if n in found]
    titles = [known[n].label if n == "s_std" else known[n].titled() for n in columns]
    for title in ("method", "views", *titles):
        table.add_column(title)
    for method in found["pose_method"].values:
        row = found.sel(pose_method=method)
        cells = [number(known[name].factor * float(row[name]), 3) for name in columns]
        table.add_row(escape(str(method)), str(int(row["views"])), *cells)
    return table


def field_tables(run: RunData) -> Iterator[Table]:
    """Make a table of all methods, one of the components by frequency, one of the checks.

    Examples
    --------
    >>> list(field_tables(RunData({})))  # of a run without a field
    []
    """
    fields = run.fields()
    if not fields:
        return
    yield _methods(fields)
    surfaces = {name: on_surface(run, field) for name, field in fields.items()}
    of_middle = {n: f for n, f in fields.items() if surface_name(f) == MIDDLE}
    on_faces = {name: on_face(run, field) for name, field in of_middle.items()}
    if faces := {name: face for name, face in on_faces.items() if face is not None}:
        yield _components(faces, is_void(run.groups), FACE)
    yield _components(surfaces, is_void(run.groups))
    first = next(iter(surfaces.values()))
    if "variance" in first:
        yield budget_table(first)
    yield from strain_tables(run)
    for gages in run.below("examined", "confidence_by_part").values():
        yield gage_table(gages, strongest(first))
    for truth in run.below("examined", "rms_bound").values():
        yield truth_table(truth, strongest(first))


def _methods(fields: Mapping[str, xr.Dataset]) -> Table:
    """Show size, residuals and condition of every method's system."""
    names = ("unknowns", "rows", "residual std", "SSE", "cond", "bounds")
    table = Table("field", *names, title="Fits of the field to the images", title_justify="left")
    for name, field in fields.items():
        a = field.attrs
        std = f"{_mm(a['residual_std'])} {VELOCITY.shown_unit}"
        cells = [name, str(a["dof"]), str(a["samples"]), std, number(a["sse"], 4)]
        cells += [number(a["cond"], 4), f"{a['confidence_level']:.0%}"]
        table.add_row(*map(escape, cells))
    return table


def _components(fields: Mapping[str, xr.Dataset], void: bool, where: str = "") -> Table:
    """Show size of every component with its bounds, at the strongest frequencies.

    Parameters
    ----------
    where : str
        Surface that all are of; without it each is of the one that its volume is given by.
    """
    columns = (
        "component",
        FREQUENCY.units,
        "largest ± bound",
        "above bound",
        "r.m.s.",
        "uncertainty: noise",
        "poses",
        "bound",
        "elements",
        *["verdict"] * void,
    )
    surfaces = {where or surface_name(field) for field in fields.values()}
    several = len(surfaces) > 1
    where = "given surface" if several else surfaces.pop()
    title = f"{VELOCITY.titled(f'Velocity on the {where}')}{_some(fields.values())}"
    table = Table("field", *columns, title=title, title_justify="left")
    for name, field in fields.items():
        told = f"{name}, {surface_name(field).removesuffix(' surface')}" if several else name
        for component in field["component"].values:
            for hertz in strongest(field):
                one = _at(field.sel(component=component), hertz)
                size = np.abs(one["velocity"].values)
                cells = [told, str(component), "" if np.isnan(hertz) else f"{hertz:g}"]
                cells += [*_above(size, one.get("confidence")), _mm(_rms(size))]
                bounds = ("velocity_std_noise", "velocity_std_pose", "confidence")
                cells += [_two(_rms(one[b].values)) if b in one else "" for b in bounds]
                elements = one.get("element_error")
                cells.append("" if elements is None else _two(_rms(np.abs(elements.values))))
                table.add_row(*map(escape, cells), *["void"] * void)
    return table


def _above(size: np.ndarray, bound: xr.DataArray | None) -> list[str]:
    """Write the largest value with its bound, and at how many places values are above theirs."""
    if bound is None or not np.isfinite(size).any():
        return [_mm(np.nanmax(size)) if np.isfinite(size).any() else "-", ""]
    own = np.asarray(bound.values, float)
    above = np.nan_to_num(size) > np.nan_to_num(own)
    if not above.any():
        return ["not above its bound", "0%"]
    at = int(np.argmax(np.where(above, size, -1.0)))
    told = with_bound(*(VELOCITY.factor * float(v[at]) for v in (size, own)))
    return [told, f"{above.mean():.0%}"]


def budget_table(field: xr.Dataset) -> Table:
    """Show the uncertainty of every component by source, in the manner of the GUM.

    Standard uncertainties are root mean squares over nodes and frequencies; their squares, the
    variances, add up. Sources that nothing tells of are named.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> found = group("field", {"component": ["z"], "source": ["noise", "elements"]},
    ...               variance=[[[9e-10]], [[16e-10]]])
    >>> [list(column.cells) for column in budget_table(found).columns[1:]]
    [['0.03', '0.04', '0.05'], ['36%', '64%', '100%']]
    """
    components = [escape(str(c)) for c in field["component"].values]
    titles = [t for c in components for t in (f"{c}, {VELOCITY.shown_unit}", f"share of {c}")]
    title = f"Budget (standard uncertainty on the {surface_name(field)} by source, r.m.s.)"
    table = Table("source", *titles, title=title, title_justify="left")
    rest = [d for d in field["variance"].dims if d not in ("source", "component")]
    variance = field["variance"].mean(rest).transpose("source", "component").values
    total = variance.sum(axis=0)
    rows = [
        (SOURCES[str(name)], v) for name, v in zip(field["source"].values, variance, strict=True)
    ]
    for name, row in [*rows, ("together", total)]:
        cells = [(_two(np.sqrt(v)), _share(v, t)) for v, t in zip(row, total, strict=True)]
        table.add_row(name, *(cell for pair in cells for cell in pair))
    for name in filter(None, field.attrs.get("not_included", "").split("; ")):
        table.add_row(escape(name), *["not included", ""] * len(components))
    return table


def _share(variance: float, total: float) -> str:
    """Write a share of the variance."""
    return f"{variance / total:.0%}" if total > 0 else ""


def strain_tables(run: RunData) -> Iterator[Table]:
    """Make tables of the strain's components and of the hot spots, of every strain there is."""
    for name, strain in plot.strains_of(run).items():
        of = "" if name == "field" else f" by {escape(name)}"
        yield strain_table(strain, strongest(strain, "strain"), of)
        yield hot_spot_table(strain, strongest(strain, "strain"), of)


def strain_table(strain: xr.Dataset, frequencies: Sequence[float], of: str = "") -> Table:
    """Show strains of the face with their bounds at some frequencies, and those of their parts."""
    parts = {n: f"r.m.s. of {of}" for n, of in PARTS.items() if n in strain}
    names = ("strain", FREQUENCY.units, "largest", "r.m.s.", "bound", *parts.values())
    title = f"Strain of the face{of}, microstrain{_some([strain])}"
    if taken := thickness_taken(strain):
        title += f"; strain of bending is proportional to {taken}"
    table = Table(*names, title=title, title_justify="left")
    for component in strain["strain_component"].values:
        for hertz in frequencies:
            one = _at(strain.sel(strain_component=component), hertz)
            size = np.abs(one["strain"].values)
            cells = [f"e_{component}", "" if np.isnan(hertz) else f"{hertz:g}"]
            largest = np.nanmax(size) if np.isfinite(size).any() else np.nan
            sizes = (largest, _rms(size), _rms(one["confidence"].values))
            cells += [shown(1e6 * float(v)) for v in sizes]
            cells += [shown(1e6 * _rms(np.abs(one[name].values))) for name in parts]
            table.add_row(*map(escape, cells))
    return table


def thickness_taken(strain: xr.Dataset) -> str:
    """Say which thickness strains rest on if no bound knows how well it is known; else nothing.

    Examples
    --------
    >>> import xarray as xr
    >>> thickness_taken(xr.Dataset(attrs={"thickness": 0.003, "thickness_std": 0.0}))
    'the thickness, taken as 3 mm'
    """
    if strain.attrs.get("thickness_std", 1.0) or "thickness" not in strain.attrs:
        return ""
    return f"the thickness, taken as {1e3 * strain.attrs['thickness']:.4g} mm"


def hot_spot_table(strain: xr.Dataset, frequencies: Sequence[float], of: str = "") -> Table:
    """Show where the stress, or else the extension, is largest, with bounds; numbered as on maps.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> found = group("strain", {}, principal_strain=[[4e-6, 0], [1e-6, 0]],
    ...               principal_confidence=[[1e-7, 1e-7]] * 2, principal_direction=[30.0, 30.0],
    ...               principal_direction_std=[1.0, 1.0], position=[[0, 0, 0], [0.1, 0, 0]],
    ...               coordinate=[[0, 0], [0.1, 0]], triangle=[[0, 1, 1]])
    >>> [list(column.cells)[0] for column in hot_spot_table(found, [np.nan]).columns[2:]]
    ['0, 0, 0', '0, 0', '4.00 ± 0.10', '30.0 ± 2.0']
    """
    stress = "von_mises" in strain
    names = ("no.", FREQUENCY.units, "x, y, z, mm", "s, t, mm", *["von Mises, MPa"] * stress)
    columns = (*names, "largest extension, microstrain", "its direction from t1, deg")
    title = f"Hot spots of the face{of}{_some([strain])}"
    table = Table(*columns, title=title, title_justify="left")
    for hertz in frequencies:
        one = _at(strain, hertz)
        for spot, place in enumerate(plot.hottest_places(one), start=1):
            here = one.isel(place=place)
            cells = [str(spot), "" if np.isnan(hertz) else f"{hertz:g}"]
            places = (here[name].values for name in ("position", "coordinate"))
            cells += [place_text(1e3 * place) for place in places]
            if stress:
                pair = (float(here[n]) for n in ("von_mises", "von_mises_confidence"))
                cells.append(with_bound(*(1e-6 * v for v in pair)))
            pair = (float(here[n][0]) for n in ("principal_strain", "principal_confidence"))
            cells.append(with_bound(*(1e6 * v for v in pair)))
            cells.append(_direction(here))
            table.add_row(*map(escape, cells))
    return table


def _direction(place: xr.Dataset) -> str:
    """Write a direction with twice its standard error, if it is known at all."""
    std = float(place["principal_direction_std"])
    if 2 * std >= UNKNOWN:
        return "any"
    return angle_text(float(place["principal_direction"]), 2 * std)


def gage_table(gages: xr.Dataset, frequencies: Sequence[float]) -> Table:
    """Show strains of gages at some frequencies: predicted, measured and how they compare.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> found = group("examined/gages", {"gage": ["a"], "frequency": [50.0]}, strain=[[3e-6j]],
    ...               confidence_by_part=[[[2e-7]], [[1e-7]]])
    >>> [list(column.cells) for column in gage_table(found, [50.0]).columns]
    [['a'], ['50'], ['0+3j'], ['0.2, 0.1']]
    """
    measured = "measured" in gages
    names = ["predicted", "bound", *["measured", "difference", "bound", "p", "agrees"] * measured]
    title = f"Strain along gages, microstrain{_some([gages])}"
    table = Table("gage", FREQUENCY.units, *names, title=title, title_justify="left")
    for gage in gages["gage"].values:
        for hertz in frequencies:
            one = _at(gages.sel(gage=gage), hertz)
            cells = [str(gage), f"{hertz:g}"]
            cells += [_microstrain(one[n]) for n in ("strain", "confidence_by_part")]
            if measured and np.isfinite(one["measured"].item()):
                compared = ("measured", "difference", "difference_confidence")
                cells += [_microstrain(one[name]) for name in compared]
                cells += [f"{one['p_value'].item():.2g}", "yes" if one["agrees"] else "no"]
            elif measured:
                cells += ["missing", *[""] * 4]
            table.add_row(*map(escape, cells))
    return table


def _microstrain(values: xr.DataArray) -> str:
    """Write a strain, or what is of its real and imaginary part."""
    return ", ".join(f"{1e6 * v:.3g}" for v in np.atleast_1d(values.values))


def truth_table(truth: xr.Dataset, frequencies: Sequence[float]) -> Table:
    """Show the field, or its strains, against the virtual lab's truth at some frequencies."""
    strain = "strain_component" in truth.coords
    names = ("relative_error", "rms_error", "rms_bound", "covered")
    known = VARIABLES["examined/strain_truth" if strain else "examined/truth"]
    axis, factor = ("strain_component", 1e6) if strain else ("component", 1e3)
    of = truth.attrs.get("field", "field")
    on = (
        "On the true surface" if of == "field" else f"{escape(of.capitalize())} on the true surface"
    )
    what = "Strain of the true surface, microstrain" if strain else on
    columns = (axis.replace("_", " "), FREQUENCY.units, *(known[name].titled() for name in names))
    table = Table(*columns, title=f"{what}{_some([truth])}", title_justify="left")
    for component in truth[axis].values:
        for hertz in frequencies:
            one = _at(truth.sel({axis: component}), hertz)
            cells = [str(component), "" if np.isnan(hertz) else f"{hertz:g}"]
            cells.append(_relative(one))
            cells += [number(factor * float(one[n]), 3) for n in ("rms_error", "rms_bound")]
            cells.append(f"{float(one['covered']):.0%}")
            table.add_row(*map(escape, cells))
    return table


def _relative(truth: xr.Dataset) -> str:
    """Write the relative error, if there is anything to be relative to.

    A truth of the size of the bound was not measured: how far off it is, in shares of itself, says
    nothing.
    """
    relative, error, bound = (
        float(truth[name]) for name in ("relative_error", "rms_error", "rms_bound")
    )
    if relative > 0 and np.isfinite(bound) and error / relative <= bound:
        return "not above its bound"
    return f"{relative:.2%}"


def strongest(group: xr.Dataset, of: str = "velocity") -> list[float]:
    """Find the frequencies of the largest values in their order, or NaN if there are none."""
    if "frequency" not in group.coords:
        return [np.nan]
    hertz = np.atleast_1d(group["frequency"].values)
    others = [d for d in group[of].dims if d != "frequency"]
    size = np.atleast_1d((abs(group[of]) ** 2).sum(others).values)
    return [float(hertz[i]) for i in np.sort(np.argsort(-size, kind="stable")[:MOST_FREQUENCIES])]


def _at(group: xr.Dataset, hertz: float) -> xr.Dataset:
    """Take a group at one of its frequencies, if it has any."""
    return group.sel(frequency=hertz) if "frequency" in group.dims else group


def _some(groups: Iterable[xr.Dataset]) -> str:
    """Say that a table does not tell of all frequencies, if so."""
    count = max(g.sizes.get("frequency", 1) for g in groups)
    few = count > MOST_FREQUENCIES
    return f", the {MOST_FREQUENCIES} strongest of {count} frequencies" if few else ""


def _rms(values: np.ndarray) -> float:
    """Compute the root mean square of what is known; NaN of nothing."""
    known = values[~np.isnan(values)]
    return float(np.sqrt(np.mean(np.square(known)))) if known.size else np.nan


def _mm(value: float) -> str:
    return shown(VELOCITY.factor * value)


def _two(value: float) -> str:
    """Write an uncertainty with two digits."""
    return number(VELOCITY.factor * value, 2)


def image_text(run: RunData) -> str:
    """Say what the images of a run hold, a line for each view; empty if there are none.

    That is pixels, flagged ones by kind, and for the strongest frequencies the largest amplitude
    and the median standard error.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> image = group("image", {"frequency": [200.0]}, velocity=[[0.01], [0.02j]],
    ...               velocity_std=[[1e-4], [1e-4]], flags=[0, 0])
    >>> print(image_text(RunData({"image/front": image.assign_attrs(summary="all of use")})))
    Image of the view front: all of use; 200 Hz: at most 20 mm/s, median uncertainty 0.1 mm/s
    """
    return "\n".join(_image_view_text(v, image) for v, image in run.below("image").items())


def _image_view_text(view: str, image: xr.Dataset) -> str:
    """Write one view's line."""
    grid = " x ".join(map(str, np.atleast_1d(image.attrs.get("shape", []))))
    name = f"Image of the view {view}" + (f" ({grid})" if grid else "")
    good = image.isel(pixel=image["flags"].values == 0)
    size = np.abs(good["velocity"].transpose("pixel", "frequency").values)
    if not np.isfinite(size).any():
        return f"{name}: {image.attrs['summary']}; no pixel is good"
    largest = np.max(size, axis=0, where=np.isfinite(size), initial=0.0)
    hertz = image["frequency"].values
    chosen = np.sort(np.argsort(-largest, kind="stable")[:MOST_FREQUENCIES])
    factor, unit = VELOCITY.factor, VELOCITY.shown_unit
    found = "; ".join(
        f"{hertz[i]:g} {FREQUENCY.units}: at most {factor * largest[i]:.4g} {unit}, "
        f"median uncertainty {factor * _std(good, i):.2g} {unit}"
        for i in chosen
    )
    rest = f"; {len(hertz) - len(chosen)} more frequencies" if len(chosen) < len(hertz) else ""
    return f"{name}: {image.attrs['summary']}; {found}{rest}"


def _std(image: xr.Dataset, frequency: int) -> float:
    """Take the median standard error at a frequency; pixels may have one for all."""
    at = image["velocity_std"].isel(frequency=frequency, missing_dims="ignore")
    return float(np.median(at.values))
