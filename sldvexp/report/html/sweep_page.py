"""The page of a sweep: what was varied, which runs came out best, and why others did not."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from sldvexp.config.paths import RUN_FILE
from sldvexp.dataset import VERDICT, load_table
from sldvexp.lazy import xarray as xr
from sldvexp.report.html import render
from sldvexp.report.html.blocks import (
    Code,
    Facts,
    HtmlTable,
    Lead,
    Link,
    Listing,
    Section,
    Text,
)
from sldvexp.report.html.figures import sweep_figures
from sldvexp.report.html.pair import pair_section
from sldvexp.report.numbers import first, number

GOOD = ("done",)
#: Of a run that has no page.
FOLDER = "folder"
#: What each state of a run means, and what can be done.
MEANING = {
    "done": "finished, and all that was expected of it is met",
    "missed": "done, but an expectation was not met; its page has the numbers",
    "failed": "not done; the reason stands above, and the command once more tries it again",
    "interrupted": "stopped before it was done; the command once more goes on with it",
    "running": "at work, or killed without a word; the command once more goes on with it",
    "waiting": "not begun; the command once more goes on with it",
}


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
    ranked = _results(ranking, keys, by, unit, page)
    told = [_verdict(ranking), *ranked]
    sections = [
        Section("Result", [Lead(told, []), *sweep_figures(table)], unseen=True),
        *_shapes(table),
        Section("What to mind", _warnings(ranking, keys)),
        Section("States", [_states(ranking)]),
        Section("What was varied", _varied(table, ranking, keys)),
        Section("Provenance", list(_provenance(table, path))),
    ]
    return render.write(page, title, subtitle, sections)


def _verdict(ranking: Sequence[Mapping[str, Any]]) -> Text:
    """Say in a line how the runs went."""
    states = Counter(str(row["state"]) for row in ranking)
    verdicts = Counter(str(row.get(VERDICT, "")) for row in ranking)
    doubted = {v: n for v, n in verdicts.items() if v not in ("", "trusted")}
    told = ", ".join(f"{n} {state}" for state, n in states.items())
    told += "".join(f"; verdict of {n}: {v}" for v, n in doubted.items())
    good = set(states) <= set(GOOD) and not doubted
    return Text(f"Of {len(ranking)} runs: {told}.", f"verdict {'good' if good else 'warning'}")


def _states(ranking: Sequence[Mapping[str, Any]]) -> Facts:
    """Explain every state that a run of the sweep is in."""
    known = dict.fromkeys(str(row["state"]) for row in ranking)
    return Facts([(state, MEANING.get(state, "")) for state in known])


def _warnings(ranking: Sequence[Mapping[str, Any]], keys: Sequence[str]) -> list[Listing | Text]:
    """List runs that failed or missed an expectation, with the sentence about it."""
    found = [
        f"{_name(row, keys)}: {row['state']}" + (f": {row['reason']}" if row["reason"] else "")
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
    told += "; sweep.csv beside this page has every number of every run"
    if any(isinstance(row[-1], Link) and row[-1].text == FOLDER for row in rows):
        told += "; report.each_run=true makes a page of every run"
    yield Text(f"{told}.", "small")


def _link(page: Path, folder: str) -> Link | str:
    """Link to the page of a run if it has one, else to its folder, else to none."""
    there = page.parent / folder
    if not folder or not there.is_dir():
        return ""
    address = there.as_uri() if Path(folder).is_absolute() else f"./{quote(folder)}"
    if (there / page.name).is_file():
        return Link("page", f"{address}/{page.name}")
    return Link(FOLDER, f"{address}/")


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
