"""What to mind: warnings first of all, what checks found, and how the run came to be."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime
from typing import Any

import numpy as np

from sldvexp.config.paths import RUN_FILE
from sldvexp.dataset import RunData, Severity
from sldvexp.field.estimate import NO_COVARIANCE
from sldvexp.lazy import xarray as xr
from sldvexp.report.base import notes, verdict_text
from sldvexp.report.html.blocks import (
    Code,
    Facts,
    HtmlTable,
    Listing,
    More,
    Section,
    Text,
    having,
)
from sldvexp.report.numbers import number
from sldvexp.report.tables import strongest, truth_table
from sldvexp.report.terminal import published

#: A larger share of flagged pixels is told first of all.
MOST_FLAGGED = 0.05
#: More numbers than this of one variable are no table that anybody reads; the dataset has all.
MOST_NUMBERS = 60


#: Looks of a line about a verdict or a finding.
LOOKS = {"trusted": "good", "note": "", "doubtful": "warning", "void": "warning"}


def verdict_blocks(run: RunData) -> list[Text]:
    """Say in a line how far the results can be believed, and how much there is to mind."""
    line, findings = verdict_text(run)
    minded = len(_minded(run))
    notes = all(f.severity is Severity.note for f in findings)
    counted = [
        f"{count} {what}{'s' * (count > 1)}{more}"
        for count, what, more in (
            (len(findings), "note" if notes else "finding", ""),
            (minded, "thing", " to mind"),
        )
        if count
    ]
    told = f"{' and '.join(counted)}, below." if counted else ""
    if not line:
        look = "warning" if minded else "good"
        first = "Not judged: the run tells of no test of its results."
        return [Text(f"{first} {told}".strip(), f"verdict {look}")]
    look = LOOKS[line.partition(":")[0]]
    return [Text(f"{line[0].upper()}{line[1:]}. {told}".strip(), f"verdict {look}")]


def findings_section(run: RunData) -> Section:
    """List what the verdict rests on with its remedies, and what else is to be minded, once."""
    _, findings = verdict_text(run)
    told = [
        f"{f.severity.name}: {f.text}" + (f" (remedy: {f.remedy})" if f.remedy else "")
        for f in findings
    ]
    worst = any(f.severity is not Severity.note for f in findings)
    others = _minded(run)
    blocks: list[Any] = []
    if told:
        blocks.append(Listing(told, "warning" if worst else "good"))
    if others:
        blocks.append(Listing(others, "warning"))
    if not blocks:
        blocks.append(Text("Nothing to mind.", "good"))
    return Section("What to mind", blocks)


def _minded(run: RunData) -> list[str]:
    """List what the stages noted, what was missed, and what has no bound, each once.

    What a finding says already is not said again.
    """
    said = [f.text for f in verdict_text(run)[1]]
    every = dict.fromkeys(_warnings(run))
    return [told for told in every if not any(text in told for text in said)]


def _warnings(run: RunData) -> Iterator[str]:
    yield from _missed(run)
    told = list(notes(run))
    yield from told
    yield from _unbounded(run, NO_COVARIANCE in told)
    yield from _undetermined(run)
    for view, image in run.below("image").items():
        flagged = float(np.mean(image["flags"].values != 0))
        if flagged > MOST_FLAGGED:
            yield f"view {view}: {flagged:.0%} of the image's pixels are flagged"
    if str(run.attributes.get("git_commit", "")).endswith("-dirty"):
        yield "the program had been changed since its last commit, which does not tell how"


def _missed(run: RunData) -> Iterator[str]:
    """Find expectations that were not met."""
    if "check" not in run.groups:
        return
    check = run.groups["check"]
    for i in np.flatnonzero(~check["passed"].values.astype(bool)):
        one = check.isel(quantity=i)
        yield (
            f"not as expected: {one['quantity'].item()} is {number(one['computed'].item(), 5)}, "
            f"and should be {one['relation'].item()} {number(one['published'].item(), 5)}"
            f" ({one['source'].item() or 'no source given'})"
        )


def _unbounded(run: RunData, told: bool) -> Iterator[str]:
    """Find poses without bounds, which make those of the velocities too small.

    Parameters
    ----------
    told : bool
        Whether it is told already that poses have none, so that only the views are to be named.
    """
    pose = run.groups.get("pose")
    if pose is None:
        return
    std = pose.get("origin_std")
    known = np.zeros(pose.sizes["view"]) if std is None else np.isfinite(std.values).all(axis=1)
    views = [str(v) for v, k in zip(pose["view"].values, known, strict=True) if not k]
    if views and not (told and len(views) == len(known)):
        yield f"the pose of {_named(views)} has no bounds"


def _undetermined(run: RunData) -> Iterator[str]:
    """Find directions that the views do not tell."""
    for name, field in run.fields().items():
        if flagged := field.sizes.get("flagged", 0):
            of = "" if name == "field" else f" by {name}"
            yield (
                f"at {flagged} of {field.sizes['node']} nodes the views do not determine every "
                f"component of the velocity{of}; what they determine is given"
            )
    point = run.groups.get("point")
    if point is not None and point.sizes.get("deficient", 0):
        where = f"{count} points" if (count := point.sizes["deficient"]) > 1 else "one point"
        yield f"at {where} the views do not determine every component"


def _named(views: list[str]) -> str:
    return f"view {views[0]}" if len(views) == 1 else f"views {', '.join(views)}"


def checks_section(run: RunData) -> Section | None:
    """Show expectations met and missed, then every check's findings."""
    examined = run.below("examined")
    if "check" not in run.groups and not examined:
        return None
    blocks: list[Any] = []
    if "check" in run.groups:
        check = run.groups["check"]
        met, of = int(check["passed"].sum()), check.sizes["quantity"]
        told = f"{met} of {of} expectations are met."
        if met == of:
            told = f"All {of} expectations are met." if of > 1 else "The one expectation is met."
        blocks.append(Text(told, "good" if met == of else "warning"))
        blocks.append(replace(HtmlTable.from_table(published(check)), caption=""))
    for field in list(run.fields().values())[:1]:
        own = [g for g in examined.values() if "rms_bound" in g]
        blocks += [HtmlTable.from_table(truth_table(g, strongest(field))) for g in own]
    tables = [
        HtmlTable(["what", "where", "value", "unit"], list(_numbers(name, g)), name)
        for name, g in examined.items()
    ]
    if tables:
        blocks.append(More("What the checks found, number by number", tables))
    return Section("Checks", blocks)


