"""The page of a sweep: what was varied, which runs came out best, and why others did not."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from sldvexp.config.paths import RUN_FILE
from sldvexp.dataset import VERDICT, load_table
from sldvexp.lazy import xarray as xr
from sldvexp.report.html import render
from sldvexp.report.html.blocks import Code, Facts, HtmlTable, Link, Listing, Section, Text, having
from sldvexp.report.html.figures import sweep_figures
from sldvexp.report.html.pair import pair_section
from sldvexp.report.numbers import first, number

GOOD = ("done",)
MEANING = {"missed": "done, but an expectation was not met"}


def write(path: Path, ranking: Sequence[Mapping[str, Any]], page: Path) -> Path:
    """Make the page of a sweep from its dataset alone.

    Parameters
    ----------
    path : Path
        ``sweep.nc``.
    ranking : sequence of mapping
        Every run's settings, state and headline, the best first.
    page : Path
        Where to.

    Raises
    ------
    UserError
        If the file is not a sweep's.
    """
    table = load_table(path)
    keys, by = [str(k) for k in np.atleast_1d(table.attrs["keys"])], str(table.attrs["ranked_by"])
    done = sum(row["state"] in GOOD for row in ranking)
    unit = str(table[by].attrs.get("units", "1")) if by in table else "1"
    title = f"Sweep of {', '.join(keys)}" if keys else "Comparison of runs"
    subtitle = f"{len(ranking)} runs, {done} done as expected"
    sections = [
        Section("Warnings", _warnings(ranking, keys)),
        *_shapes(table),
        Section("What was varied", _varied(table, ranking, keys)),
        Section("Results", having(_results(ranking, keys, by, unit, page), sweep_figures(table))),
        Section("Provenance", list(_provenance(table, path))),
    ]
    return render.write(page, title, subtitle, sections)


def _warnings(ranking: Sequence[Mapping[str, Any]], keys: Sequence[str]) -> list[Listing | Text]:
    """List runs that failed or missed an expectation, with the sentence about it."""
    found = [
        f"{_name(row, keys)}: {MEANING.get(row['state'], row['state'])}"
        + (f": {row['reason']}" if row["reason"] else "")
        for row in ranking
        if row["state"] not in GOOD
    ]
    found += [
        f"{_name(row, keys)}: the verdict is {row[VERDICT]}"
        for row in ranking
        if row.get(VERDICT, "") not in ("", "trusted")
    ]
    return [Listing(found, "warning") if found else Text("Nothing to mind.", "good")]


def _shapes(table: xr.Dataset) -> Iterator[Section]:
    """Show the shapes of two runs that are compared."""
    paths = [Path(str(folder)) / RUN_FILE for folder in np.atleast_1d(table.attrs.get("runs", []))]
    if len(paths) == 2 and all(path.is_file() for path in paths):
        names = [path.parent.name or str(path.parent) for path in paths]
        if names[0] == names[1]:
            names = [str(path.parent) for path in paths]
        if section := pair_section(paths, names):
            yield section


def _name(row: Mapping[str, Any], keys: Sequence[str]) -> str:
    return ", ".join(f"{key}={row[key]}" for key in keys) or "a run"


def _varied(
    table: xr.Dataset, ranking: Sequence[Mapping[str, Any]], keys: Sequence[str]
) -> list[Facts]:
    """List each key with its values, and how long the runs took."""
    pairs = [
        (k, ", ".join(dict.fromkeys(str(v) for v in np.atleast_1d(table[k].values)))) for k in keys
    ]
    seconds = [float(row["seconds"]) for row in ranking if math.isfinite(row["seconds"])]
    pairs.append(("runs", str(len(ranking))))
    pairs.append(("time of all runs", f"{number(sum(seconds), 3)} s"))
    if "runs" in table.attrs:
        pairs.append(("folders", ", ".join(map(str, np.atleast_1d(table.attrs["runs"])))))
    return [Facts(pairs)]


def _results(
    ranking: Sequence[Mapping[str, Any]], keys: Sequence[str], by: str, unit: str, page: Path
) -> Iterator[HtmlTable | Text]:
    """Make the ranking, with the way to each run."""
    rows = []
    for place, row in enumerate(ranking, 1):
        value = row[by] if by else math.nan
        rank = str(place) if math.isfinite(value) else ""
        cells = [rank, *(str(row[key]) for key in keys)]
        result = number(value) if rank else ""
        about = [result, number(row["seconds"], 3), str(row.get(VERDICT, "")), str(row["state"])]
        rows.append([*cells, *about, _link(page, str(row.get("folder", "")))])
    caption = f"Runs by {by}, {first(by)} first" if by else "Runs"
    result = (by or "result") + (f", {unit}" if unit != "1" else "")
    yield HtmlTable(["", *keys, result, "seconds", VERDICT, "state", "run"], rows, caption)
    told = "A result of many numbers is ranked by their root mean square"
    yield Text(f"{told}; sweep.csv beside this page has every number of every run.", "small")


def _link(page: Path, folder: str) -> Link | str:
    """Link to the page of a run if it has one, else to its folder, else to none."""
    there = page.parent / folder
    if not folder or not there.is_dir():
        return ""
    address = there.as_uri() if Path(folder).is_absolute() else f"./{quote(folder)}"
    if (there / page.name).is_file():
        return Link("page", f"{address}/{page.name}")
    return Link("folder", f"{address}/")


def _provenance(table: xr.Dataset, path: Path) -> Iterator[Facts | Text | Code]:
    """Tell which program it was, and the command last."""
    attributes = table.attrs
    packages = json.loads(str(attributes.get("packages", "{}")))
    pairs = [
        ("program", f"sldvexp {packages.get('sldvexp', '')}"),
        ("commit", str(attributes.get("git_commit", "")) or "an installed package, not a checkout"),
        ("packages", ", ".join(f"{k} {v}" for k, v in packages.items())),
    ]
    if packages:
        yield Facts(pairs)
    yield Text("Each run's own file has its whole configuration, its inputs and their digests.")
    command = str(attributes.get("command", ""))
    runs = [str(r) for r in np.atleast_1d(attributes.get("runs", []))]
    yield Text("To repeat it, where it was started:" if command else "To repeat it:")
    yield Code(command or f"sldvexp compare {' '.join(runs)}")
