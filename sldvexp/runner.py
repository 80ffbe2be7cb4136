"""Composes the steps of one run from its configuration and leaves one dataset behind."""

from __future__ import annotations

import logging
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from omegaconf import DictConfig
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from sldvexp import config, dataset, provenance
from sldvexp.errors import UserError
from sldvexp.files import whole_or_nothing
from sldvexp.report.pose_text import pose_text
from sldvexp.report.table import closing_table
from sldvexp.steps import STEPS, Run

log = logging.getLogger(__name__)

RUN_FILE = "run.nc"


def run(cfg: DictConfig, folder: str) -> bool:
    """Run one experiment.

    Parameters
    ----------
    cfg : DictConfig
        The composed configuration.
    folder : str
        Where `run.nc` and the text outputs go; it exists already.

    Returns
    -------
    bool
        Whether every expectation was met.

    Raises
    ------
    UserError
        For any mistake in the configuration or the data, before anything is left behind.
    """
    start = datetime.now(UTC)
    experiment = config.build(cfg)
    run = Run(experiment, np.random.default_rng(experiment.seed), Path(folder))
    steps = [(name, step) for name, needed, step in STEPS if needed(experiment)]
    if not steps:
        raise UserError(
            "there is nothing to do: choose an experiment, for example experiment=pose "
            "(sldvexp --help lists them), or a target, a pose or an instrument"
        )
    bar = Progress(
        SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn(), transient=True
    )
    with bar:
        task = bar.add_task("", total=len(steps))
        for name, step in steps:
            bar.update(task, description=name, advance=1)
            log.info(name)
            step(run)
    path = Path(folder) / RUN_FILE
    attributes = provenance.attributes(cfg, run.inputs, start)
    dataset.save(run.tree, attributes, path)
    texts = {"pose.txt": pose_text(run.tree["pose"])} if "pose" in run.tree else {}
    for name, text in texts.items():
        with whole_or_nothing(path.with_name(name)) as beside:
            beside.write_text(text)
    closing_table(run.tree, [path, *(path.with_name(n) for n in texts)])
    return "check" not in run.tree or bool(run.tree["check"]["passed"].all())
