"""What was measured and how: each stage in a sentence, the views, and every setting."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from sldvexp.config import docs, registry
from sldvexp.config.experiment import NAMED_GROUPS
from sldvexp.config.paths import conf_dir
from sldvexp.dataset import DAC, RunData, read_yaml
from sldvexp.errors import UserError
from sldvexp.report.html.blocks import HtmlTable, More, Section, having

#: What each group of the configuration is to a reader.
STAGES = {
    "target": "calibration object",
    "laser": "instrument's mirrors",
    "scene": "virtual lab",
    "scan": "scan",
    "instrument": "measurements from",
    "signal": "samples to pixels",
    "pose": "pose",
    "volume": "volume",
    "reconstruction": "velocity",
    "solver": "equations solved by",
}
#: Settings in one line; a longer value is only in the table of all settings.
LONGEST_VALUE = 40
MOST_SETTINGS = 8
MOST_FREQUENCIES = 4
UNITS = ("m", "mm", "inch", "rad", "deg", "Hz", "m/s", "V", "s", DAC)


def setup_section(run: RunData) -> Section:
    """Show the plugins in the order in which data flows, and what each view saw."""
    chosen = [
        (told, g, run.plugins[g], run.config[g]) for g, told in STAGES.items() if _has(run, g)
    ]
    for key, group in NAMED_GROUPS.items():
        if key == "export":
            continue
        for name, entry in (run.config.get(key) or {}).items():
            plugin = str((entry or {}).get("plugin", ""))
            own = {k: v for k, v in (entry or {}).items() if k != "plugin"}
            chosen.append((f"{key.replace('_', ' ')}: {name}", group, plugin, own))
    known = [_documented(group, name, own) for _, group, name, own in chosen]
    rows = [
        [told, *_method(group, name, own), _brief(own, documented)]
        for (told, group, name, own), documented in zip(chosen, known, strict=True)
    ]
    stages = HtmlTable(["stage", "method", "in words", "settings"], rows, wide=(2, 3))
    columns = ["setting", "value", "type, unit", "meaning"]
    details = [
        HtmlTable(columns, list(_settings(own, documented)), f"{told}: {group}={name}", (1, 2, 3))
        for (told, group, name, own), documented in zip(chosen, known, strict=True)
        if own
    ]
    every = More("Every setting and what it means", details)
    return Section("Settings", having(stages, every))


def _has(run: RunData, group: str) -> bool:
    """Tell whether a run has a plugin of a group and made use of it."""
    idle = group == "solver" and not run.fields()
    return isinstance(run.config.get(group), dict) and group in run.plugins and not idle


def _method(group: str, name: str, values: dict[str, Any]) -> tuple[str, str]:
    """Name a stage's choice with its sentence: the plugin's, or of one that builds on it."""
    choice, told = preset(group, name, values)
    return (f"{choice} ({name})", told) if choice else (name, _meaning(group, name))


def _meaning(group: str, name: str) -> str:
    """Describe a plugin in its own words; nothing if it is not installed here."""
    try:
        return docs.of_choice(group, name)
    except UserError:
        return ""


def _documented(group: str, name: str, values: dict[str, Any]) -> dict[str, docs.Parameter]:
    """Read a plugin's fields with unit and meaning; none if it is not installed here."""
    try:
        return {p.key: p for p in docs.parameters_of(registry.get(group, name), values)}
    except UserError:
        return {}


def _brief(values: dict[str, Any], documented: dict[str, docs.Parameter]) -> str:
    """List the short settings of a stage that say something, with their units."""
    told = list(_samplings(values))
    for key, value in values.items():
        text = _plain(value)
        if not text or isinstance(value, dict) or len(text) > LONGEST_VALUE or value in (0, False):
            continue
        kind = documented[key].kind if key in documented else ""
        unit = kind.partition(", ")[2] if kind.startswith(("float", "list of")) else ""
        unit = unit if unit in UNITS else ""
        told.append(f"{key.replace('_', ' ')} {text} {unit}".strip())
    return "; ".join(told[:MOST_SETTINGS])


