"""The steps of a run, in the order in which data flows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import xarray as xr

from sldvexp import config
from sldvexp.check.expectations import evaluate
from sldvexp.errors import UserError
from sldvexp.instrument.base import ScanningPlugin


@dataclass
class Run:
    """What the steps of one run share: the plugins, the generator, and the groups made so far."""

    experiment: config.Experiment
    rng: np.random.Generator
    folder: Path
    tree: dict[str, xr.Dataset] = field(default_factory=dict)
    inputs: list[str] = field(default_factory=list)


def _target(run: Run) -> None:
    """The calibration object's points."""
    run.tree["target"] = run.experiment.target.group()


def _scan(run: Run) -> None:
    """Edges of the calibration object's circles in every view."""
    from sldvexp.instrument.protocol import InstrumentError
    from sldvexp.instrument.recording import JOURNAL
    from sldvexp.session.views import scan_views

    e = run.experiment
    if not isinstance(e.instrument, ScanningPlugin):
        raise UserError(
            "scan: needs an instrument that scans, for example instrument=simulated with "
            "scene=calibration"
        )
    if e.signal is None or e.laser is None:
        raise UserError("scan: needs signal=sine_fit and a laser to make pixels of samples")
    run.inputs += [*e.scan.inputs(), *e.instrument.inputs()]
    try:
        run.tree |= scan_views(e, run.folder / JOURNAL)
    except InstrumentError as error:
        raise UserError(
            f"{error}; what was scanned is kept, go on with: sldvexp resume={run.folder}"
        ) from error


def _pose(run: Run) -> None:
    """Where the instrument stood."""
    method = run.experiment.pose
    run.inputs += method.inputs()
    run.tree |= method.estimate(run.experiment.laser, run.experiment.target, run.tree)


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
        if method is None:
            continue
        try:
            run.tree[group] = method.group(run.tree["line_of_sight"])
        except UserError as error:
            where = "reconstruction" if group == "point" else group.replace("/", ".")
            raise UserError(f"{where}: {error}") from None


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
    ("scan", lambda e: e.scan is not None, _scan),
    ("pose", lambda e: e.pose is not None, _pose),
    ("line-of-sight velocities", lambda e: hasattr(e.instrument, "read"), _line_of_sight),
    ("velocity at points", lambda e: bool(e.reconstruction or e.compare), _point),
    ("checks", lambda e: bool(e.check), _checks),
    ("expectations", lambda e: bool(e.expect), _expectations),
)
