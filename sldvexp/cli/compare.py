"""`sldvexp compare <folders>`: one dataset and a ranking of any runs, by what sets them apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any

from sldvexp import dataset
from sldvexp.config.experiment import NAMED_GROUPS, SINGLE_GROUPS
from sldvexp.config.paths import RUN_FILE
from sldvexp.errors import UserError
from sldvexp.report.html.page import Html
from sldvexp.sweep import recorded_config
from sldvexp.sweep.collect import collect
from sldvexp.sweep.recorded_config import Recorded
from sldvexp.sweep.summary import write_summary

RANK = "sweep.rank="
#: Settings that change no number.
IDLE = ("export", "report", "sweep", "plan")


def run(words: list[str], config_dir: str | None) -> int:
    """Compare the runs of all folders.

    Raises
    ------
    UserError
        If a folder holds no run, or less than two runs are given.
    """
    ranks = [w.removeprefix(RANK) for w in words if w.startswith(RANK)]
    folders = runs_in([Path(w) for w in words if not w.startswith(RANK)])
    if len(folders) < 2:
        raise UserError("command line: compare takes the folders of at least two runs")
    differing = settings_that_differ([_recorded(folder) for folder in folders])
    keys, cells = list(differing), list(zip(*differing.values(), strict=True))
    table = collect(keys, cells or [()] * len(folders), folders)
    where = Path(f"outputs/{datetime.now():%Y-%m-%d/%H-%M-%S.%f}")
    where.mkdir(parents=True)
    table.attrs["runs"] = [str(folder.resolve()) for folder in folders]
    write_summary(table, keys, where, ranks[-1] if ranks else "", Html())
    return 0


def runs_in(paths: Sequence[Path]) -> list[Path]:
    """List the folders of runs: each path is one, or a run's file, or the folder of a sweep.

    Of runs that failed it is told that they are left out.

    Raises
    ------
    UserError
        At the first path without a run.
    """
    found: dict[Path, None] = {}
    for path in paths:
        if path.name == RUN_FILE and path.is_file():
            here = [path.parent]
        elif (path / RUN_FILE).is_file():
            here = [path]
        else:
            here = sorted(file.parent for file in path.glob(f"*/{RUN_FILE}"))
        if not here and (path / ".hydra").is_dir():
            print(f"{path}: left out, its run left no {RUN_FILE}")
        elif not here:
            raise UserError(f"{path}: has no {RUN_FILE}; give folders of finished runs, or sweeps")
        found |= dict.fromkeys(here)
    return list(found)


def settings_that_differ(runs: Sequence[Recorded]) -> dict[str, list[str]]:
    """Find keys whose values set runs apart, with the value of each run.

    A group's settings count among runs with the same plugin only, and of settings that always
    change together the first stands for all.
    """
    flat = [_flat(run) for run in runs]
    keys = dict.fromkeys(key for settings in flat for key in settings)
    found: dict[str, list[str]] = {}
    patterns = set()
    for key in keys:
        plugin = key.partition(".")[0]
        values = [settings.get(key, "") for settings in flat]
        alike: dict[str, set[str]] = {}
        for settings, value in zip(flat, values, strict=True):
            alike.setdefault(settings.get(plugin, ""), set()).add(value)
        pattern = tuple(values.index(v) for v in values)
        if all(len(v) == 1 for v in alike.values()) and key != plugin:
            continue  # it follows from the plugin
        if len(set(values)) > 1 and pattern not in patterns:
            patterns.add(pattern)
            found[key] = values
    return found


def _recorded(folder: Path) -> Recorded:
    path = folder / RUN_FILE
    with dataset.load(path) as tree:
        return recorded_config.read(path, tree.attrs)


def _flat(run: Recorded) -> dict[str, str]:
    """Flatten to dotted keys with their values as text; a group's own key has its plugin."""
    found = {g: run.plugins.get(g, "null") for g in SINGLE_GROUPS if g not in IDLE}
    for key, value in run.values.items():
        if key not in IDLE:
            _flatten(key, value, found)
    return {k: v for k, v in found.items() if k not in NAMED_GROUPS}


def _flatten(key: str, value: Any, found: dict[str, str]) -> None:
    if isinstance(value, Mapping):
        for name, below in value.items():
            _flatten(f"{key}.{name}", below, found)
    elif key not in SINGLE_GROUPS:
        found[key] = "null" if value is None else str(value)
