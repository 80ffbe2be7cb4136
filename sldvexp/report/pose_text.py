"""The pose as text, in the layout of Figure 4.29."""

from __future__ import annotations

import numpy as np
import xarray as xr


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
            f"SSE {float(view['sse']):.5f}, s^2 {s_deg**2:.4e}, s (deg) {s_deg:.4f}, "
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
            known = f"+- {bound:.3f}" if np.isfinite(bound) else "(no bound)"
            lines.append(f"  {prefix + str(label):5} = {value:6.3f} {known}")
    if "intrinsic" in view:
        for label in view["adjusted"].values:
            value = float(view["intrinsic"].sel(adjusted=label))
            bound = float(view["intrinsic_confidence"].sel(adjusted=label))
            lines.append(f"  {label} = {value:.5f} +- {bound:.5f}")
    return "\n".join(lines) + "\n"
