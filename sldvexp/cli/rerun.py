"""`sldvexp rerun <run.nc>`: repeat a run from its file alone, and say how well it repeats.

Two runs are compared quantity by quantity: identical, equal to rounding, or different.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sldvexp import dataset
from sldvexp.config import registry
from sldvexp.config.paths import CONF_SCHEME, JOURNAL, RUN_FILE, locate
from sldvexp.errors import UserError
from sldvexp.files import read_text
from sldvexp.lazy import xarray as xr
from sldvexp.limits import YAML_BYTES, load_yaml
from sldvexp.pipeline import provenance, runner
from sldvexp.pipeline.run_progress import RunProgress
from sldvexp.progress import doing
from sldvexp.sweep import recorded_config
from sldvexp.sweep.recorded_config import Recorded

SAME, DIFFERENT = 0, 2


def run(words: list[str], config_dir: str | None) -> int:
    """Repeat a run into a new folder and print what came out otherwise.

    Raises
    ------
    UserError
        If the file is not a run's, names code, or a file that it read is not there any more.
    """
    if len(words) != 1:
        raise UserError("command line: rerun takes one run.nc, or the folder of one")
    gc.enable()
    given = Path(words[0])
    path = (given / RUN_FILE if given.is_dir() else given).resolve()
    if given.is_dir() and not path.is_file() and (runs := sorted(given.glob(f"*/{RUN_FILE}"))):
        raise UserError(f"{given}: is a sweep; rerun takes one of its runs, as {runs[0].parent}")
    before = _loaded(path)
    registry.load_installed()
    found = _without_hardware(recorded_config.read(path, before.attrs))
    config = found.config()
    folder = Path(f"outputs/{datetime.now():%Y-%m-%d/%H-%M-%S.%f}").resolve()
    os.chdir(_started_in(found))
    folder.mkdir(parents=True)
    try:
        runner.run(config, str(folder), quiet=True, watcher=RunProgress())
    except BaseException:
        with suppress(OSError):
            folder.rmdir()  # a folder in which nothing is says nothing
        raise
    return _report(found, before, folder / RUN_FILE)


def _loaded(path: Path) -> xr.DataTree:
    with dataset.load(path) as tree:
        return tree.load()


def _without_hardware(found: Recorded) -> Recorded:
    """Put the scan lines that a run kept in the place of an instrument's."""
    if found.plugins.get("instrument") != "visa":
        return found
    folder = found.path.parent
    if not (folder / JOURNAL).is_dir():
        raise UserError(
            f"{found.path}: was measured, and its scan lines are not beside it in {JOURNAL}; "
            "without them only the instrument could repeat it"
        )
    return replace(
        found,
        plugins={**found.plugins, "instrument": "replay"},
        values={**found.values, "instrument": {"path": str(folder)}},
    )


def _started_in(found: Recorded) -> Path:
    """Find the folder from which the run's input files are found with the content that it read."""
    complaint = ""
    for base in _bases(found.path.parent):
        wrong = next((w for p, d in found.inputs.items() if (w := _wrong(base, p, d))), "")
        if not wrong:
            return base
        complaint = complaint or wrong
    raise UserError(f"{found.path}: {complaint}")


def _bases(folder: Path) -> list[Path]:
    """List where this was called, and where the run was, if Hydra's folder still tells."""
    found = [Path.cwd()]
    try:
        settings: Any = load_yaml(read_text(folder / ".hydra" / "hydra.yaml", YAML_BYTES))
        found.append(Path(str(settings["hydra"]["runtime"]["cwd"])))
    except Exception:  # any file may lie there; it is only a hint
        return found
    return [base for base in found if base.is_dir()]


def _wrong(base: Path, name: str, digest: str) -> str:
    """Say what is wrong with an input file; empty if nothing is."""
    path = locate(name) if name.startswith(CONF_SCHEME) else base / locate(name)
    if not path.is_file():
        return f"the run read {name}, which is not there (looked from {base})"
    if provenance.sha256(path) != digest:
        return f"the run read {name}, which has another content now"
    return ""


