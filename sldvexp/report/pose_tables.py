"""The pose as text, in the layout of Figure 4.29.

The table of pose methods, in the manner of Table 4.3.
"""

from __future__ import annotations

import numpy as np
from rich.table import Table

from sldvexp.lazy import xarray as xr
from sldvexp.report.numbers import number


def pose_text(pose: xr.Dataset) -> str:
    """Every view's parameters with their bounds.

    Parameters
    ----------
    pose : xarray.Dataset
        The group ``pose``.

    Returns
    -------
    str
        For each view: source, SSE in deg^2, s^2 and s in degrees and DAC steps, then Euler angles
        (rad) and origin (m), each ``+-`` the half-width of its confidence interval.
    """
    return "\n".join(_view_text(pose.sel(view=v), str(v)) for v in pose["view"].values)


def _view_text(view: xr.Dataset, name: str) -> str:
    """One view's block."""
    lines = [f"View: {name}"]
    if source := view.attrs.get("source"):
        lines.append(f"Registration data file name: {source}")
    if "sse" in view:
        s_deg, steps = float(view["s_deg"]), float(view["s"])
        lines.append(
            f"SSE {_fixed(float(view['sse']), 5)}, s^2 {s_deg**2:.4e}, "
            f"s (deg) {_fixed(s_deg, 4)}, "
            f"s (DAC steps) {steps:.4f}"
        )
    lines.append("Parameters - radians and meters")
    for variable, prefix in (("euler", ""), ("origin", "x0_")):
        index = "angle_index" if variable == "euler" else "axis"
        bounds = view.get(f"{variable}_confidence", xr.full_like(view[variable], np.nan))
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
    """Decimals of a value: three as in Figure 4.29, more where its bound is known to more."""
    if not np.isfinite(bound) or bound <= 0:
        return 3
    return max(3, 1 - int(np.floor(np.log10(bound))))


def _fixed(value: float, places: int) -> str:
    """A number with so many decimals, or in powers of ten where these would show nothing."""
    return f"{value:.{places}f}" if value >= 10.0 ** (1 - places) or value == 0 else f"{value:.2e}"


def pose_methods(found: xr.Dataset) -> Table:
    """One row a method.

    Parameters
    ----------
    found : xarray.Dataset
        As ``check=pose_methods`` makes it.
    """
    table = Table(title="Pose methods", title_justify="left")
    errors = {"origin_error": ("origin off by, mm", 1e3), "rotation_error": ("axes by, mrad", 1e3)}
    errors = {name: of for name, of in errors.items() if name in found}
    titles = [title for title, _ in errors.values()]
    for column in ("method", "views", "s, DAC steps", "std", *titles):
        table.add_column(column)
    for method in found["pose_method"].values:
        row = found.sel(pose_method=method)
        cells = [number(float(row[name]), 3) for name in ("s_mean", "s_std")]
        cells += [number(scale * float(row[name]), 3) for name, (_, scale) in errors.items()]
        table.add_row(str(method), str(int(row["views"])), *cells)
    return table
