"""Composes the steps of one run from its configuration and leaves one dataset behind."""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import DictConfig, OmegaConf
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from sldvexp import dataset
from sldvexp.config import schema
from sldvexp.config.experiment import Experiment, OnDoubt
from sldvexp.config.paths import RUN_FILE, locate
from sldvexp.dataset import VERDICT, Finding, Severity, findings_of, findings_to_dataset
from sldvexp.dataset.run_data import RunData
from sldvexp.errors import UserError
from sldvexp.export import export_all
from sldvexp.files import whole_or_nothing
from sldvexp.instrument.recording import JOURNAL
from sldvexp.pipeline import provenance
from sldvexp.pipeline.steps import SCAN, STEPS, Run, Step
from sldvexp.report import REPORT_FILE, attempt, closing_table, pose_text
from sldvexp.session import Operator
from sldvexp.session.interruption import how_to_go_on, telling_of_the_scan

log = logging.getLogger(__name__)

POSE_FILE = "pose.txt"


def run(
    cfg: DictConfig,
    folder: str,
    quiet: bool = False,
    share: Callable[[Step, Run], None] | None = None,
    experiment: Experiment | None = None,
) -> bool:
    """Run one experiment.

    Parameters
    ----------
    cfg : DictConfig
        The composed configuration.
    folder : str
        Where `run.nc` and the text outputs go; it exists already.
    quiet : bool
        Neither a bar nor the closing table, as one of many runs.
    share : callable, optional
        Does a step, or takes over what another run did, see `sldvexp.sweep.shared_steps.Store`.
    experiment : Experiment, optional
        Its plugins, if they are made already; `cfg` is checked and they are made of it otherwise.

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
    bar = Progress(
        SpinnerColumn(),
        TextColumn("{task.description}"),
        TimeElapsedColumn(),
        transient=True,
        disable=quiet,
    )
    rng = np.random.default_rng(experiment.seed)
    run = Run(experiment, rng, Path(folder), Operator(lambda: _paused(bar)))
    with bar, _told_how_to_go_on(run.folder):
        whole = _do(steps, run, bar, share or (lambda step, run: step.perform(run)))
    run.conclude()
    verdict = run.verdict
    for finding in findings_of(run.tree):
        log.info("%s: %s: %s", verdict, finding.severity.name, finding.text)
    path = Path(folder) / RUN_FILE
    attributes = {**provenance.attributes(cfg, run.inputs, start), VERDICT: run.verdict}
    if run.reused:
        attributes["reused_steps"] = ", ".join(run.reused)
    texts = {POSE_FILE: pose_text(run.tree["pose"])} if "pose" in run.tree else {}
    dataset.save(run.kept, attributes, path)
    for name, text in texts.items():
        with whole_or_nothing(path.with_name(name)) as beside:
            beside.write_text(text)
    _remove_outdated(cfg, Path(folder), texts)
    report = experiment.report
    wanted = report is not None and (share is None or report.each_run)
    pages = attempt(lambda: report.of_run(path), path) if wanted else []
    exported = export_all(experiment.export, RunData(run.tree, attributes), path)
    if not quiet:
        closing_table(
            RunData(run.kept, attributes),
            [path, *(path.with_name(n) for n in texts), *exported, *pages],
        )
    return whole and ("check" not in run.tree or bool(run.tree["check"]["passed"].all()))


def _do(steps: Sequence[Step], run: Run, bar: Progress, do: Callable[[Step, Run], None]) -> bool:
    """Do one step after the other; False if doubt has stopped the run."""
    task, scanned = bar.add_task("", total=len(steps)), False
    for step in steps:
        bar.update(task, description=step.name, advance=1)
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
    """Give Ctrl-C a sentence, if there are scan lines that the run could go on with."""
    try:
        yield
    except KeyboardInterrupt:
        if not (folder / JOURNAL).is_dir():
            raise
        raise KeyboardInterrupt(f"interrupted; {how_to_go_on(folder)}") from None


@contextmanager
def _paused(bar: Progress) -> Iterator[None]:
    """Give the terminal back without the bar, which would draw over what is asked there."""
    bar.stop()
    try:
        yield
    finally:
        bar.start()


def _remove_outdated(cfg: DictConfig, folder: Path, made: Collection[str]) -> None:
    """Remove what an earlier run left beside this one's file, unless this run reads it."""
    read = list(_texts(OmegaConf.to_container(cfg)))
    for file in (folder / POSE_FILE, folder / REPORT_FILE):
        named = (text for text in read if text.endswith(file.name))
        if file.name in made or file.resolve() in (locate(text).resolve() for text in named):
            continue
        try:
            file.unlink(missing_ok=True)
        except OSError as error:
            told = error.strerror or error
            raise UserError(f"{file}: cannot be removed: {told}") from None


def _texts(node: Any) -> Iterator[str]:
    """Yield every text in a configuration."""
    if isinstance(node, str):
        yield node
    elif isinstance(node, dict | list):
        for part in node.values() if isinstance(node, dict) else node:
            yield from _texts(part)
