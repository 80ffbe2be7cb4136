"""Modes and a finite element model put to the test: a section each, near the top of a page."""

from __future__ import annotations

from sldvexp.dataset import RunData
from sldvexp.lazy import xarray as xr
from sldvexp.report.html.blocks import HtmlTable, Listing, Section, Text, having
from sldvexp.report.html.figures import figures
from sldvexp.report.modal_tables import (
    mode_table,
    model_sentences,
    model_table,
    verdict_on_model,
)
from sldvexp.report.numbers import number

#: Column of the model's table whose cells may be broken into lines.
MIXED_WITH = 9


def modes_section(run: RunData) -> Section | None:
    """Show the modes with bounds and the stabilisation diagram."""
    if not run.has("modes", "natural_frequency", "damping_ratio"):
        return None
    note = (
        "Complexity is 0 where all pixels move in phase. The phase is that at resonance against "
        "the reference. The bound of the shape's scale is common to all of a mode."
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
            HtmlTable.from_table(model_table(model), (MIXED_WITH,)),
            Text(note, "small"),
            _adjusted(model),
            Listing(model_sentences(run)),
            figures(run, "model"),
        ),
    )


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
