"""Composes the steps of one run from its configuration and leaves one dataset behind."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import xarray as xr
from omegaconf import DictConfig
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from sldvexp import config, dataset, provenance
from sldvexp.check.expectations import evaluate
from sldvexp.errors import UserError
from sldvexp.files import whole_or_nothing
from sldvexp.report.pose_text import pose_text
from sldvexp.report.table import closing_table

log = logging.getLogger(__name__)

RUN_FILE = "run.nc"


@dataclass
class Run:
    """What the steps of one run share: the plugins, the generator, and the groups made so far."""

    experiment: config.Experiment
    rng: np.random.Generator
    tree: dict[str, xr.Dataset] = field(default_factory=dict)
    inputs: list[str] = field(default_factory=list)


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
    run = Run(experiment, np.random.default_rng(experiment.seed))
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


def _target(run: Run) -> None:
    """The calibration object's points."""
    run.tree["target"] = run.experiment.target.group()


def _pose(run: Run) -> None:
    """Where the instrument stood."""
    method = run.experiment.pose
    run.inputs += method.inputs()
    run.tree |= method.estimate(run.experiment.laser, run.experiment.target)


def _line_of_sight(run: Run) -> None:
    """Velocities along the lines of sight."""
    run.inputs += run.experiment.instrument.inputs()
    run.tree["line_of_sight"] = run.experiment.instrument.read()


def _point(run: Run) -> None:
    """Velocity vectors at points, by the chosen method and those it is compared with."""
    if "line_of_sight" not in run.tree:
        raise UserError(
            "reconstruction: there are no velocities to reconstruct from; "
            "name a file with instrument=file instrument.path=..."
        )
    methods = {"point": run.experiment.reconstruction}
    methods |= {f"compare/{name}": m for name, m in run.experiment.compare.items()}
    for group, method in methods.items():
        if method is not None:
            run.tree[group] = method.group(run.tree["line_of_sight"])


def _checks(run: Run) -> None:
    """What the configuration wants examined."""
    for name, check in run.experiment.check.items():
        run.inputs += check.inputs()
        run.tree[f"examined/{name}"] = check.examine(run.tree, run.rng)


def _expectations(run: Run) -> None:
    """Published numbers against this run's."""
    found = evaluate(run.experiment.expect, run.tree)
    if found is not None:
        run.tree["check"] = found


Needed = Callable[[config.Experiment], bool]
STEPS: tuple[tuple[str, Needed, Callable[[Run], None]], ...] = (
    ("calibration object", lambda e: e.target is not None, _target),
    ("pose", lambda e: e.pose is not None, _pose),
    ("line-of-sight velocities", lambda e: e.instrument is not None, _line_of_sight),
    ("velocity at points", lambda e: bool(e.reconstruction or e.compare), _point),
    ("checks", lambda e: bool(e.check), _checks),
    ("expectations", lambda e: bool(e.expect), _expectations),
)
