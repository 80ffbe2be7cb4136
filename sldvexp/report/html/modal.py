"""Modes and a finite element model put to the test: a section each, near the top of a page.

Measured and computed shapes stand beside each other at the pixels of one view, along the lines of
sight: that is what is compared, and it needs no field and no model that fits.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from sldvexp.dataset import RunData, group
from sldvexp.lazy import xarray as xr
from sldvexp.report.html.blocks import Beside, HtmlTable, Listing, Section, Shape, Text, having
from sldvexp.report.html.figures import figures
from sldvexp.report.html.shape import shape_of_points
from sldvexp.report.modal_tables import (
    criteria_table,
    level_factor,
    mode_table,
    model_sentences,
    model_table,
    verdict_on_model,
)
from sldvexp.report.numbers import number, with_bound
from sldvexp.typing import Array, ComplexArray

#: Component of a velocity along the line of sight.
BEAM = "beam"


def modes_section(run: RunData) -> Section | None:
    """Show the modes with bounds and the stabilisation diagram."""
    if not run.has("modes", "natural_frequency", "damping_ratio"):
        return None
    note = (
        "Complexity is 0 where all pixels move in phase. The phase is that at resonance against "
        "the reference. The bound of the shape's scale is common to all of a mode, and is in the "
        "bounds of its shape and strains."
    )
    table = HtmlTable.from_table(mode_table(run.groups["modes"]))
    return Section("Modes", having(table, Text(note, "small"), figures(run, "modes")))


def model_section(run: RunData) -> Section | None:
    """Show the verdict on the model, every mode beside its own, and what cannot be told."""
    if not run.has("model", "pair"):
        return None
    model = run.groups["model"]
    verdict = verdict_on_model(model)
    tone = "good" if verdict.startswith("accepted") else "warning"
    note = (
        "MAC and the tests of shapes are over all pixels, weighted by their noise; beside the MAC "
        "stands what a right model has, with its standard deviation. The directed test looks for "
        "other modes of the model in the measured one."
    )
    return Section(
        "Model",
        having(
            Text(f"The model is {verdict}.", tone),
            HtmlTable.from_table(model_table(model)),
            Text(note, "small"),
            *_criteria(run),
            _adjusted(model),
            Listing(model_sentences(run)),
            _shapes_beside(run),
            figures(run, "model"),
        ),
    )


def _criteria(run: RunData) -> list[HtmlTable | Text]:
    """Show CoMAC, FRAC and CSAC, and how they are read."""
    table = criteria_table(run)
    if table is None:
        return []
    told = (
        "Beside each criterion stands what noise alone leaves of it: where little moves that is "
        "low of a right model too. The worst is the farthest below it, in standard deviations. "
        "Wrong frequencies lower FRAC and CSAC around the resonances, and motion of other modes "
        "between."
    )
    return [HtmlTable.from_table(table), Text(told, "small")]


def _adjusted(model: xr.Dataset) -> HtmlTable | None:
    """Make a row for each parameter that was adjusted."""
    if "factor" not in model:
        return None
    rows = [
        [
            str(name),
            number(float(one["adjusted_value"]), _digits(float(one["factor_std"]))),
            with_bound(100 * float(one["factor"] - 1), 100 * float(one["factor_std"])),
        ]
        for name in model["adjusted"].values
        for one in [model.sel(adjusted=name, adjusted2=name)]
    ]
    columns = ["parameter", "value that fits", "change ± standard error, %"]
    return HtmlTable(columns, rows, "Parameters adjusted to the frequencies")


def _digits(share: float) -> int:
    """Count the digits of a value that is known to a share of itself, two of them uncertain."""
    known = math.isfinite(share) and 0 < share < 1
    return min(6, 2 - math.floor(math.log10(share))) if known else 6


def _shapes_beside(run: RunData) -> list[Beside | Text]:
    """Show measured and computed shapes at the pixels of the view that sees most of the model."""
    views = run.below("model/image", "velocity", "residual", "position")
    known = {name: one for name, one in views.items() if run.has(f"modes/image/{name}", "velocity")}
    if not known:
        return []
    view = max(known, key=lambda name: known[name].sizes["pixel"])
    of, modes, model = known[view], run.groups["modes"], run.groups["model"]
    number = model["mode"].values[model["pair"].values > 0]
    own = np.searchsorted(modes["mode"].values, number)
    hertz = modes["natural_frequency"].values[own]
    computed, left = (of[name].transpose("pixel", ...).values for name in ("velocity", "residual"))
    std = run.groups[f"modes/image/{view}"]["velocity_std"].transpose("pixel", "frequency").values
    bound = level_factor(modes) * std[of["pixel"].values][:, own]
    columns = []
    for name, velocity, width in (
        ("modes-measured", computed + left, bound),
        ("modes-computed", computed, np.full(bound.shape, np.nan)),
    ):
        data = _shape_at_pixels(of, velocity, width, hertz) if hertz.size else None
        if data is None:
            return []
        data |= {"numbers": number.tolist(), "partners": list(range(len(hertz))), "dots": False}
        columns.append([Shape(data, name)])
    told = (
        f"Pixels of the view {view} that see the model, {of.sizes['pixel']} of them; velocities "
        "along the line of sight, drawn as heights. Computed ones are the paired mode times the "
        "factor that fits, and follow what is chosen of the measured ones."
    )
    return [Beside(["Measured", "Computed"], columns), Text(told, "small")]


def _shape_at_pixels(
    of: xr.Dataset, velocity: ComplexArray, bound: Array, hertz: Array
) -> dict[str, Any] | None:
    """Prepare velocities of pixels along their lines of sight for the page's script."""
    pixel = [str(pixel) for pixel in of["pixel"].values]
    seen = group(
        "point",
        {"point": pixel, "component": [BEAM], "frequency": hertz},
        velocity=velocity[:, None],
        confidence=bound[:, None],
    )
    place = group("line_of_sight", {"point": pixel}, position=of["position"].values)
    return shape_of_points(seen, place)
