"""How the run came to be, and at the very end the command that repeats it."""

from __future__ import annotations

import json
from datetime import datetime
from typing import Any

from sldvexp.report.html.blocks import Code, Facts, HtmlTable, More, Section, Text, having
from sldvexp.report.html.page_data import Subject


def section(run: Subject) -> Section:
    """Versions, commit, seed, digests and inputs; the exact command last."""
    attributes = run.attributes
    facts = [
        ("program", f"sldvexp {table(attributes, 'packages').get('sldvexp', '')}"),
        ("commit", str(attributes.get("git_commit", "")) or "an installed package, not a checkout"),
        ("seed", str(attributes.get("seed", ""))),
        ("begun", str(attributes.get("start_time", ""))),
        ("ended", str(attributes.get("end_time", ""))),
        ("configuration", f"sha256 {attributes.get('config_sha256', '')}"),
        ("packages", ", ".join(f"{k} {v}" for k, v in table(attributes, "packages").items())),
        ("conventions", "; ".join(_conventions(attributes))),
    ]
    if reused := attributes.get("reused_steps"):
        facts.append(("taken over", f"from another run of the same sweep: {reused}"))
    inputs = [[name, digest] for name, digest in table(attributes, "inputs_sha256").items()]
    read = HtmlTable(["file", "sha256"], inputs, "Files that were read", (0, 1))
    blocks = having(
        Facts(facts),
        read if inputs else Text("No file was read but the program's own configuration."),
        More("The whole configuration", [Code(str(attributes.get("config", "")))]),
        Text("To repeat the run exactly, in this folder:"),
        Code(f"sldvexp rerun {run.path.name}"),
    )
    return Section("Provenance", blocks)


def duration(attributes: Any) -> float:
    """Seconds that a run took; NaN if its file does not tell."""
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


def table(attributes: Any, name: str) -> dict[str, str]:
    """A table that an attribute has as text; an empty one if it has none."""
    try:
        found = json.loads(str(attributes.get(name, "{}")))
    except ValueError:
        return {}
    return {str(k): str(v) for k, v in found.items()} if isinstance(found, dict) else {}