def _report(found: Recorded, before: xr.DataTree, path: Path) -> int:
    now = provenance.versions()
    changed = [
        f"{name} {found.packages.get(name, 'none')} -> {now.get(name, 'none')}"
        for name in sorted({*found.packages, *now})
        if found.packages.get(name) != now.get(name)
    ]
    with doing("comparing"):
        differences = compare(before, _loaded(path))
    counts = {kind: sum(d.kind is kind for d in differences) for kind in AgreementLevel}
    for difference in differences:
        if difference.kind is not AgreementLevel.identical:
            print(f"{difference.name}: {difference.kind}{difference.how}")
    print(f"{len(differences)} quantities: {', '.join(f'{n} {k}' for k, n in counts.items())}")
    print(f"packages: {'; '.join(changed) or 'the same versions'}")
    print(path)
    return DIFFERENT if counts[AgreementLevel.different] else SAME


#: Largest difference that another order of operations makes, of a variable's largest entry.
ROUNDING = 1e-10


class AgreementLevel(StrEnum):
    """How far a quantity agrees."""

    identical = "bit-identical"
    rounding = "equal within rounding"
    different = "different"


@dataclass(frozen=True)
class Difference:
    """How far one quantity agrees.

    Parameters
    ----------
    name : str
        ``group/variable`` or ``group@attribute``.
    kind : AgreementLevel
    how : str
        The rest of the sentence about it.
    """

    name: str
    kind: AgreementLevel
    how: str = ""


def compare(before: xr.DataTree, after: xr.DataTree) -> list[Difference]:
    """Compare all quantities of two runs, the attributes of the root left out.

    Parameters
    ----------
    before, after : xarray.DataTree
        In memory, as `sldvexp.dataset.load` gives them.
    """
    first, second = dict(_quantities(before)), dict(_quantities(after))
    found = []
    for name in dict.fromkeys([*first, *second]):
        if name not in second:
            found.append(Difference(name, AgreementLevel.different, ": it is missing now"))
        elif name not in first:
            found.append(Difference(name, AgreementLevel.different, ": it is new"))
        else:
            found.append(Difference(name, *_agreement(first[name], second[name])))
    return found


def _quantities(tree: xr.DataTree) -> Iterator[tuple[str, NDArray]]:
    for node in tree.subtree:
        group = node.path.strip("/")
        if not group:
            continue
        own = node.to_dataset(inherit=False)
        yield from ((f"{group}/{name}", v.values) for name, v in own.variables.items())
        yield from ((f"{group}@{name}", np.asarray(v)) for name, v in own.attrs.items())


def _agreement(a: NDArray, b: NDArray) -> tuple[AgreementLevel, str]:
    if a.shape != b.shape:
        return AgreementLevel.different, f": its shape was {a.shape} and is {b.shape}"
    numbers = a.dtype.kind in "biufc" and b.dtype.kind in "biufc"
    if not numbers:
        same = a.tolist() == b.tolist()
        return (AgreementLevel.identical, "") if same else (AgreementLevel.different, "")
    if a.dtype == b.dtype and a.tobytes() == b.tobytes():
        return AgreementLevel.identical, ""
    unlike = np.isfinite(a) != np.isfinite(b)
    both = np.isfinite(a) & np.isfinite(b)
    difference = np.abs(np.subtract(b[both], a[both], dtype=np.result_type(a, b, float)))
    largest = np.abs(a[both]).max(initial=0.0)
    relative = difference.max(initial=0.0) / (largest or 1.0)
    how = f", by {relative:.2g} of its largest entry"
    if unlike.any():
        return (
            AgreementLevel.different,
            f"{how}; {unlike.sum()} entries are finite in one of them only",
        )
    return (AgreementLevel.rounding if relative <= ROUNDING else AgreementLevel.different), how
