"""Finite element model put to the test: its modes beside the measured ones, adjusted values."""

from __future__ import annotations

import numpy as np

from sldvexp.dataset import VARIABLES, RunData
from sldvexp.lazy import xarray as xr
from sldvexp.report.html.blocks import HtmlTable, Section, Text, having
from sldvexp.report.html.figures import figures
from sldvexp.report.numbers import number

MODEL = VARIABLES["model"]
NOTE = (
    "MAC is weighted by the pixels' noise; expected is what a right model would have under that "
    "noise and these poses. Chi-square over its degrees of freedom is 1 for a right shape. What "
    "was found about the model stands among the notes."
)


def model_section(run: RunData) -> Section | None:
    """Show the model's modes beside the measured ones, and the parameters that were adjusted."""
    model = run.groups.get("model")
    if model is None or "pair" not in model:
        return None
    told = f"Shapes: {model.attrs['shapes']}. Frequencies: {model.attrs['frequencies']}."
    blocks = having(Text(told), _pairs(model), _adjusted(model), Text(NOTE, "small"))
    return Section("Finite element model", having(blocks, figures(run, "model")))


def _pairs(model: xr.Dataset) -> HtmlTable:
    """Make a row for each measured mode and its partner."""
    rows = []
    for k, mode in enumerate(model["mode"].values):
        own, partner = model.isel(mode=k), int(model["pair"].values[k])
        row = [str(mode), number(float(own["measured_frequency"]), 6)]
        if not partner:
            rows.append([*row, *["none", "", "", "", "", "", ""]])
            continue
        computed = float(model["model_frequency"].values[partner - 1])
        ratio = float(own["chi2"]) / float(own["dof"])
        spread = f"{float(own['mac_expected']):.6f} ± {float(own['mac_std']):.1g}"
        rows.append(
            [
                *row,
                str(partner),
                number(computed, 6),
                number(100 * float(np.expm1(own["difference"])), 3),
                f"{float(own['mac_of_pair']):.6f}",
                spread,
                number(ratio, 3),
                number(min(float(own["p_value"]), float(own["directed_p_value"])), 2),
            ]
        )
    columns = ["mode", MODEL["measured_frequency"].titled("measured"), "model's mode"]
    columns += [MODEL["model_frequency"].titled("model"), "measured above it, %"]
    columns += ["MAC", "expected", "chi² / dof", "smaller p"]
    return HtmlTable(columns, rows, "Modes, measured and of the model")


def _adjusted(model: xr.Dataset) -> HtmlTable | None:
    """Make a row for each parameter that was adjusted."""
    if "factor" not in model:
        return None
    rows = [
        [
            str(name),
            number(float(one["adjusted_value"]), 6),
            number(100 * float(one["factor"] - 1), 3),
            number(100 * float(one["factor_std"]), 2),
        ]
        for name in model["adjusted"].values
        for one in [model.sel(adjusted=name, adjusted2=name)]
    ]
    columns = ["parameter", "value that fits", "change, %", "its standard error, %"]
    return HtmlTable(columns, rows, "Parameters adjusted to the frequencies")