def _numbers(name: str, group: xr.Dataset) -> Iterator[list[str]]:
    """List a check's numbers by name; of many only how they are spread."""
    for variable in group.data_vars.values():
        told = str(variable.attrs.get("long_name", variable.name))
        unit = str(variable.attrs.get("units", ""))
        if variable.size > MOST_NUMBERS:
            where = " × ".join(f"{n} of {d}" for d, n in variable.sizes.items())
            yield [told, where, _spread(variable.values), unit]
            continue
        for index in np.ndindex(*variable.shape):
            at = zip(variable.dims, index, strict=True)
            where = ", ".join(
                f"{d} {_label(variable[d].values[i])}" if d in variable.coords else f"{d} {i}"
                for d, i in at
            )
            yield [told, where, _value(variable.values[index]), unit]


def _spread(values: np.ndarray) -> str:
    """Tell how many numbers are spread: least, middle and largest size, or where they are."""
    if values.dtype.kind not in "fciub":
        return f"{values.size} in run.nc"
    sizes = np.abs(values[np.isfinite(values)])
    if not sizes.size:
        return "none is known"
    least, middle, most = (number(float(v), 3) for v in np.percentile(sizes, (0, 50, 100)))
    return f"{least} to {most}, half of them below {middle}"


def _label(label: object) -> str:
    return f"{label:.4g}" if isinstance(label, float | np.floating) else str(label)


def _value(value: Any) -> str:
    return (
        number(complex(value))
        if isinstance(value, complex | float | int | np.number)
        else str(value)
    )


def provenance_section(run: RunData) -> Section:
    """List versions, commit, seed, digests and inputs; the exact command last."""
    attributes = run.attributes
    packages = recorded_table(attributes, "packages")
    facts = [
        ("program", f"sldvexp {packages.get('sldvexp', '')}"),
        ("commit", str(attributes.get("git_commit", "")) or "an installed package, not a checkout"),
        ("seed", str(attributes.get("seed", ""))),
        ("begun", moment(attributes, "start")),
        ("ended", moment(attributes, "end")),
        ("configuration", f"sha256 {attributes.get('config_sha256', '')}"),
        (
            "packages",
            ", ".join(f"{k} {v}" for k, v in packages.items()),
        ),
        ("conventions", "; ".join(_conventions(attributes))),
    ]
    if reused := attributes.get("reused_steps"):
        facts.append(("taken over", f"from another run of the same sweep: {reused}"))
    inputs = [list(each) for each in recorded_table(attributes, "inputs_sha256").items()]
    read = HtmlTable(["file", "sha256"], inputs, "Files that were read", (0, 1))
    blocks = having(
        Facts(facts),
        read if inputs else Text("No file was read but the program's own configuration."),
        More("The whole configuration", [Code(str(attributes.get("config", "")))]),
        Text("To repeat the run exactly, in this folder:"),
        Code(f"sldvexp rerun {run.path.name if run.path else RUN_FILE}"),
    )
    return Section("Provenance", blocks)


def moment(attributes: Any, of: str) -> str:
    """Write when a run started or ended."""
    day, _, time = str(attributes.get(f"{of}_time", "")).partition("T")
    return f"{day} {time[:8]} UTC" if time else day


def duration(attributes: Any) -> float:
    """Count the seconds that a run took; NaN if its file does not tell."""
    try:
        begun, ended = (
            datetime.fromisoformat(str(attributes[f"{k}_time"])) for k in ("start", "end")
        )
    except (KeyError, ValueError):
        return float("nan")
    return (ended - begun).total_seconds()


def _conventions(attributes: Any) -> list[str]:
    ending = "_convention"
    names = {k: v for k, v in attributes.items() if str(k).endswith(ending)}
    told = [f"{str(k).removesuffix(ending).replace('_', ' ')}: {v}" for k, v in names.items()]
    return [*told, f"phase: {attributes.get('phase_reference', '')}"]


def recorded_table(attributes: Any, name: str) -> dict[str, str]:
    """Read a table that an attribute has as text; an empty one if it has none."""
    try:
        found = json.loads(str(attributes.get(name, "{}")))
    except ValueError:
        return {}
    return {str(k): str(v) for k, v in found.items()} if isinstance(found, dict) else {}
