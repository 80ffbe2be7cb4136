"""Modes and a finite element model put to the test, as sentences and tables with bounds.

Bounds are half-widths of intervals, Student's factor of the level times the standard error; those
of poles rest on thousands of degrees of freedom, so that the factor is that of a normal
distribution. A model is told by its verdict first: shapes and frequencies are judged apart, for
shapes never know what the frequencies do, and the other way round.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from rich.markup import escape
from rich.table import Table

from sldvexp.dataset import VARIABLES, RunData, findings_of
from sldvexp.lazy import xarray as xr
from sldvexp.report.numbers import bounds_of, number, with_bound
from sldvexp.statistics import student_factor
from sldvexp.typing import Array

NATURAL = VARIABLES["modes"]["natural_frequency"].shown_unit
PERCENT, PER_MILLE = 100.0, 1000.0
#: Columns of a mode's pole.
POLES = (f"natural frequency, {NATURAL}", "damping, %")
#: Modes that a line names at most.
MOST_MODES = 5
#: Standard errors of a share of another mode from which it is told.
SURE = 4.0
#: Verdicts on the two parts of a model as the line that closes a run says them.
JUDGED = {"accepted": "accepted", "rejected": "rejected", "undecided": "undecidable"}
#: Criteria that nothing is judged by, what each is over, and the group that has it.
CRITERIA = (
    ("comac", "CoMAC", "the modes of a pixel", "model/image"),
    ("frac", "FRAC", "the lines of a pixel", "model/image"),
    ("csac", "CSAC", "the pixels of a line", "model"),
)


def level_of(modes: xr.Dataset) -> float:
    """Tell the level of the bounds."""
    return float(modes.attrs.get("confidence_level", 0.95))


def level_factor(modes: xr.Dataset) -> float:
    """Return the factor of a standard error that makes its bound."""
    return float(student_factor(level_of(modes), np.inf))


def modes_told(run: RunData) -> str:
    """Say how many modes there are, and frequency and damping of the first; empty without any.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> modes = group("modes", {"mode": [1]}, natural_frequency=[197.0], damping_ratio=[0.01],
    ...               natural_frequency_std=[1e-3], damping_ratio_std=[5e-6])
    >>> modes_told(RunData({"modes": modes}))
    '1 mode: 197.0000 ± 0.0020 Hz, damping 1.00000 ± 0.00098 %'
    """
    if not run.has("modes", "natural_frequency", "damping_ratio"):
        return ""
    rows = poles(run.groups["modes"])
    told = [f"{hertz} {NATURAL}, damping {damping} %" for hertz, damping in rows[:MOST_MODES]]
    more = f"; {len(rows) - MOST_MODES} more" if len(rows) > MOST_MODES else ""
    count = f"{len(rows)} mode{'s' * (len(rows) != 1)}"
    return f"{count}: {'; '.join(told)}{more}" if rows else "no modes"


def poles(modes: xr.Dataset) -> list[tuple[str, str]]:
    """Write natural frequency in Hz and damping in percent of every mode, with bounds."""
    factor = level_factor(modes)
    hertz, damping = modes["natural_frequency"].values, modes["damping_ratio"].values
    bounds = (
        factor * modes[name].values if name in modes else np.full(len(hertz), np.nan)
        for name in ("natural_frequency_std", "damping_ratio_std")
    )
    return [
        (with_bound(f, f_bound), with_bound(PERCENT * zeta, PERCENT * zeta_bound))
        for f, zeta, f_bound, zeta_bound in zip(hertz, damping, *bounds, strict=True)
    ]


def verdict_on_model(model: xr.Dataset) -> str:
    """Say whether a model is accepted, rejected or undecidable, and by what.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> model = group("model", {}).assign_attrs(shapes="accepted", frequencies="undecided")
    >>> verdict_on_model(model)
    'undecidable (shapes accepted, frequencies undecidable)'
    """
    parts = {name: str(model.attrs.get(name, "undecided")) for name in ("shapes", "frequencies")}
    worst = next((v for v in ("rejected", "undecided") if v in parts.values()), "accepted")
    told = ", ".join(f"{name} {JUDGED[value]}" for name, value in parts.items())
    return f"{JUDGED[worst]} ({told})"


def model_told(run: RunData) -> str:
    """Say the verdict on the model; empty if there is none."""
    if not run.has("model", "pair"):
        return ""
    return f"finite element model {verdict_on_model(run.groups['model'])}"


def model_sentences(run: RunData) -> list[str]:
    """List what was found about the model, in sentences; what cannot be told comes last."""
    known = [f for f in findings_of(run.groups) if f.kind.startswith("model_")]
    limits = [f for f in known if f.kind == "model_limits"]
    said = [f for f in known if f.kind != "model_limits"] + limits
    plain = (f.text.removeprefix("model: ") for f in said)
    return [f"{text[:1].upper()}{text[1:]}." for text in plain]


def modal_tables(run: RunData) -> Iterator[Table]:
    """Make the table of the modes and that of the model, of those that there are.

    Examples
    --------
    >>> list(modal_tables(RunData({})))
    []
    """
    if run.has("modes", "natural_frequency", "damping_ratio"):
        yield mode_table(run.groups["modes"])
    if run.has("model", "pair"):
        yield model_table(run.groups["model"])
        criteria = criteria_table(run)
        if criteria is not None:
            yield criteria


def mode_table(modes: xr.Dataset) -> Table:
    """Show frequency, damping, complexity and phase of every mode, and the misfit of all.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> modes = group("modes", {"mode": [1]}, natural_frequency=[197.0], damping_ratio=[0.01],
    ...               natural_frequency_std=[1e-3], damping_ratio_std=[5e-6], misfit=1.02)
    >>> [list(column.cells)[0] for column in mode_table(modes).columns]
    ['1', '197.0000 ± 0.0020', '1.00000 ± 0.00098']
    >>> mode_table(modes).title
    'Modes, with 95 % bounds; misfit 1.02 (noise alone: 1)'
    """
    level = f"{PERCENT * level_of(modes):g} %"
    title = f"Modes, with {level} bounds"
    if "misfit" in modes:
        p_value = f"; {_p(modes['misfit_p_value'])}" if "misfit_p_value" in modes else ""
        title += f"; misfit {number(float(modes['misfit']), 3)} (noise alone: 1{p_value})"
    columns = ["mode", *POLES]
    known = poles(modes)
    cells = [list(map(str, modes["mode"].values)), *([row[i] for row in known] for i in (0, 1))]
    if "complexity" in modes:
        columns.append("complexity, ‰")
        cells.append(_bounded(modes, "complexity", PER_MILLE))
    if "phase" in modes:
        phase = VARIABLES["modes"]["phase"]
        columns.append(phase.titled("phase"))
        known_to = "phase_std" in modes
        plain = [number(phase.factor * x, 3) for x in modes["phase"].values]
        cells.append(_bounded(modes, "phase", phase.factor) if known_to else plain)
    if "modal_scale" in modes and np.isfinite(modes["modal_scale"].values).any():
        scale = VARIABLES["modes"]["modal_scale"]
        columns.append(scale.titled("modal scale"))
        cells.append(_bounded(modes, "modal_scale", scale.factor))
    if "scale_std" in modes:
        columns.append("shape's scale, ± ‰")
        factor = PER_MILLE * level_factor(modes)
        cells.append([number(factor * x, 2) for x in modes["scale_std"].values])
    table = Table(*columns, title=title, title_justify="left", caption=_of_references(modes))
    for row in zip(*cells, strict=True):
        table.add_row(*row)
    return table


def _of_references(modes: xr.Dataset) -> str:
    """Say what the number of references means for modes of one pole."""
    if "exciter" not in modes.coords:
        return "One reference: two modes of one frequency and damping would be one here."
    return f"Of the references {', '.join(map(str, modes['exciter'].values))} together."


def _bounded(modes: xr.Dataset, name: str, scale: float) -> list[str]:
    """Write values times `scale` with bounds."""
    factor = scale * level_factor(modes)
    bounds = bounds_of(modes, name, "std").values
    values = zip(modes[name].values, bounds, strict=True)
    return [with_bound(scale * value, factor * std) for value, std in values]


def model_table(model: xr.Dataset) -> Table:
    """Show every measured mode beside the model's: frequency, MAC with its expectation, tests.

    Tests of shapes are of each mode; that of frequencies is of all of them, in the title.
    """
    title = f"Finite element model: {verdict_on_model(model)}"
    if "frequencies_p_value" in model:
        title += f"; frequencies together {_p(model['frequencies_p_value'])}"
    names = ("mode", "pair", "measured, Hz", "model, Hz", "difference, ‰")
    tests = ("MAC", "expected if right", "shape p", "directed p")
    table = Table(title=title, title_justify="left")
    for name in (*names, *tests):
        table.add_column(name, no_wrap=True)
    weighed = "modal_mass" in model
    if weighed:
        table.add_column(VARIABLES["model"]["modal_mass"].titled("modal mass"), no_wrap=True)
    table.add_column("mixed with")
    for mode in model["mode"].values:
        one = model.sel(mode=mode)
        cells = [str(mode), *_frequency_cells(model, one), *_shape_cells(one)]
        if weighed:
            mass, std = (float(one[f"modal_mass{end}"]) for end in ("", "_std"))
            cells.append(with_bound(mass, float(student_factor(0.95, np.inf)) * std))
        table.add_row(*map(escape, cells), escape(mixed_modes(model, one)))
    return table


def _frequency_cells(model: xr.Dataset, one: xr.Dataset) -> list[str]:
    """Write the pair of a mode, both frequencies and their difference."""
    pair = int(one["pair"])
    measured = number(float(one["measured_frequency"]), 7)
    if not pair:
        return ["none", measured, "", ""]
    own = number(float(model["model_frequency"].sel(model_mode=pair)), 7)
    return [str(pair), measured, own, f"{PER_MILLE * float(one['difference']):+.3g}"]


def _shape_cells(one: xr.Dataset) -> list[str]:
    """Write MAC and its expectation with three standard deviations, and the p of both tests."""
    if not int(one["pair"]):
        return ["", "", "", ""]
    expected, std = float(one["mac_expected"]), float(one["mac_std"])
    places = int(np.clip(1 - np.floor(np.log10(std)), 2, 9)) if std > 0 else 5
    return [
        f"{float(one['mac_of_pair']):.{places}f}",
        f"{expected:.{places}f} ± {std:.{places}f}",
        _probability(one["p_value"]),
        _probability(one["directed_p_value"]),
    ]


def criteria_table(run: RunData) -> Table | None:
    """Show CoMAC, FRAC and CSAC beside what noise alone leaves of them; None without any.

    The median of all pixels or lines, and the one farthest below its expected value.

    Examples
    --------
    >>> from sldvexp.dataset import group
    >>> lines = group("model", {"line": [0, 1]}, csac=[0.9, 0.98], csac_expected=[0.99, 0.99],
    ...               csac_std=[0.01, 0.01], line_frequency=[100.0, 105.0])
    >>> table = criteria_table(RunData({"model": lines}))
    >>> [list(column.cells)[0] for column in table.columns]
    ['CSAC', 'the pixels of a line', '0.9400', '0.9900', '0.9000', '0.9900', '100 Hz']
    """
    rows = []
    for name, title, over, place in CRITERIA:
        known = _criterion(run, name, place)
        if known is None:
            continue
        value, expected, std, where = known
        below = (expected - value) / std
        worst = int(np.nanargmax(below))
        shown = (np.nanmedian(value), np.nanmedian(expected), value[worst], expected[worst])
        rows.append([title, over, *_as_many_places(shown), where[worst]])
    if not rows:
        return None
    table = Table(title="Model by pixel and by line, not judged", title_justify="left")
    names = ("criterion", "over", "median", "noise alone", "worst", "noise alone there", "at")
    for name in names:
        table.add_column(name, no_wrap=True)
    for row in rows:
        table.add_row(*map(escape, row))
    return table


def _criterion(run: RunData, name: str, place: str) -> tuple[Array, Array, Array, list[str]] | None:
    """Collect a criterion, its expected value and standard deviation, and where each is of."""
    wanted = (name, f"{name}_expected", f"{name}_std")
    groups = run.below(place, *wanted) if place != "model" else {}
    where = [f"view {view}, pixel {p}" for view, g in groups.items() for p in g["pixel"].values]
    if place == "model" and run.has("model", *wanted, "line_frequency"):
        groups = {"": run.groups["model"]}
        where = [f"{number(f, 5)} {NATURAL}" for f in groups[""]["line_frequency"].values]
    if not where:
        return None
    values = (np.concatenate([g[key].values for g in groups.values()]) for key in wanted)
    value, expected, std = values
    return value, expected, np.where(std > 0, std, np.nan), where


def _as_many_places(values: Sequence[float]) -> list[str]:
    """Write values near one with as many places as the nearest to it needs."""
    nearest = min((abs(1 - v) for v in values if v != 1), default=0.1)
    places = int(np.clip(2 - np.floor(np.log10(nearest)), 2, 9))
    return [f"{v:.{places}f}" for v in values]


def _p(value: xr.DataArray) -> str:
    """Write a p value with its letter."""
    text = _probability(value)
    return f"p {text}" if text.startswith("<") else f"p = {text}"


def _probability(value: xr.DataArray) -> str:
    """Write a p value; one that no number is small enough for is less than any."""
    return number(float(value), 2) if float(value) != 0 else "< 1e-300"


def mixed_modes(model: xr.Dataset, one: xr.Dataset) -> str:
    """Name the model's modes that are in a measured one beside its pair, surely."""
    if "mixed" not in one or not int(one["pair"]):
        return ""
    share, std = np.abs(one["mixed"].values), one["mixed_std"].values
    sure = np.flatnonzero((std > 0) & (share > SURE * std))
    order = sure[np.argsort(-share[sure], kind="stable")]
    parts = (f"{model['model_mode'].values[j]} ({PERCENT * share[j]:.2g} %)" for j in order)
    return ", ".join(parts)
