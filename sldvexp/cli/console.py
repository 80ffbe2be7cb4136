"""`sldvexp console [experiment ...]`: a page in the browser to aim, scan and watch a session.

The configuration is that of `sldvexp` with the same settings; what is aimed becomes an experiment
of the user's folder, and the scan is a run of it as any other.
"""

from __future__ import annotations

import importlib.util
import io
import shlex
import threading
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from omegaconf import open_dict

from sldvexp import config, console, planner
from sldvexp.cli.commands import KEY, CommandLine, arguments_of, begun_with
from sldvexp.cli.help import COMMAND_HELP
from sldvexp.cli.in_process import watched_run
from sldvexp.config import registry
from sldvexp.config.experiment import Experiment
from sldvexp.config.paths import JOURNAL
from sldvexp.config.planning import PlanCriterion
from sldvexp.console.afterwards import Advice
from sldvexp.dataset import RunData
from sldvexp.errors import UserError
from sldvexp.instrument import ScanningPlugin
from sldvexp.lazy import xarray as xr
from sldvexp.planner import StandPlan
from sldvexp.session import Operator, Watcher
from sldvexp.session.interruption import kept_lines
from sldvexp.session.session import measured_by
from sldvexp.typing import Array

#: Options of this command with what they take.
OPTIONS = COMMAND_HELP["console"].options

#: Packages of the extra `console`.
NEEDED = ("starlette", "uvicorn", "websockets")
#: Advice while the views are too few for any.
TOO_FEW = "So few do not determine three components anywhere; three that stand well apart do."
#: The same where no other view is coming.
NO_MORE = "sldvexp plan finds stands for all of them."
#: Advice to who may still choose their stands.
BETTER = (
    "Stands that are not from sldvexp plan can be bettered by it; it writes an experiment with its "
    "own. After each view it is told here which stand helps most."
)
#: Width of a figure for narrow screens, m.
NARROW = 0.085
#: Dots per inch of a figure.
DOTS = 160
#: Folder for what is aimed, without ``--config-dir``.
OWN_FOLDER = "conf"


def run(words: list[str], config_dir: str | None, port: str | None = None) -> int:
    """Serve the page until Ctrl-C.

    Raises
    ------
    UserError
        If the packages are missing, the configuration is wrong, or nothing in it scans.
    """
    if missing := [name for name in NEEDED if importlib.util.find_spec(name) is None]:
        raise UserError(
            f"console needs {' and '.join(missing)}: pip install 'sldvexp[console]' installs it, "
            "of a clone in the folder sldvexp pip install './sldvexp[console]'"
        )
    folder = Path(config_dir or OWN_FOLDER)
    unfinished = next((Path(w.removeprefix(KEY)) for w in words if w.startswith(KEY)), None)
    added: list[str] = []
    if unfinished is not None:
        folder, unfinished = folder.absolute(), unfinished.resolve()  # see `begun_with`
        begun = begun_with(unfinished)
        if begun.config_name != "config":
            raise UserError(
                f"command line: the run {unfinished} was begun with --config-name "
                f"{begun.config_name}, of which no experiment can be made here; "
                f"{kept_lines(unfinished).command} goes on with it"
            )
        folder = _folder_of(unfinished, begun, folder if config_dir else None) or folder
        added = [word for word in words if not word.startswith(KEY)]
        words = [*begun.settings, *added]
        config_dir = str(folder) if begun.config_dirs else None
    experiment = composed(words, config_dir)
    if unfinished is not None and added and (unfinished / JOURNAL).is_dir():
        _require_same_scan(experiment, composed(begun.settings, config_dir), begun, added)
    if experiment.scan is None or not isinstance(experiment.instrument, ScanningPlugin):
        raise UserError(
            "console: needs a scan and an instrument that scans, as experiment=plate or "
            "instrument=visa have them"
        )

    def aimed(settings: Sequence[str]) -> Experiment:
        return composed(settings, str(folder))

    def scanned(settings: Sequence[str], watcher: Watcher, operator: Operator) -> Path:
        return watched_run(settings, str(folder), watcher, operator)

    number = _number(port)
    with console.Console(
        experiment, words, folder, aimed, scanned, number, advice, unfinished, added
    ) as made:
        print(f"{made.address}\nopen it in a browser on this machine; Ctrl-C ends it", flush=True)
        told = made.serve()
    print(told, flush=True)
    return 0


def _require_same_scan(
    experiment: Experiment, before: Experiment, begun: CommandLine, added: Sequence[str]
) -> None:
    """Refuse settings beside a run that goes on with which its scan lines would not go.

    Raises
    ------
    UserError
        That gives the command of a console that scans with them.
    """
    now, then = measured_by(experiment), measured_by(before)
    if not (differ := [name for name in now if repr(now[name]) != repr(then[name])]):
        return
    folders = [word for folder in begun.config_dirs for word in ("--config-dir", folder)]
    own = [word for word in begun.settings if not word.startswith("hydra.run.dir=")]
    raise UserError(
        f"command line: {shlex.join(added)}: {' and '.join(differ)} would not be as the kept scan "
        "lines of the run were measured with: begin a fresh console instead, sldvexp console "
        f"{shlex.join([*folders, *own, *added])}"
    )


