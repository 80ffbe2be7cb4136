"""Composes the steps of one run from its configuration and leaves one dataset behind."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import DictConfig, OmegaConf

from sldvexp import dataset
from sldvexp.config import schema
from sldvexp.config.experiment import Experiment, OnDoubt
from sldvexp.config.paths import JOURNAL, RUN_FILE, locate
from sldvexp.dataset import VERDICT, Finding, Severity, findings_of, findings_to_dataset
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import UserError
from sldvexp.export import export_all
from sldvexp.pipeline import provenance
from sldvexp.pipeline.run_progress import RunProgress
from sldvexp.pipeline.step import Run, Step
from sldvexp.pipeline.steps import SCAN, STEPS
from sldvexp.report import REPORT_FILE, NoReport, Report, attempt, pose_text, print_closing
from sldvexp.session import Operator, Watcher
from sldvexp.session.interruption import how_to_go_on, telling_of_the_scan
from sldvexp.writing import making, take_over, whole_or_nothing

log = logging.getLogger(__name__)

POSE_FILE = "pose.txt"
#: What comes after the steps, as a person is told of it.
RESULTS, PAGE, EXPORTS = "results", "page", "exports"


def run(
    cfg: DictConfig,
    folder: str,
    quiet: bool = False,
    share: Callable[[Step, Run], None] | None = None,
    experiment: Experiment | None = None,
    watcher: Watcher | None = None,
    operator: Operator | None = None,
    left: Callable[[RunData], None] | None = None,
) -> bool:
    """Run one experiment.

    Parameters
    ----------
    cfg : DictConfig
        The composed configuration.
    folder : str
        Where `run.nc` and the other outputs go, and in which scan lines are kept; it exists
        already.
    quiet : bool
        Neither a bar nor the closing table, as one of many runs.
    share : callable, optional
        Does a step, or takes over what another run did, see `sldvexp.sweep.shared_steps.Store`.
    experiment : Experiment, optional
        Its plugins, if they are made already; `cfg` is checked and they are made of it otherwise.
    watcher : Watcher, optional
        Shows how the run gets on, in the place of `RunProgress`.
    operator : Operator, optional
        Is asked for what must be done by hand, in the place of the person at the terminal.
    left : callable, optional
        Gets what the run's file has, once it is in its place.

    Returns
    -------
    bool
        Whether every step was done and every expectation met.

    Raises
    ------
    UserError
        For any mistake in the configuration or the data; what was in the folder stays.
    """
    start = datetime.now(UTC)
    experiment = experiment or schema.build(cfg)
    steps = [step for step in STEPS if step.needed(experiment)]
    if not steps:
        raise UserError(
            "there is nothing to do: choose an experiment, for example experiment=pose "
            "(sldvexp --help lists them), or a target, a pose or an instrument"
        )
    watching = watcher or RunProgress(quiet)
    rng = np.random.default_rng(experiment.seed)
    run = Run(experiment, rng, Path(folder), operator or Operator(watching), watching)
    page = experiment.report if share is None else None
    do = share or (lambda step, run: step.perform(run))
    report = _page_maker(experiment, one_of_many=share is not None)
    last = [RESULTS, *[PAGE] * (report is not None), *[EXPORTS] * bool(experiment.export)]
    begin = partial(_begin, watching, [*(step.name for step in steps), *last])
    with watching:
        watching.run_begun(run.folder)
        with _page_if_unfinished(page, run.folder), _told_how_to_go_on(run.folder):
            whole = _do(steps, run, do, begin)
        run.conclude()
        for finding in findings_of(run.tree):
            log.info("%s: %s: %s", run.verdict, finding.severity.name, finding.text)
        attributes = {**provenance.attributes(cfg, run.inputs, start), VERDICT: run.verdict}
        if run.reused:
            attributes["reused_steps"] = ", ".join(run.reused)
        named = list(_texts(OmegaConf.to_container(cfg)))
        made = _leave(run, attributes, report, named, begin)
        watching.run_done(made)
    if left:
        left(RunData(run.kept, attributes))
    if not quiet:
        print_closing(RunData(run.kept, attributes), made)
    return whole and ("check" not in run.tree or bool(run.tree["check"]["passed"].all()))


def _page_maker(experiment: Experiment, one_of_many: bool) -> Report | None:
    """Find what makes the page of this run, if it gets one."""
    report: Report | None = experiment.report
    none = report is None or isinstance(report, NoReport)
    return None if none or (one_of_many and report and not report.each_run) else report


def _leave(
    run: Run,
    attributes: dict[str, Any],
    report: Report | None,
    named: list[str],
    begin: Callable[[str], None],
) -> list[Path]:
    """Make all files of a run beside those that are there, and put them in their places at once.

    Parameters
    ----------
    named : list of str
        Texts of the configuration; files among them are not outdated.
    begin : callable
        Told which files come next.

    Returns
    -------
    list of Path
        The files, the dataset first.
    """
    folder = run.folder
    path = folder / RUN_FILE
    texts = {POSE_FILE: pose_text(run.tree["pose"])} if "pose" in run.tree else {}
    begin(RESULTS)
    with making(folder) as new:
        dataset.save(run.kept, attributes, new / RUN_FILE)
        for name, text in texts.items():
            with whole_or_nothing(new / name) as beside:
                beside.write_text(text)
        if report:
            begin(PAGE)
        pages = attempt(lambda: _page(report, run, attributes, new), path) if report else []
        outdated = [
            name
            for name in (POSE_FILE, REPORT_FILE)
            if (folder / name).exists()
            and not ((new / name).exists() or _is_read(folder / name, named))
        ]
        if run.experiment.export:
            begin(EXPORTS)
        try:
            exported = export_all(run.experiment.export, RunData(run.tree, attributes), new)
        except UserError as error:
            where = new
            if not path.is_file():  # nothing is lost by it, and it can be exported in other ways
                take_over(folder, outdated)
                where = folder
            raise UserError(f"{error} (the run is in {where / RUN_FILE})") from None
        take_over(folder, outdated)
    made = [*(new / name for name in texts), *exported, *pages]
    return [path, *(folder / file.relative_to(new) for file in made)]


def _page(report: Report, run: Run, attributes: dict[str, Any], new: Path) -> Path | None:
    """Make the page of what was written, without reading it again where it still is in memory."""
    tree = dataset.whole_tree(run.kept, attributes)
    if dataset.in_memory(tree):
        return report.of_run_at_hand(new / RUN_FILE, RunData.from_source(tree, new))
    return report.of_run(new / RUN_FILE)


def _begin(watcher: Watcher, names: Sequence[str], name: str) -> None:
    """Tell which of all steps begins."""
    watcher.step_begun(name, 1 + names.index(name), len(names))


def _do(
    steps: Sequence[Step],
    run: Run,
    do: Callable[[Step, Run], None],
    begin: Callable[[str], None],
) -> bool:
    """Do one step after the other; False if doubt has stopped the run."""
    scanned = False
    for step in steps:
        begin(step.name)
        log.info(step.name)
        with telling_of_the_scan(run.folder, scanned):
            do(step, run)
        scanned |= step.name == SCAN
        if run.experiment.on_doubt is OnDoubt.stop and run.verdict != "trusted":
            log.info("stopped: the verdict is %s", run.verdict)
            told = f"stopped after the {step.name}, as on_doubt=stop asks: nothing else was made"
            stopped = Finding("stopped", "run", told, Severity.note)
            run.tree[f"{VERDICT}/stopped"] = findings_to_dataset([stopped])
            return False
    return True


@contextmanager
def _told_how_to_go_on(folder: Path) -> Iterator[None]:
    """Give Ctrl-C and the like a sentence, if there are scan lines to go on with."""
    try:
        yield
    except KeyboardInterrupt as stop:
        if (folder / JOURNAL).is_dir():
            stop.args = (f"interrupted; {how_to_go_on(folder)}",)
        raise


@contextmanager
def _page_if_unfinished(report: Report | None, folder: Path) -> Iterator[None]:
    """Leave a page of a run that ends before it is done; that of a finished one stays."""
    try:
        yield
    except BaseException as end:
        if report is not None and folder.is_dir() and not (folder / RUN_FILE).is_file():
            known = isinstance(end, UserError | KeyboardInterrupt)
            reason = str(end) if known else "the program has a fault, of which the log tells"
            attempt(lambda: report.of_unfinished(folder, reason), folder)
        raise


def _is_read(file: Path, texts: Iterable[str]) -> bool:
    """Tell whether a configuration with these texts names a file."""
    named = (text for text in texts if text.endswith(file.name))
    return file.resolve() in (locate(text).resolve() for text in named)


def _texts(node: Any) -> Iterator[str]:
    """Yield every text in a configuration."""
    if isinstance(node, str):
        yield node
    elif isinstance(node, dict | list):
        for part in node.values() if isinstance(node, dict) else node:
            yield from _texts(part)