def _samplings(values: dict[str, Any], above: str = "") -> Iterator[str]:
    """Say how a scan samples, also the parts of a session that have views."""
    for key, value in values.items():
        if key == "sampling" and isinstance(value, dict):
            hertz: Any = value.get("frequency")
            many = isinstance(hertz, list) and len(hertz) > MOST_FREQUENCIES
            what = f"{len(hertz)} frequencies" if many else f"{_plain(hertz)} Hz"
            yield f"{above}{what}, {value.get('samples')} samples at {_plain(value.get('rate'))} Hz"
        elif isinstance(value, dict) and "sampling" in value and value.get("views"):
            yield from _samplings({"sampling": value["sampling"]}, f"{key}: ")


def _plain(value: Any) -> str:
    """Write a value as one would say it; empty for nothing."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        plain = not any(isinstance(v, list | dict) for v in value)
        told = ", ".join(map(_plain, value)) if plain else docs.as_yaml(value)
        return f"({told})" if len(value) > 1 else told
    return "" if value is None else f"{value:g}" if isinstance(value, float) else str(value)


def views_table(run: RunData) -> HtmlTable | None:
    """Make one row a view: what was scanned there, and what of it was of use."""
    edges, images = run.below("edge"), run.below("image")
    field = next(iter(run.fields().values()), None)
    counts: dict[str, dict[str, str]] = {}
    for view, edge in edges.items():
        counts.setdefault(view, {})["edges of circles"] = str(edge.sizes["edge"])
    for view, image in images.items():
        row = counts.setdefault(view, {})
        row["pixels"] = str(image.sizes["pixel"])
        row["flagged"] = str(int((image["flags"].values != 0).sum()))
        hertz: Any = image["frequency"].values if "frequency" in image.coords else []
        row["Hz"] = (
            ", ".join(f"{f:g}" for f in hertz)
            if len(hertz) <= MOST_FREQUENCIES
            else (f"{len(hertz)} from {min(hertz):g} to {max(hertz):g}")
        )
    if field is not None and "samples_seen" in field:
        for view in field["view"].values:
            seen = int(field["samples_seen"].sel(view=view))
            counts.setdefault(str(view), {})["samples of the volume seen"] = str(seen)
    columns = list(dict.fromkeys(c for row in counts.values() for c in row))
    rows = [[view, *(row.get(c, "") for c in columns)] for view, row in counts.items()]
    return HtmlTable(["view", *columns], rows, "Views") if rows else None


def _settings(values: dict[str, Any], documented: dict[str, docs.Parameter]) -> Iterator[list[str]]:
    """List a stage's settings with type, unit and meaning."""
    for key, value in values.items():
        if value not in ({}, []):
            one = documented.get(str(key))
            told = [one.kind, one.meaning] if one else ["", ""]
            yield [str(key), docs.as_yaml(value), *told]


def preset(group: str, plugin: str, values: Mapping[str, Any]) -> tuple[str, str]:
    """Name and first sentence of a choice that builds on the plugin's own; empty if it is none.

    Parameters
    ----------
    values : mapping
        The stage's settings. They have all that the choice sets, such as ``rows: all``.
    """
    for file in sorted((conf_dir() / group).glob("*.yaml")):
        own = read_yaml(file.read_text(encoding="utf-8")) or {}
        defaults = own.pop("defaults", [])
        if own and _root(file, defaults) == plugin and _holds(values, own):
            return file.stem, docs.of_file(file)
    return "", ""


def _root(file: Path, defaults: list[Any]) -> str:
    """Find the choice at the root of what a file builds on; empty if that is a schema.

    The first plain name of each defaults list is followed, in the folder of `file`; names with a
    slash, and ``_self_``, are no files there.
    """
    found = ""
    while based := [d for d in defaults if isinstance(d, str) and d.isidentifier() and d[0] != "_"]:
        found = based[0]
        defaults = read_yaml(file.with_stem(found).read_text(encoding="utf-8")).get("defaults", [])
    return found


def _holds(values: Any, own: Any) -> bool:
    """Tell whether settings are among others."""
    if isinstance(own, Mapping) and isinstance(values, Mapping):
        return all(key in values and _holds(values[key], each) for key, each in own.items())
    return bool(values == own)