def _folder_of(run: Path, begun: CommandLine, given: Path | None) -> Path | None:
    """Find the user's folder with which a run was begun, None if it was without one.

    Raises
    ------
    UserError
        If another one is given: what is aimed would go where its experiment is not.
    """
    own = Path(begun.config_dirs[-1]) if begun.config_dirs else None
    if given is not None and own is not None and given.resolve() != own.resolve():
        raise UserError(
            f"command line: --config-dir {given}: the run {run} was begun with that of {own}, and "
            "goes on with it; leave the option out"
        )
    return own


def composed(words: Sequence[str], config_dir: str | None) -> Experiment:
    """Compose a configuration from the words of a command, and make its plugins."""
    options = ["--config-dir", config_dir] if config_dir else []
    resumed = any(word.startswith(KEY) for word in words)
    line = arguments_of(words) if resumed else [*words, *options]
    registry.load_installed()
    origins = config.Origins(line)
    config.security.check(origins)
    try:
        cfg = origins.compose()
    except Exception as error:  # Hydra's and OmegaConf's have no common base
        raise UserError(config.messages.of_composition(error, origins)) from error
    with open_dict(cfg):
        cfg.pop("hydra", None)
    return config.schema.build(cfg)


def advice(experiment: Experiment, groups: Mapping[str, xr.Dataset]) -> Advice:
    """Say which bounds the views that are done reach, and where to stand next.

    Parameters
    ----------
    experiment : Experiment
        With a volume, whose surface is to be seen.
    groups : mapping of str to xarray.Dataset
        Of the views: their images, and the group ``pose``. Without any it is said what the stands
        reach that the configuration gives.
    """
    if not groups and experiment.volume is not None:
        given = planner.check_stands(experiment)
        reached = f"The stands that are given: {_reached(given)}."
        beside = planner.done.boxes_told(given.given, given.place, experiment)
        lines = [reached, *(f"{_sentence(line)}." for line in beside), BETTER]
        return Advice(lines, PlanFigure(given))
    if experiment.volume is None or not any(name.startswith("image/") for name in groups):
        return Advice(["Without a volume and images of it nobody can say where to stand next."])
    done = RunData(dict(groups), {}, Path())
    views = [name.removeprefix("image/") for name in groups if name.startswith("image/")]
    every = experiment.scan.view_names() if experiment.scan else []
    ahead = [name for name in every if name not in views]
    told = [views_told(views, ahead)]
    with suppress(UserError):  # of so few views
        told.append(f"If you stopped here: {_reached(planner.check_stands(experiment, done))}.")
    try:
        after = planner.next_stand(experiment, done)
    except UserError as error:
        few = [TOO_FEW, *([] if ahead else [NO_MORE])]
        return Advice([*told, f"No stand can be advised: {error}."] if told[1:] else [*told, *few])
    for stand in after.added:
        place, what = (_metres(point) for point in (stand.origin, stand.look_at))
        told.append(f"Stand next at {place} m and look at {what} m. Then: {_reached(after)}.")
    if after.one_more is not None:
        told.append(f"{_sentence(after.one_more.told)}.")
    return Advice(told, PlanFigure(after))


def views_told(done: Sequence[str], ahead: Sequence[str]) -> str:
    """Say which views of a scan are done, and which are to come.

    Examples
    --------
    >>> views_told(["1"], ["2", "3", "4"])
    '1 of 4 views is done: 1. Still to come: 2, 3 and 4.'
    >>> views_told(["left", "right"], [])
    '2 of 2 views are done: left and right.'
    >>> views_told(["1"], [])
    '1 of 1 view is done: 1.'
    """
    count, are = len(done) + len(ahead), "is" if len(done) == 1 else "are"
    told = f"{len(done)} of {count} view{'s' * (count > 1)} {are} done: {_listed(done)}."
    return f"{told} Still to come: {_listed(ahead)}." if ahead else told


def _listed(names: Sequence[str]) -> str:
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


class PlanFigure:
    """Figure of a plan for the page, drawn when it is asked for and once for each width."""

    def __init__(self, plan: StandPlan) -> None:
        self._plan = plan
        self._drawn: dict[bool, bytes] = {}
        self._lock = threading.Lock()  # of two browsers that ask at once

    def __call__(self, narrow: bool) -> bytes:
        """Give it as PNG, for a narrow screen or not."""
        with self._lock:
            if narrow not in self._drawn:
                content = io.BytesIO()
                made = planner.figure.draw(self._plan, width=NARROW if narrow else None)
                made.savefig(content, format="png", dpi=DOTS, metadata={"Software": None})
                self._drawn[narrow] = content.getvalue()
            return self._drawn[narrow]


def _reached(plan: StandPlan) -> str:
    """Say which bound a plan reaches, or that it does not determine all components."""
    if plan.undetermined:
        return (
            f"{plan.undetermined} of {len(plan.place.nodes)} nodes are seen by too few views to "
            "determine all components"
        )
    which = "largest" if plan.goal.criterion is PlanCriterion.worst else "r.m.s."
    return (
        f"the {which} bound is {1e3 * plan.asked:.3g} mm/s where every place is taken by itself, "
        "by the noise alone; that of a smooth field is smaller"
    )


def _sentence(text: str) -> str:
    return text[0].upper() + text[1:]


def _metres(point: Array) -> str:
    return "(" + ", ".join(f"{x:.2f}" for x in point.round(2) + 0.0) + ")"


def _number(port: str | None) -> int:
    if port is None:
        return 0
    if not port.isdigit() or not 0 <= int(port) < 2**16:
        raise UserError(f"command line: --port must be a number up to 65535, not {port}")
    return int(port)
