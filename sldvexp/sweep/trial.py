"""Trial of one combination of settings: whether it does what is expected of it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omegaconf import DictConfig, open_dict

from sldvexp import dataset
from sldvexp.config import Origins, messages, schema, security
from sldvexp.config.experiment import NAMED_GROUPS, SINGLE_GROUPS, Experiment
from sldvexp.config.paths import RUN_FILE, locate
from sldvexp.config.sources import COMMAND_LINE
from sldvexp.errors import UserError
from sldvexp.files import require_file
from sldvexp.instrument import ScanningPlugin
from sldvexp.lazy import xarray as xr
from sldvexp.pipeline import runner
from sldvexp.pipeline.steps import STEPS
from sldvexp.report import number
from sldvexp.sweep.matrix import Cell, as_setting
from sldvexp.sweep.plan import folder_name
from sldvexp.sweep.shared_steps import SHARED, Store
from sldvexp.virtual_lab import LabServer, VirtualLab


@dataclass(frozen=True)
class Verdict:
    """Outcome of a combination.

    Attributes
    ----------
    passed : bool
        Whether that is what was expected.
    told : str
        One sentence about it.
    """

    passed: bool
    told: str


class Trials:
    """Cells that are tried, each in a folder of its own; steps that they share are done once.

    Parameters
    ----------
    cells : sequence of Cell
    arguments : list of str
        Options of the command line that say which configuration is meant.
    folder : Path
    """

    def __init__(self, cells: Sequence[Cell], arguments: list[str], folder: Path):
        self.cells = {cell.name: cell for cell in cells}
        self.arguments, self.folder = arguments, folder
        self._verdicts: dict[str, Verdict] = {}
        # A run that took over another's scan lines has none in its own folder.
        self._sources = {name for cell in cells for name in cell.run_of.values()}

    def judge(self, name: str) -> Verdict:
        """Try a cell, and before it those whose runs it needs."""
        if name not in self._verdicts:
            cell = self.cells[name]
            try:
                verdict = self._tried(cell)
                if cell.refused:
                    verdict = Verdict(False, f"works, but should be refused: {cell.refused}")
            except UserError as error:
                passed = bool(cell.refused and re.search(cell.refused, str(error)))
                verdict = Verdict(passed, f"{'refused, as it should be: ' * passed}{error}")
            self._verdicts[name] = verdict
        return self._verdicts[name]

    def _tried(self, cell: Cell) -> Verdict:
        """Tell whether a cell's numbers are as expected.

        UserError for what keeps it from running.
        """
        folder = self.folder / folder_name([cell.name])
        settings = [*cell.settings, *self._runs_of_others(cell)]
        with _lab(cell, self.arguments, settings) as address:
            origins = Origins(self.arguments, [*settings, *address])
            cfg = _composed(origins)
            with open_dict(cfg):
                for name, entry in cell.expect.items():
                    cfg.expect[name] = entry
            try:
                experiment = schema.build(cfg)
                if not cell.run or (_is_real(experiment.instrument) and not address):
                    return Verdict(True, _looked_at(experiment))
                folder.mkdir(parents=True)
                store = None if cell.name in self._sources else Store(cfg, self.folder / SHARED)
                runner.run(cfg, str(folder), quiet=True, share=store)
            except Exception as error:
                told = messages.sentence(error, origins) or f"{type(error).__name__}: {error}"
                raise UserError(_in_one_line(told)) from None
        with dataset.load(folder / RUN_FILE) as tree:
            return _compared(tree["check"].to_dataset() if "check" in tree.children else None)

    def _runs_of_others(self, cell: Cell) -> Iterator[str]:
        """Yield settings that name the folders of other cells' runs."""
        for setting, name in cell.run_of.items():
            if not self.judge(name).passed:
                raise UserError(f"{setting} needs the run of {name}, which is not as expected")
            yield f"{setting}={as_setting(str(self.folder / folder_name([name])))}"


@contextmanager
def _lab(cell: Cell, arguments: list[str], settings: list[str]) -> Iterator[list[str]]:
    """Serve a virtual lab meanwhile, if a cell has one; the setting with its address."""
    if not cell.lab:
        yield []
        return

    origins = Origins(arguments, [*settings, f"{cell.lab}=unknown"])
    e = schema.build(_composed(origins))
    if e.scene is None or e.laser is None:
        raise UserError(f"{cell.lab}: a virtual lab needs a scene and a laser")
    with LabServer(VirtualLab(e.scene, e.laser, e.target, e.seed)) as server:
        yield [f"{cell.lab}={server.resource}"]


def _composed(origins: Origins) -> DictConfig:
    """Compose the configuration as a run gets it.

    Raises
    ------
    UserError
        With the sentence about whatever keeps it from being composed.
    """
    try:
        security.check(origins)
        cfg = origins.compose()
    except Exception as error:
        raise UserError(_in_one_line(messages.of_composition(error, origins))) from None
    with open_dict(cfg):
        del cfg["hydra"]
    return cfg


def _is_real(instrument: Any) -> bool:
    """Tell whether a run would move real mirrors."""
    return isinstance(instrument, ScanningPlugin) and instrument.real


def _looked_at(experiment: Experiment) -> str:
    """Say what can be said of a configuration that is not run, its files looked for."""
    if not any(step.needed(experiment) for step in STEPS):
        raise UserError("there is nothing to do: choose a target, a pose or an instrument")
    named: list[Any] = [getattr(experiment, group) for group in SINGLE_GROUPS]
    for group in NAMED_GROUPS:
        named += getattr(experiment, group).values()
    for plugin in named:
        for path in plugin.inputs() if hasattr(plugin, "inputs") else []:
            require_file(locate(path))
    why = "; not run, as it needs an instrument" if _is_real(experiment.instrument) else ""
    return f"is in order{why}"


def _compared(check: xr.Dataset | None) -> Verdict:
    """Judge the comparison with expectations; of those missed, the first is told."""
    if check is None:
        return Verdict(True, "works; nothing is expected of its numbers")
    count = check.sizes["quantity"]
    missed = check.isel(quantity=(check["passed"].values == 0).nonzero()[0])
    if not missed.sizes["quantity"]:
        return Verdict(True, f"works; {count} number{'s' * (count > 1)} as expected")
    first = missed.isel(quantity=0)
    bound = {"=": "", "<=": "at most ", ">=": "at least "}[first["relation"].item()]
    tolerance = first["tolerance"].item()
    within = f" within {number(tolerance, 2)}" if tolerance else ""
    return Verdict(
        False,
        f"{missed.sizes['quantity']} of {count} numbers are not as expected: "
        f"{first['quantity'].item()} is {number(first['computed'].item(), 5)}, not "
        f"{bound}{number(first['published'].item(), 5)}{within}",
    )


def _in_one_line(told: str) -> str:
    """Join several sentences, without the command line, on which none of the settings is."""
    return "; ".join(line.removeprefix(f"{COMMAND_LINE}: ") for line in told.splitlines())
